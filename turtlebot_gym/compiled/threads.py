"""How many threads a parallel loop uses, who may run one, and how its threads wait."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from turtlebot_gym.kernel import HAS_NUMBA

VARIABLE = "TURTLEBOT_GYM_THREADS"
"""Environment variable with the greatest number of threads of a parallel loop; without it, numba's own: one for each core."""

# Threads that spin at the end of each step burn a core while they wait for a thread that a busy machine does not run: with the
# default spin a step of 512 environments took 5 ms of CPU instead of 0.06. Without a spin it costs 5 microseconds more than one
# thread at worst. OpenMP reads this when it is loaded: where torch has loaded it before, `Pace` notices what that costs.
os.environ.setdefault("GOMP_SPINCOUNT", "0")

TRIAL = 8
"""Steps for which the other number of threads is tried."""
FIRST_TRIAL, LAST_TRIAL = 32, 8192
"""Fewest and most steps from one trial to the next: each trial that changes nothing doubles them. Steps that have come to take
twice the usual time are a reason for the next one."""


class Threads:
    """Lets one Python thread at a time run a parallel loop, and no child that was forked after its parent ran one.

    numba's work queue aborts under two Python threads, and OpenMP would kill such a child. All others run the serial loop,
    which gives the same bits.
    """

    lock = threading.Lock()
    limit: int | None = None
    """The most threads of a parallel loop; None for numba's own number."""
    used = False
    lost = False
    _numbas = 0

    @classmethod
    def acquire(cls, most: int | None = None) -> bool:
        """Return whether the caller may run a parallel loop, on at most so many threads; it then has to call `release`."""
        allowed = cls.limit != 1 and not cls.lost and cls.lock.acquire(blocking=False)
        if allowed:
            cls.used = True
            most = cls.limit if most is None else most
            if most is not None and HAS_NUMBA:
                import numba

                cls._numbas = numba.get_num_threads()
                numba.set_num_threads(min(most, cls._numbas))
        return allowed

    @classmethod
    def release(cls) -> None:
        """Let the next one run a parallel loop."""
        if cls._numbas:
            import numba

            numba.set_num_threads(cls._numbas)
            cls._numbas = 0
        cls.lock.release()

    @classmethod
    def after_fork(cls) -> None:
        """Forget the parent's lock, in a child."""
        cls.lock = threading.Lock()
        cls.lost = cls.used


class Pace:
    """Chooses between one thread and all of them by the time that steps take, and tries the other choice now and then.

    All threads are faster on a machine that has cores to spare, and many times slower on one that has not, above all where they
    spin. Which of the two holds changes while a program runs. The results are the same to the bit.
    """

    def __init__(self) -> None:
        self.parallel = True
        """Whether the next step is to run on all threads."""
        self._chosen = True
        self._cost = {True: 0.0, False: 0.0}
        self._usual = math.inf
        self._steps = 0
        self._wait = FIRST_TRIAL

    def tell(self, seconds: float) -> None:
        """Take note of the wall time of a step, s, that was made as `parallel` says."""
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
    """Let parallel loops use at most so many threads within this block, in the whole process.

    The results are the same to the bit for every number. One thread is best where other work shares the cores, such as a
    network's updates: more of them cost CPU time there, and gain no wall time.

    Args:
        threads: At least 1; None for numba's own number.

    Raises:
        ValueError: If it is not.
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


def _told() -> int | None:
    """Return the limit that the environment variable sets, if it does."""
    text = os.environ.get(VARIABLE, "")
    if not text:
        return None
    if not text.isdecimal():
        raise ValueError(f"{VARIABLE} must be a whole number, got {text!r}.")
    return _checked(VARIABLE, int(text))


Threads.limit = _told()
os.register_at_fork(after_in_child=Threads.after_fork)
