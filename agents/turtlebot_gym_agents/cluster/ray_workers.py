"""Units on Ray: a private Ray on this machine, or an existing cluster.

If a worker dies, its unit is repeated elsewhere. Only this process stores results, so that nothing is stored twice.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from secrets import token_hex
from shutil import rmtree
from tempfile import mkdtemp

from turtlebot_gym_agents.cluster.access import access, probe
from turtlebot_gym_agents.cluster.store import Result
from turtlebot_gym_agents.cluster.units import Unit, run
from turtlebot_gym_agents.cluster.work import Workers

RETRIES = 3
"""Retries of a unit whose worker died."""
OBJECT_STORE = 100 * 2**20
"""Shared memory of a private Ray, bytes; results are small."""
AHEAD = 2
"""Units queued per core, so that none is idle while this process stores results."""
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_task_oom_retries": str(RETRIES),  # unlimited by default
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
_ALONE = {
    **ONE_THREAD,
    # Without it, Ray on Linux uses an address that other machines can reach, and listens on all interfaces.
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    # Other users of this machine must not run code here; by default Ray would leave a token in the home folder.
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": token_hex(32),
}


@contextmanager
def ray_workers(cluster: str, *, workers: int | None = None, memory: int = 0) -> Iterator[Workers]:
    """Connect to a cluster for the duration of the block; yields workers for `work.complete`.

    Args:
        cluster: "local", a private Ray on this machine that listens on localhost only; "auto", the cluster that runs on this
            machine; or a cluster's address, HOST:PORT.
        workers: With "local": number of worker processes; None for one per core.
        memory: Memory of a unit, bytes.

    Raises:
        ImportError: If Ray is not installed.
        ValueError: If an argument is out of its range.
        OSError: If there is no such cluster, or it cannot do the work; the message says why.
    """
    if workers is not None and cluster != "local":
        raise ValueError(f"workers is for the cluster 'local', not for {cluster!r}: it has as many as its nodes have cores.")
    if workers is not None and not workers > 0:
        raise ValueError(f"workers must be positive, got {workers}.")
    if find_spec("ray") is None:
        raise ImportError("Clusters need Ray: pip install 'turtlebot-gym[cluster]'.")
    variables = {**_QUIET, **_ALONE} if cluster == "local" else {**_QUIET, **access()}
    connected = _own_ray(workers, memory) if cluster == "local" else _cluster(cluster, memory)
    with _environment(variables), connected:  # Ray reads them when it is imported
        yield lambda units: _results(units, memory)


@contextmanager
def _own_ray(workers: int | None, memory: int) -> Iterator[None]:
    """Start Ray on this machine, and stop it at the end."""
    import ray  # pyright: ignore[reportMissingImports]

    folder = Path(mkdtemp(prefix="tg-", dir=None if os.name == "nt" else "/tmp"))  # sockets need a short path
    try:
        with _told_in_a_line():
            ray.init(
                address="local",
                num_cpus=workers,
                include_dashboard=False,
                object_store_memory=OBJECT_STORE,
                log_to_driver=False,
                logging_level=logging.CRITICAL,
                _temp_dir=str(folder),  # the default folder would remain
            )
        (node,) = ray.nodes()
        if node["NodeManagerAddress"] != "127.0.0.1":
            raise OSError(
                f"Ray listens on {node['NodeManagerAddress']}, not on localhost alone: it was imported before "
                "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER=0 was set."
            )
        _require_memory("local", node["Resources"].get("memory", 0.0), memory)
        yield
    finally:
        with _no_interrupt():
            ray.shutdown()
            rmtree(folder, ignore_errors=True)


@contextmanager
def _cluster(name: str, memory: int) -> Iterator[None]:
    """Connect to an existing cluster."""
    import ray  # pyright: ignore[reportMissingImports]

    address, nodes = probe(name)
    _require_memory(name, max(node["memory"] for node in nodes), memory)
    try:
        with _told_in_a_line():
            ray.init(
                address=address,
                runtime_env={"env_vars": ONE_THREAD},
                log_to_driver=False,
                logging_level=logging.CRITICAL,
            )
        yield
    finally:
        with _no_interrupt():
            ray.shutdown()


def _require_memory(cluster: str, largest: float, memory: int) -> None:
    """Raise OSError if no node has the memory for a unit, which would then wait forever."""
    if largest < memory:
        raise OSError(
            f"The cluster {cluster!r} has too little memory: a worker needs {memory / 1e6:,.0f} MB, and its largest node gives "
            f"{largest / 1e6:,.0f} MB."
        )


def _results(units: Iterable[tuple[str, Unit]], memory: int) -> Iterator[tuple[str, Result]]:
    """Yield results as they arrive, with enough units submitted to keep all cores busy."""
    import ray  # pyright: ignore[reportMissingImports]
    from ray.exceptions import RayError, RayTaskError  # pyright: ignore[reportMissingImports]

    task = ray.remote(_work).options(num_cpus=1, memory=memory, max_retries=RETRIES)
    waiting, names = iter(units), {}

    def send() -> None:
        # Query the number of cores each time: nodes come and go.
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
    """Run a unit in a worker on one thread; the other cores are for other units."""
    import numba

    numba.set_num_threads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    return run(unit)


@contextmanager
def _told_in_a_line() -> Iterator[None]:
    """Turn Ray's errors at its start into a one-line OSError."""
    try:
        yield
    except (RuntimeError, ValueError, ConnectionError, TimeoutError) as error:
        raise OSError(f"Ray cannot be started: {' '.join(str(error).split())}") from error


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
