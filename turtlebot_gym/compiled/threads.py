"""Loops on several threads: how many threads, which Python thread may use them, how they wait, and the loops themselves.

numba would compile a loop with ``prange`` as a whole, once more for each system. The loops here only divide the tiles among the
threads and call a system's serial loop by its address, so one for each kind of scene serves all systems.
"""

from __future__ import annotations

import math
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from turtlebot_gym.compiled.cache import compiled
from turtlebot_gym.kernel import kernel

VARIABLE = "TURTLEBOT_GYM_THREADS"
"""Environment variable that limits the threads of a parallel loop."""

TRIAL = 8
"""Steps for which the other number of threads is tried."""
FIRST_TRIAL, LAST_TRIAL = 32, 8192
"""Fewest and most steps between trials. Each trial that changes nothing doubles the wait; steps that take twice the usual time
end it."""


@cache
def _cores() -> int:
    """Return the number of threads that numba has, which are as many as the process may use cores."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    return (
        int(given)
        if given.isdecimal()
        else len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count() or 1
    )


class Threads:
    """Lets one Python thread at a time run a parallel loop, and none in a child forked after its parent ran one.

    numba's work queue aborts if two Python threads use it, and OpenMP would kill such a child. All others run the
    serial loop, which gives bit-identical results.
    """

    lock = threading.Lock()
    limit: int | None = None
    """Most threads of a parallel loop; None for numba's default."""
    used = False
    lost = False
    pool: ThreadPoolExecutor | None = None
    """Threads of open ground's loops."""
    _numbas = 0

    @classmethod
    def acquire(cls) -> bool:
        """Return whether the caller may run a parallel loop, and then must `release` it."""
        allowed = cls.limit != 1 and not cls.lost and cls.lock.acquire(blocking=False)
        if allowed:
            cls.used = True
            if cls.limit is not None and "numba" in sys.modules:
                import numba

                cls._numbas = numba.get_num_threads()
                numba.set_num_threads(min(cls.limit, cls._numbas))
        return allowed

    @classmethod
    def count(cls) -> int:
        """Return the number of threads of the parallel loop that the caller may run."""
        return _cores() if cls.limit is None else min(cls.limit, _cores())

    @classmethod
    def release(cls) -> None:
        """Let the next caller run a parallel loop."""
        if cls._numbas:
            import numba

            numba.set_num_threads(cls._numbas)
            cls._numbas = 0
        cls.lock.release()

    @classmethod
    def after_fork(cls) -> None:
        """Drop the parent's lock in a forked child."""
        cls.lock, cls.pool = threading.Lock(), None
        cls.lost = cls.used

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
        threads: At least 1; None for numba's default.

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


def address_of(loop: Any, *arguments: Any) -> int:
    """Return the address of a loop's machine code for the types of some arguments; 0 if this numba does not tell."""
    try:
        from turtlebot_gym.compiled import numba_store

        return numba_store.address_of(loop, *arguments)
    except (ImportError, AttributeError):
        return 0


def sizes_of(scenes: Any) -> tuple[int, ...]:
    """Return how many arrays each part of scenes holds; empty if they have no parts."""
    return tuple(map(len, scenes)) if isinstance(scenes, tuple) and scenes and isinstance(scenes[0], tuple) else ()


def _flattening(sizes: tuple[int, ...]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return kernels that join the parts of scenes to one tuple, and divide the tuple again; `parallel_loop` says why."""
    if not sizes:
        return kernel(lambda scenes: scenes), kernel(lambda arrays: arrays)
    if len(sizes) == 1:
        return kernel(lambda scenes: scenes[0][:]), kernel(lambda arrays: (arrays,))
    first, (join_rest, divide_rest) = sizes[0], _flattening(sizes[1:])
    return kernel(lambda scenes: scenes[0][:] + join_rest(scenes[1:])), kernel(
        lambda arrays: (arrays[:first],) + divide_rest(arrays[first:])  # noqa: RUF005
    )


@cache
def parallel_loop(name: str, sizes: tuple[int, ...]) -> Callable[..., None]:
    """Return the loop that divides the tiles of a "step" or a "reset" among the threads.

    Its arguments are the address of a system's loop, the number of parts, and the arguments of that loop. numba passes a tuple
    of arrays to its threads, but no tuple of tuples: scenes with parts, see `sizes_of`, are joined before and divided after.
    """
    from numba import prange

    from turtlebot_gym.intrinsics import call

    join, divide = _flattening(sizes)

    def step(address, parts, actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        arrays = join(scenes)
        for index in prange(parts):
            part = np.int64(index)  # prange counts in unsigned integers; mixed with signed ones they become floats
            some = slice(part * len(tiles) // parts, (part + 1) * len(tiles) // parts)
            state = (tiles[some], keys[some], parameters, waypoints, observations, outcomes, divide(arrays))
            call(address, (actions,) + state)  # noqa: RUF005  # compiled code has no stars

    def reset(
        address, parts, mask, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes
    ):
        arrays = join(scenes)
        for index in prange(parts):
            part = np.int64(index)
            some = slice(part * len(tiles) // parts, (part + 1) * len(tiles) // parts)
            orders, state = (mask, begins, seeds, episodes), (tiles[some], keys[some], parameters, waypoints)
            call(address, orders + state + (observations, outcomes, divide(arrays)))

    return compiled({"step": step, "reset": reset}[name], f"{name}s on all threads", parallel=True)
