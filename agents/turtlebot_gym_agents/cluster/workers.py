"""Workers: processes of this machine by joblib, or of a cluster by Ray.

If a worker dies, its unit is repeated. Only this process stores results, so that nothing is stored twice.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import platform
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from turtlebot_gym.extras import installing
from turtlebot_gym.validation import whole
from turtlebot_gym_agents.cluster.units import Result, Unit, Workers, difference, origin, run

RETRIES = 3
"""Retries of a unit whose worker died."""
AHEAD = 2
"""Units queued per core of a cluster, so that none is idle while this process stores results."""
PATIENCE = 10
"""Time for a cluster to answer, s."""
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "NUMBA", "MKL", "OPENBLAS")}
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_task_oom_retries": str(RETRIES),  # unlimited by default
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
_GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))
"""First bytes of HTTP/2, and so of gRPC, which Ray uses."""
_SETTINGS = 4


@contextmanager
def workers_on(cluster: str, *, workers: int | None = None, memory: int = 0) -> Iterator[Workers]:
    """Provide workers for `units.complete` for the duration of the block.

    Args:
        cluster: "local" for processes of this machine; "auto" for the Ray cluster that runs on this machine; or the address of
            a Ray cluster, HOST:PORT.
        workers: With "local": number of worker processes; None for one per core.
        memory: Memory of a unit on a cluster, bytes.

    Raises:
        ImportError: If joblib or Ray is not installed.
        ValueError: If an argument is out of its range.
        OSError: If there is no such cluster, or it cannot do the work; the message says why.
    """
    if workers is not None and cluster != "local":
        raise ValueError(f"workers is for the cluster 'local', not for {cluster!r}: it has as many as its nodes have cores.")
    if workers is not None:
        whole("workers", workers, 1)
    library, extra = ("joblib", "agents") if cluster == "local" else ("ray", "cluster")
    if find_spec(library) is None:
        raise ImportError(f"The cluster {cluster!r} needs {library}: {installing(extra)}.")
    if cluster == "local":
        with _environment(ONE_THREAD):  # the workers inherit it
            yield lambda units: _local_results(units, workers)
        return
    with _environment({**_QUIET, **_token()}), _connected(cluster, memory):  # Ray reads them when it is imported
        yield lambda units: _ray_results(units, memory)


def _local_results(units: Iterable[tuple[str, Unit]], workers: int | None) -> Iterator[tuple[str, Result]]:
    """Yield results as they arrive; units whose workers died are run again."""
    from joblib import cpu_count

    # Not joblib.Parallel: when a worker dies, it drops results that have arrived and were not yet taken.
    from joblib.externals.loky import FIRST_COMPLETED, BrokenProcessPool, ProcessPoolExecutor, wait

    count, missing, reason = workers or cpu_count(), dict(units), ""
    for _ in range(1 + RETRIES):
        pool, waiting, names = ProcessPoolExecutor(count), iter(missing.copy().items()), {}
        try:
            while missing:
                with _interrupts_held():
                    for name, unit in itertools.islice(waiting, 2 * count - len(names)):  # as many as the pool's pipe takes
                        names[pool.submit(run, unit)] = name
                for done in wait(names, return_when=FIRST_COMPLETED).done:
                    result, name = done.result(), names.pop(done)
                    del missing[name]
                    yield name, result
            return
        except BrokenProcessPool as error:
            reason = str(error).strip().partition("\n")[0]
            for done, name in names.items():
                if done.done() and done.exception() is None:
                    del missing[name]
                    yield name, done.result()
        except BaseException:  # Ctrl-C as well
            # The pool's thread fails at a shutdown on a unit that it has not yet put into its pipe.
            while not all(future.running() or future.done() for future in names):
                time.sleep(0.001)
            raise
        finally:
            pool.shutdown(kill_workers=True)
    raise OSError(f"Workers have died {1 + RETRIES} times: {reason}")


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait for the end of the block, and never reach the processes that start in it: they inherit this."""
    resource_tracker.ensure_running()  # it would start with the first of them, and let interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _token() -> dict[str, str]:
    """Return the variable with which Ray sends its token to a cluster, if there is a token."""
    token = (
        any(name in os.environ for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"))
        or (Path.home() / ".ray" / "auth_token").is_file()
    )
    return {"RAY_AUTH_MODE": "token"} if token else {}


@contextmanager
def _connected(cluster: str, memory: int) -> Iterator[None]:
    address = _address_of(cluster)
    import ray  # pyright: ignore[reportMissingImports]

    try:
        ray.init(address, runtime_env={"env_vars": ONE_THREAD}, log_to_driver=False, logging_level=logging.CRITICAL)
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0.0) > 0.0]
        if not nodes:
            raise OSError(f"The cluster {cluster!r} has no node with a core.")
        largest = max(node.get("memory", 0.0) for node in nodes)
        if largest < memory:  # the work would wait forever
            raise OSError(
                f"The cluster {cluster!r} has too little memory: a worker needs {memory / 1e6:,.0f} MB, and its largest node "
                f"gives {largest / 1e6:,.0f} MB."
            )
        yield
    finally:
        with _no_interrupt():
            ray.shutdown()


