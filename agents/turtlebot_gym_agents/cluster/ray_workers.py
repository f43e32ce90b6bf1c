"""Units on Ray: a Ray of this command alone on this machine, or a cluster that is there.

A worker that dies costs the unit that it was doing, which is done again elsewhere. What comes back is stored by this process
alone, so that nothing is stored twice.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

from turtlebot_gym_agents.cluster.origin import difference, origin
from turtlebot_gym_agents.cluster.store import Result
from turtlebot_gym_agents.cluster.units import Unit, run
from turtlebot_gym_agents.cluster.work import Workers

PATIENCE = 13.0
"""How long a cluster has to answer, s."""
RETRIES = 3
"""How often a unit is begun again whose worker has died."""
OBJECT_STORE = 100 * 2**20
"""Shared memory of a Ray of our own, bytes; results are small."""
AHEAD = 2
"""Units that wait for each core, so that none is idle while this process stores."""
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_task_oom_retries": str(RETRIES),  # without end by default
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
_LOCAL = {
    **ONE_THREAD,
    # Without it, Ray on Linux takes an address that other machines reach, and listens on all interfaces.
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
}


@contextmanager
def ray_workers(cluster: str, *, workers: int | None = None, memory: int = 0) -> Iterator[Workers]:
    """Connect to a cluster for as long as the block lasts; yields what `work.complete` takes.

    Args:
        cluster: "local", a Ray of our own on this machine, which listens on localhost only; "auto", the cluster that runs on
            this machine; or the address of one, HOST:PORT.
        workers: With "local": processes that work at the same time; one for each core if not told.
        memory: What a unit needs, bytes.

    Raises:
        ImportError: If Ray is not installed.
        ValueError: If an argument is out of its range.
        OSError: If there is no such cluster, or it cannot do the work; the message says why.
    """
    if workers is not None and cluster != "local":
        raise ValueError(f"workers is for the cluster 'local', not for {cluster!r}: it has as many as its nodes have cores.")
    if workers is not None and not workers > 0:
        raise ValueError(f"workers must be positive, got {workers}.")
    os.environ.update(_QUIET)
    if cluster == "local":
        os.environ.update(_LOCAL)
    try:
        import ray
    except ImportError as error:
        raise ImportError("Clusters need Ray: pip install 'turtlebot-gym[cluster]'.") from error
    folder = Path(mkdtemp(prefix="tg-", dir=None if os.name == "nt" else "/tmp")) if cluster == "local" else None
    address = ""
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.CRITICAL}
    try:
        if folder is not None:
            with _told_in_a_line():
                ray.init(
                    address="local",
                    num_cpus=workers,
                    include_dashboard=False,
                    object_store_memory=OBJECT_STORE,
                    _temp_dir=str(folder),  # the default's would stay; sockets need a short path
                    **quiet,
                )
            largest = max(node["Resources"].get("memory", 0.0) for node in ray.nodes())
        else:
            address, nodes = _probe(cluster)
            largest = max(node["memory"] for node in nodes)
        if largest < memory:
            raise OSError(
                f"The cluster {cluster!r} has too little memory: a worker needs {memory / 1e6:,.0f} MB, and its largest node "
                f"gives {largest / 1e6:,.0f} MB."
            )
        if folder is None:
            with _told_in_a_line():
                ray.init(address=address, runtime_env={"env_vars": ONE_THREAD}, **quiet)
        yield lambda units: _results(units, memory)
    finally:
        with _no_interrupt():
            ray.shutdown()
            if folder is not None:
                rmtree(folder, ignore_errors=True)


def _results(units: Iterable[tuple[str, Unit]], memory: int) -> Iterator[tuple[str, Result]]:
    """Yield results as they come, with so many units on their way as keep all cores busy."""
    import ray
    from ray.exceptions import RayError, RayTaskError

    task = ray.remote(_work).options(num_cpus=1, memory=memory, max_retries=RETRIES)
    waiting, names = iter(units), {}

    def send() -> None:
        # The number of cores is asked for again: nodes come and go.
        room = int((1 + AHEAD) * max(1.0, ray.cluster_resources().get("CPU", 1.0))) - len(names)
        for _ in range(room):
            name, unit = next(waiting, (None, None))
            if unit is None:
                return
            names[task.remote(unit)] = name

    send()
    while names:
        (done, *_), _ = ray.wait(list(names), num_returns=1)
        name = names.pop(done)
        try:
            result = ray.get(done)
        except RayTaskError as error:
            cause = error.cause if isinstance(error.cause, (ValueError, OSError, ImportError)) else error
            raise cause from None
        except RayError as error:
            first = str(error).strip().partition("\n")[0]
            raise OSError(f"A unit has failed {1 + RETRIES} times, its worker died each time: {first}") from error
        yield name, result
        send()


def _work(unit: Unit) -> Result:
    """Do a unit in a worker, on one thread: the other cores are for other units."""
    import numba

    numba.set_num_threads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    return run(unit)


def _probe(cluster: str) -> tuple[str, list[dict[str, Any]]]:
    """Return the address and the nodes of a cluster, if it can do the work.

    Raises:
        OSError: If not.
    """
    begun = time.monotonic()
    if cluster != "auto":
        _require_listener(cluster)
    command = [sys.executable, "-m", "turtlebot_gym_agents.cluster.probe", cluster, str(PATIENCE - 3.0)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        out, err = process.communicate(timeout=PATIENCE - (time.monotonic() - begun))
    except subprocess.TimeoutExpired as error:
        raise OSError(f"The cluster {cluster!r} does not answer within {PATIENCE:g} s: is it a Ray cluster?") from error
    finally:
        process.kill()
        process.wait()
    if process.returncode != 0:
        raise OSError(f"The cluster {cluster!r} cannot be used: {_reason(err, cluster)}")
    told = json.loads(out.strip().splitlines()[-1])
    if not told["nodes"]:
        raise OSError(f"The cluster {cluster!r} has no node with a core.")
    for node in told["nodes"]:
        there = node["origin"]
        if there is None:
            raise OSError(f"The node {node['host']} of the cluster does not answer.")
        if "missing" in there:
            raise OSError(
                f"The node {node['host']} of the cluster lacks the module {there['missing']}: install turtlebot-gym[cluster] "
                "in the environment in which `ray start` runs there."
            )
        if other := difference(origin(), there):
            raise OSError(f"The node {node['host']} of the cluster has {other}: results could differ.")
    return told["address"], told["nodes"]


def _require_listener(address: str) -> None:
    """Raise ValueError or OSError unless something listens at an address."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not (colon and host and port.isdigit()) or address.startswith("ray://"):
        raise ValueError(f"cluster must be 'local', 'auto' or HOST:PORT, as `ray start --head` prints it, got {address!r}.")
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, OverflowError) as error:
        raise OSError(f"There is no cluster at {address}: {error}.") from error


def _reason(text: str, cluster: str) -> str:
    """Return the last line of what Ray has said, which is the exception's."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith((" ", "\t", "["))]
    if cluster == "auto" and "ConnectionError" in text:
        return "no Ray runs on this machine; `ray start` makes it part of a cluster, and 'local' needs none."
    errors = [line for line in lines if "Error: " in line]
    return (errors or lines or ["Ray ended without a word."])[-1]


@contextmanager
def _told_in_a_line() -> Iterator[None]:
    """Make a plain OSError of what Ray raises where it cannot begin."""
    try:
        yield
    except (RuntimeError, ValueError, ConnectionError, TimeoutError) as error:
        raise OSError(f"Ray cannot be started: {' '.join(str(error).split())}") from error


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Let nothing interrupt the end, which would leave processes behind."""
    import signal
    import threading

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        with contextlib.suppress(TypeError):
            signal.signal(signal.SIGINT, before)
