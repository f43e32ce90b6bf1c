"""Contenders that take turns: rates by wall time and by CPU seconds, and their ratios to a base in the same rounds.

Other programs disturb all contenders of a round alike. Rates and ratios are medians over the rounds.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from typing import Any, NamedTuple


class Turn(NamedTuple):
    """Duration of a turn."""

    wall: float
    """Wall time, s."""
    cpu: float
    """CPU seconds of all threads."""


class Contender(NamedTuple):
    """One row of the table."""

    run: Callable[[int], Turn]
    """Function that makes a number of calls."""
    size: int
    """Number of environments stepped together."""
    base: str
    """Name of the contender with which it is compared; its own name if it is a base."""


def timed(step: Callable[[int], Any], limit: Callable[[], Any] = nullcontext) -> Callable[[int], Turn]:
    """Return a function that calls a step with 0, 1, 2, ..., within a context of ``limit``, and returns the duration."""

    def run(calls: int) -> Turn:
        with limit():
            wall, cpu = time.perf_counter(), time.process_time()
            for k in range(calls):
                step(k)
            return Turn(time.perf_counter() - wall, time.process_time() - cpu)

    return run


def alternate(runs: Mapping[str, Callable[[int], Turn]], rounds: int, seconds: float) -> dict[str, list[Turn]]:
    """Let contenders take turns, forwards and backwards, and return the turns of each, in time per call.

    Args:
        runs: Function of each contender that makes a number of calls.
        rounds: Number of turns of each.
        seconds: Length of a turn, s of CPU.
    """
    calls = {name: _calls_for(run, seconds) for name, run in runs.items()}
    turns: dict[str, list[Turn]] = {name: [] for name in runs}
    names = list(runs)
    for number in range(rounds):
        for name in names if number % 2 == 0 else reversed(names):
            turns[name].append(Turn(*(max(spent, 1e-9) / calls[name] for spent in runs[name](calls[name]))))
    return turns


def _calls_for(run: Callable[[int], Turn], seconds: float) -> int:
    """Return the number of calls that take so many CPU seconds; the first ones compile."""
    run(1)
    calls, spent = 1, run(1).cpu
    while spent < seconds / 4.0:
        calls *= 2
        spent = run(calls).cpu
    return max(1, round(calls * seconds / spent))


def rates(contenders: Mapping[str, Contender], rounds: int, seconds: float) -> dict[str, dict[str, float]]:
    """Return each contender's steps per second, and their ratios to those of its base.

    Args:
        contenders: By name, including all bases.
        rounds: Number of turns of each.
        seconds: Length of a turn, s of CPU.
    """
    turns = alternate({name: contender.run for name, contender in contenders.items()}, rounds, seconds)
    rows = {}
    for name, (_, size, base) in contenders.items():
        pairs = list(zip(turns[name], turns[base], strict=True))
        rows[name] = {
            "steps_per_second": statistics.median(size / turn.wall for turn in turns[name]),
            "ratio": statistics.median(theirs.wall / mine.wall for mine, theirs in pairs),
            "steps_per_cpu_second": statistics.median(size / turn.cpu for turn in turns[name]),
            "cpu_ratio": statistics.median(theirs.cpu / mine.cpu for mine, theirs in pairs),
        }
    return rows
