"""Loops on several threads: how many threads, and which Python thread may use them."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

VARIABLE = "TURTLEBOT_GYM_THREADS"
"""Environment variable that limits the threads of a parallel loop."""


@cache
def _cores() -> int:
    """Return the number of cores that the process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Lets one Python thread at a time run a parallel loop; all others run the serial one, with bit-identical results."""

    lock = threading.Lock()
    limit: int | None = None
    """Most threads of a parallel loop; None for as many as cores."""
    pool: ThreadPoolExecutor | None = None

    @classmethod
    def count(cls) -> int:
        """Return the most threads of a parallel loop."""
        return _cores() if cls.limit is None else min(cls.limit, _cores())

    @classmethod
    @contextmanager
    def taken(cls) -> Iterator[int]:
        """Let the caller use some threads for a while, and yield how many: one if others use them."""
        if cls.count() > 1 and cls.lock.acquire(blocking=False):
            try:
                yield cls.count()
            finally:
                cls.lock.release()
        else:
            yield 1

    @classmethod
    def run(cls, functions: Sequence[Callable[[], int]]) -> list[int]:
        """Call functions of machine code at once, the first one on this thread, and return what they return."""
        first, *others = functions
        if not others:
            return [first()]
        if cls.pool is None:
            cls.pool = ThreadPoolExecutor(_cores(), "turtlebot_gym")
        running = [cls.pool.submit(function) for function in others]
        return [first(), *(other.result() for other in running)]

    @classmethod
    def after_fork(cls) -> None:
        """Drop the parent's lock and threads in a forked child."""
        cls.lock, cls.pool = threading.Lock(), None


@contextmanager
def limited(threads: int | None) -> Iterator[None]:
    """Limit the threads of parallel loops within this block, in the whole process.

    Results are bit-identical for every number of threads. One thread is best if other work, such as a network's
    updates, shares the cores: more threads then cost CPU time and gain no wall time.

    Args:
        threads: At least 1; None for as many as cores.

    Raises:
        ValueError: If ``threads`` is below 1.
    """
    before, Threads.limit = Threads.limit, _checked("threads", threads)
    try:
        yield
    finally:
        Threads.limit = before


def _checked(name: str, threads: int | None) -> int | None:
    if threads is not None and not threads >= 1:
        raise ValueError(f"{name} must be at least 1, got {threads!r}.")
    return threads


def _limit_given() -> int | None:
    text = os.environ.get(VARIABLE, "")
    if not text:
        return None
    if not text.isdecimal():
        raise ValueError(f"{VARIABLE} must be a whole number, got {text!r}.")
    return _checked(VARIABLE, int(text))


Threads.limit = _limit_given()
os.register_at_fork(after_in_child=Threads.after_fork)