def _address_of(cluster: str) -> str:
    """Return the address at which a cluster answers.

    Where none answers, Ray waits long, writes much text, and can end the process. So another process asks first.
    """
    if cluster != "auto":
        _require_ray(cluster)
    script = "import ray, sys; ray.init(sys.argv[1], log_to_driver=False); print(ray.get_runtime_context().gcs_address)"
    pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "capture_output": True, "text": True}
    try:
        done = subprocess.run([sys.executable, "-c", script, cluster], **pipes, timeout=PATIENCE)
    except subprocess.TimeoutExpired as error:
        reason = _reason((error.stderr or b"").decode(errors="replace"), cluster, f"it does not answer within {PATIENCE} s.")
        raise OSError(f"The cluster {cluster!r} cannot be used: {reason}") from None
    if done.returncode != 0:
        raise OSError(f"The cluster {cluster!r} cannot be used: {_reason(done.stderr, cluster, '')}")
    return done.stdout.splitlines()[-1]


def _require_ray(address: str) -> None:
    """Raise ValueError or OSError unless a program answers at an address as Ray does."""
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdigit()) or "/" in host:
        raise ValueError(f"cluster must be 'local', 'auto' or HOST:PORT, as `ray start --head` prints it, got {address!r}.")
    try:
        with socket.create_connection((host, int(port)), timeout=4.0) as connection:
            if os.environ.get("RAY_USE_TLS", "0") in ("0", ""):
                connection.sendall(_GREETING)
                answer = connection.recv(9)
                if len(answer) < 4 or answer[3] != _SETTINGS:
                    raise OSError("the program that listens there is not Ray")
    except TimeoutError:
        raise OSError(f"There is no cluster at {address}: nothing answers.") from None
    except (OSError, OverflowError) as error:
        raise OSError(f"There is no cluster at {address}: {error}.") from error


def _reason(text: str, cluster: str, otherwise: str) -> str:
    if "AuthToken" in text or "AuthenticationError" in text:
        return "it asks for a token: set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN as where `ray start` ran."
    if cluster == "auto" and (otherwise or "ConnectionError" in text):
        return "Ray is not running on this machine; `ray start` makes it part of a cluster, and 'local' needs none."
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith((" ", "\t", "["))]
    return otherwise or ([line for line in lines if "Error: " in line] or lines or ["Ray ended without a message."])[-1]


def _ray_results(units: Iterable[tuple[str, Unit]], memory: int) -> Iterator[tuple[str, Result]]:
    """Yield results as they arrive, with enough units submitted to keep all cores busy."""
    import ray  # pyright: ignore[reportMissingImports]
    from ray.exceptions import RayError, RayTaskError  # pyright: ignore[reportMissingImports]

    task = ray.remote(_same_origin).options(num_cpus=1, memory=memory, max_retries=RETRIES)
    waiting, names = iter(units), {}

    def send() -> None:
        # Query the number of cores each time: nodes come and go.
        room = int((1 + AHEAD) * max(1.0, ray.cluster_resources().get("CPU", 1.0))) - len(names)
        for name, unit in itertools.islice(waiting, room):
            names[task.remote(unit, origin())] = name

    send()
    while names:
        (done, *_), _ = ray.wait(list(names), num_returns=1)
        name = names.pop(done)
        try:
            result = ray.get(done)
        except RayTaskError as error:
            if isinstance(error.cause, (ValueError, OSError, ImportError)):
                raise error.cause from None
            if "No module named" not in str(error):
                raise
            module = str(error).rpartition("No module named ")[2].split()[0]
            raise OSError(
                f"A node of the cluster lacks a module, {module}: install the extra [cluster] in the environment in which "
                "`ray start` runs there."
            ) from None
        except RayError as error:
            first = str(error).strip().partition("\n")[0]
            raise OSError(f"A unit has failed {1 + RETRIES} times, its worker died each time: {first}") from error
        yield name, result
        send()


def _same_origin(unit: Unit, here: dict[str, Any]) -> Result:
    """Run a unit in a worker, if that computes the same results as the process with the given origin.

    Raises:
        OSError: If code or libraries differ.
    """
    if other := difference(here, origin()):
        raise OSError(f"The node {platform.node()} of the cluster has {other}: results could differ.")
    return run(unit)


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Ignore interrupts during shutdown, which would leave processes behind."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        with contextlib.suppress(TypeError):
            signal.signal(signal.SIGINT, before)


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set environment variables for the duration of the block, unless they are already set."""
    ours = {name: value for name, value in variables.items() if name not in os.environ}
    os.environ.update(ours)
    try:
        yield
    finally:
        for name in ours:
            os.environ.pop(name, None)
