"""Jobs in this process, in processes of this machine by joblib, or on a cluster by Ray.

A job is a function without arguments that can be pickled. Jobs whose worker died are repeated. Jobs are pure functions of their
settings, so their results depend neither on where they run nor on the order in which they finish.
"""

from __future__ import annotations

import platform
import signal
import socket
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from typing import Any, TypeVar

from turtlebot_gym.config import as_int
from turtlebot_gym_agents.cluster.ledger import difference, origin

T = TypeVar("T")
Jobs = Mapping[str, Callable[[], T]]
"""Jobs by name; the name is cited if the job fails."""
Run = Callable[[Jobs[Any]], Iterator[tuple[str, Any]]]
"""`results`, with cluster and workers given."""

RETRIES = 3
"""Retries after the death of a worker."""


def results(jobs: Jobs[T], *, cluster: str | None = None, workers: int | None = None) -> Iterator[tuple[str, T]]:
    """Run jobs, and yield their names and results as they finish.

    Args:
        jobs: The jobs.
        cluster: None for this process; "local" for processes of this machine; "auto" for the Ray cluster that this machine
            belongs to; or the address of a Ray cluster, HOST:PORT.
        workers: With "local": number of processes; None for one per core.

    Raises:
        ValueError: If an argument is invalid, or a job raised ValueError, OSError or ImportError; the message names the job.
        RuntimeError: If a job raised another exception; the message names the job.
        OSError: If there is no such cluster, or workers died again and again.
        ImportError: If joblib or Ray is not installed.
    """
    require_workers(cluster, workers)
    if cluster is None:
        return ((name, _run(name, job)) for name, job in jobs.items())
    return _on_this_machine(jobs, workers) if cluster == "local" else _on_ray(jobs, cluster)


def require_workers(cluster: str | None, workers: int | None) -> None:
    """Raise ValueError unless a number of workers, if there is one, is valid and for processes of this machine."""
    if workers is not None:
        as_int("workers", workers, 1)
        if cluster != "local":
            raise ValueError("workers is the number of processes on this machine: choose --cluster local.")


def _run(name: str, job: Callable[[], T]) -> T:
    try:
        return job()
    except (ValueError, OSError, ImportError) as error:
        raise ValueError(f"{name}: {error}") from error
    except Exception as error:
        raise RuntimeError(f"{name}: {type(error).__name__}: {error}") from error


def _on_this_machine(jobs: Jobs[T], workers: int | None) -> Iterator[tuple[str, T]]:
    try:
        from joblib import Parallel, delayed, parallel_config
    except ModuleNotFoundError as error:
        raise ImportError("The cluster 'local' needs joblib: pip install 'turtlebot-gym[agents]'.") from error
    warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)  # it starts again by itself
    warnings.filterwarnings("ignore", ".*still being processed by the workers", UserWarning)  # when it is interrupted
    missing, reason = dict(jobs), ""
    for _ in range(1 + RETRIES):
        try:
            with parallel_config("loky", inner_max_num_threads=1, initializer=_ignore_interrupts):
                options: Any = {"batch_size": 1, "return_as": "generator_unordered"}
                parallel = Parallel(n_jobs=workers or -1, **options)
                running: Any = parallel(delayed(_named)(name, job) for name, job in list(missing.items()))
            for name, result in running:
                del missing[name]
                yield name, result
            return
        except BrokenExecutor as error:
            reason = str(error).strip().partition("\n")[0]
    raise OSError(f"Workers have died {1 + RETRIES} times: {reason}")


def _ignore_interrupts() -> None:
    """Leave Ctrl-C, which reaches all processes of a terminal, to the process that started the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _named(name: str, job: Callable[[], T]) -> tuple[str, T]:
    return name, _run(name, job)


def _on_ray(jobs: Jobs[T], address: str) -> Iterator[tuple[str, T]]:
    try:
        import ray  # pyright: ignore[reportMissingImports]
        from ray.exceptions import RayError, RayTaskError  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise ImportError(f"The cluster {address!r} needs ray: pip install 'turtlebot-gym[cluster]'.") from error
    if address != "auto":
        _require_listening(address)  # Ray itself would wait for minutes
    ray.init(address, log_to_driver=False, logging_level="ERROR", runtime_env={"env_vars": {"TURTLEBOT_GYM_THREADS": "1"}})
    try:
        task = ray.remote(_run_the_same).options(max_retries=RETRIES)
        waiting = {task.remote(name, job, origin()): name for name, job in jobs.items()}
        while waiting:
            (done, *_), _ = ray.wait(list(waiting))
            yield waiting.pop(done), ray.get(done)
    except RayTaskError as error:
        raise error.cause from None
    except RayError as error:
        raise OSError(f"The cluster {address!r} has failed: {str(error).strip().partition(chr(10))[0]}") from error
    finally:
        ray.shutdown()


def _run_the_same(name: str, job: Callable[[], T], here: Mapping[str, str]) -> T:
    """Run a job on a node that has the code and the libraries of the process that sent it."""
    if other := difference(origin(), here):
        raise OSError(f"The node {platform.node()} has {other}: results could differ.")
    return _run(name, job)


def _require_listening(address: str) -> None:
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or "/" in host:
        raise ValueError(f"cluster must be 'local', 'auto' or HOST:PORT, got {address!r}.")
    try:
        socket.create_connection((host, int(port)), timeout=4.0).close()
    except (OSError, OverflowError) as error:
        raise OSError(f"There is no cluster at {address}: {error}.") from error
