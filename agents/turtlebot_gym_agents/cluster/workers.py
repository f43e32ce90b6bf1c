"""Jobs in this process, in processes of this machine by joblib, or on a cluster by Ray.

A job is a function without arguments that can be pickled. Its result depends neither on where it runs nor on the other jobs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from turtlebot_gym.config import as_int

T = TypeVar("T")


def run(jobs: Sequence[Callable[[], T]], cluster: str | None = None, workers: int | None = None) -> list[T]:
    """Return the results of jobs, in their order.

    ``cluster`` is None for this process, "local" for processes of this machine, as many as ``workers`` or one per core, "auto"
    for the Ray cluster that this machine belongs to, or the address of a Ray cluster, HOST:PORT.
    """
    if workers is not None:
        as_int("workers", workers, 1)
        if cluster != "local":
            raise ValueError("workers is the number of processes on this machine: choose --cluster local.")
    if cluster is None:
        return [job() for job in jobs]
    library = "joblib" if cluster == "local" else "ray"
    try:
        from joblib import Parallel, delayed, parallel_config

        backend: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1}
        if cluster != "local":
            import ray  # pyright: ignore[reportMissingImports]
            from ray.util.joblib import register_ray  # pyright: ignore[reportMissingImports]

            ray.init(cluster, ignore_reinit_error=True, runtime_env={"env_vars": {"TURTLEBOT_GYM_THREADS": "1"}})
            register_ray()
            backend = {"backend": "ray"}
    except ModuleNotFoundError as error:
        raise ImportError(f"The cluster {cluster!r} needs {library}: pip install {library}.") from error
    with parallel_config(**backend):
        done: Any = Parallel(n_jobs=workers or -1)(delayed(job)() for job in jobs)
    return done
