"""Jobs in this process, in processes of this machine by joblib, or on a cluster by Ray.

A job is a function without arguments that can be pickled. Its result depends neither on where it runs nor on the other jobs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from turtlebot_gym.config import as_int

T = TypeVar("T")


def run(jobs: Sequence[Callable[[], T]], *, cluster: str | None = None, workers: int | None = None) -> list[T]:
    """Return the results of jobs, in their order.

    Args:
        jobs: The jobs.
        cluster: None for this process; "local" for processes of this machine; "auto" for the Ray cluster that this machine
            belongs to; or the address of a Ray cluster, HOST:PORT.
        workers: With "local": number of processes; None for one per core.

    Raises:
        ValueError: If workers are given without "local".
        ImportError: If joblib or Ray is not installed.
    """
    if workers is not None:
        as_int("workers", workers, 1)
        if cluster != "local":
            raise ValueError("workers is the number of processes on this machine: choose --cluster local.")
    if cluster is None:
        return [job() for job in jobs]
    try:
        from joblib import Parallel, delayed, parallel_config
    except ModuleNotFoundError as error:
        raise ImportError(f"The cluster {cluster!r} needs joblib: pip install 'turtlebot-gym[agents]'.") from error
    backend: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1}
    if cluster != "local":
        try:
            import ray  # pyright: ignore[reportMissingImports]
            from ray.util.joblib import register_ray  # pyright: ignore[reportMissingImports]
        except ModuleNotFoundError as error:
            raise ImportError(f"The cluster {cluster!r} needs ray: pip install 'turtlebot-gym[cluster]'.") from error
        ray.init(cluster, ignore_reinit_error=True, runtime_env={"env_vars": {"TURTLEBOT_GYM_THREADS": "1"}})
        register_ray()
        backend = {"backend": "ray"}
    with parallel_config(**backend):
        done: Any = Parallel(n_jobs=workers or -1)(delayed(job)() for job in jobs)
    return done
