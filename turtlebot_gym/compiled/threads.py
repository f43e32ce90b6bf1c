"""Loops on several threads: how many threads, and which Python thread may use them."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

VARIABLE = "TURTLEBOT_GYM_THREADS"
"""Environment variable that limits the threads of a parallel loop."""

TRIAL = 8
"""Steps for which the other number of threads is tried."""
FIRST_TRIAL, LAST_TRIAL = 32, 8192
"""Fewest and most steps between trials. Each trial that changes nothing doubles the wait; steps that take twice the usual time
end it."""


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
    """The threads."""

    @classmethod
    def acquire(cls) -> bool:
        """Return whether the caller may run a parallel loop, and then must `release` it."""
        return cls.limit != 1 and cls.lock.acquire(blocking=False)

    @classmethod
    def count(cls) -> int:
        """Return the number of threads of the parallel loop that the caller may run."""
        return _cores() if cls.limit is None else min(cls.limit, _cores())

    @classmethod
    def release(cls) -> None:
        """Let the next caller run a parallel loop."""
        cls.lock.release()

    @classmethod
    def after_fork(cls) -> None:
        """Drop the parent's lock and threads in a forked child."""
        cls.lock, cls.pool = threading.Lock(), None

    @classmethod
    def run(cls, function: Callable[[int], None], addresses: Sequence[int]) -> None:
        """Call a function of machine code for several addresses at once, the first one on this thread."""
        if cls.pool is None:
            cls.pool = ThreadPoolExecutor(_cores(), "turtlebot_gym")
        others = [cls.pool.submit(function, address) for address in addresses[1:]]
        function(addresses[0])
        for other in others:
            other.result()


class Pace:
    """Chooses one thread or all of them by the measured time of steps, and tries the other choice from time to time.

    All threads are faster on a machine with idle cores, and many times slower on a busy one, above all if they spin. The load
    changes while a program runs. The results are bit-identical.
    """

    def __init__(self) -> None:
        self.parallel = True
        """Whether the next step should run on all threads."""
        self._chosen = True
        self._cost = {True: 0.0, False: 0.0}
        self._usual = math.inf
        self._steps = 0
        self._wait = FIRST_TRIAL

    def tell(self, seconds: float) -> None:
        """Record the wall time, s, of a step that ran as `parallel` says."""
        cost, self._steps = self._cost, self._steps + 1
        if self.parallel == self._chosen:
            cost[self._chosen] += (seconds - cost[self._chosen]) / min(self._steps, TRIAL)
            if self._steps >= (FIRST_TRIAL if cost[self._chosen] > 2.0 * self._usual else self._wait):
                self.parallel, self._steps, cost[not self._chosen] = not self._chosen, 0, 0.0
            return
        if self._steps > 1:  # the first one wakes the threads
            cost[self.parallel] += seconds / (TRIAL - 1)
        if self._steps == TRIAL or cost[self.parallel] > 2.0 * cost[self._chosen]:
            if self._steps == TRIAL and cost[self.parallel] < cost[self._chosen]:
                self._chosen, self._wait = self.parallel, FIRST_TRIAL
            else:
                self._wait = min(2 * self._wait, LAST_TRIAL)
            self.parallel, self._steps, self._usual = self._chosen, 0, cost[self._chosen]


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
