"""Loops over tiles on several threads, with bit-identical results for every number of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

from turtlebot_gym.compiled.program import Call, Program, address_of

VARIABLE = "TURTLEBOT_GYM_THREADS"
"""Environment variable that limits the threads of a parallel loop."""
limit: int | None = None
"""Most threads of a parallel loop; None for as many as cores."""
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Number of cores that the process may use."""


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(CORES, "turtlebot_gym")


os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of its parent's threads


def count() -> int:
    """Return the number of threads of a parallel loop."""
    return CORES if limit is None else min(limit, CORES)


class TileLoop:
    """A loop over tiles, on one thread or several.

    Args:
        loop: ``loop(first, last, *arguments)`` runs it over some tiles, and returns a number.
        tiles: Number of tiles.
        changing: Arguments that differ from call to call; compiled loops take the others from the first call.
        is_parallel: Whether several threads may share the tiles.
    """

    def __init__(self, loop: Callable[..., int], tiles: int, changing: Sequence[int], *, is_parallel: bool) -> None:
        self._loop, self._tiles, self._changing, self._is_parallel = loop, tiles, changing, is_parallel
        self._calls: dict[Any, list[Call]] = {}

    def __call__(self, *arguments: Any) -> int:
        """Run the loop, and return the sum of its numbers; a loop that cannot be translated has not run."""
        loop, parts = self._loop, count() if self._is_parallel else 1
        if not isinstance(loop, Program):
            return loop(0, self._tiles, *arguments)
        key = parts, arguments[-2].strides  # outcomes are copies, or parts of whole tiles
        calls = self._calls.get(key)
        if calls is None:
            bounds = [part * self._tiles // parts for part in range(parts + 1)]
            calls = self._calls[key] = [Call(loop, (*bounds[part : part + 2], *arguments)) for part in range(parts)]
        for at in self._changing:
            value = arguments[at]
            word = value if isinstance(value, int) else address_of(value)
            for call in calls:
                call.put(2 + at, word)
        running = [_pool().submit(call.count) for call in calls[1:]]
        return calls[0].count() + sum(each.result() for each in running)

    def again(self) -> Callable[[], int] | None:
        """Return a function that runs a compiled loop on one thread with the arguments of the last call."""
        return next((calls[0].count for calls in self._calls.values() if len(calls) == 1), None)


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
    global limit
    if threads is not None and not threads >= 1:
        raise ValueError(f"threads must be at least 1, got {threads!r}.")
    before, limit = limit, threads
    try:
        yield
    finally:
        limit = before


if text := os.environ.get(VARIABLE):
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"{VARIABLE} must be a whole number from 1 on, got {text!r}.")
    limit = int(text)
