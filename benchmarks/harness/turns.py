"""Contenders that take turns: rates by wall time and by CPU seconds, and their ratios to a base in the same rounds.

Other programs disturb all contenders of a round alike. Rates and ratios are medians over the rounds.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, NamedTuple

from harness.machine import Watch


class Turn(NamedTuple):
    """Duration of a turn."""

    wall: float
    """Wall time, s."""
    cpu: float
    """CPU seconds of all threads."""


@dataclass(frozen=True, kw_only=True)
class Contender:
    """One row of the table."""

    run: Callable[[int], Turn]
    """Function that makes a number of calls."""
    size: int
    """Number of environments stepped together."""
    base: str
    """Name of the contender with which it is compared; its own name if it is a base."""
    by: str
    """Library of the environment: turtlebot_gym or gymnasium."""
    threads: int | None = None
    """Limit on the number of threads; None for no limit."""
    key: bool = False
    """Whether it is also measured beside busy processes."""


class Row(NamedTuple):
    """Medians of a contender's turns."""

    by: str
    """Library of the environment."""
    size: int
    """Environments that are stepped together."""
    threads: int | None
    """Limit on the number of threads."""
    base: str
    """Contender with which it is compared."""
    steps_per_second: float
    """Rate by wall time."""
    steps_per_cpu_second: float
    """Rate by CPU seconds of all threads."""
    ratio: float
    """Ratio of the rate by wall time to the base's in the same round."""
    cpu_ratio: float
    """The same ratio of rates by CPU seconds."""
    ratio_range: tuple[float, float]
    """Least and greatest `ratio` over the rounds."""


class Sitting(NamedTuple):
    """Result of contenders that took turns."""

    environments: dict[str, Row]
    """A row for each contender."""
    used_by_others: float | None
    """Mean number of cores that other programs kept busy meanwhile; None if unknown."""


def timed(step: Callable[[int], Any], limit: Callable[[], Any] = nullcontext) -> Callable[[int], Turn]:
    """Return a function that makes a number of calls in this process and returns their duration.

    Args:
        step: Called with 0, 1, 2, ...
        limit: Returns a context for the calls.
    """

    def run(calls: int) -> Turn:
        with limit():
            wall, cpu = time.perf_counter(), time.process_time()
            for k in range(calls):
                step(k)
            return Turn(time.perf_counter() - wall, time.process_time() - cpu)

    return run


def calls_for(run: Callable[[int], Turn], seconds: float) -> int:
    """Return the number of calls that a contender makes in about ``seconds`` of wall time; the first calls compile."""
    run(1)
    calls, wall = 1, run(1).wall
    while wall < seconds / 4.0:
        calls *= 2
        wall = run(calls).wall
    return max(1, round(calls * seconds / wall))


def take_turns(
    contenders: Mapping[str, Contender],
    *,
    rounds: int,
    seconds: float,
    progress: Callable[[int], None] = lambda turns: None,
) -> Sitting:
    """Let contenders take turns, forwards and backwards, and return their rates.

    Args:
        contenders: Contender of each row, including all bases.
        rounds: Number of turns of each.
        seconds: Length of a turn, s.
        progress: Called with the number of finished turns.
    """
    calls = {name: calls_for(contender.run, seconds) for name, contender in contenders.items()}
    watch = Watch()
    turns = alternate({name: contender.run for name, contender in contenders.items()}, calls, rounds, progress)
    own = sum(turn.cpu for of_one in turns.values() for turn in of_one)
    return Sitting(rows_of(contenders, calls, turns), watch.used_by_others(own))


def alternate(
    runs: Mapping[str, Callable[[int], Turn]],
    calls: Mapping[str, int],
    rounds: int,
    progress: Callable[[int], None] = lambda turns: None,
) -> dict[str, list[Turn]]:
    """Return the turns of each contender, which follow each other forwards and backwards.

    Args:
        runs: Function of each contender that makes a number of calls.
        calls: Number of calls per turn of each.
        rounds: Number of turns of each.
        progress: Called with the number of finished turns.
    """
    turns: dict[str, list[Turn]] = {name: [] for name in runs}
    names, done = list(runs), 0
    for number in range(rounds):
        for name in names if number % 2 == 0 else reversed(names):
            turns[name].append(runs[name](calls[name]))
            progress(done := done + 1)
    return turns


def rows_of(
    contenders: Mapping[str, Contender], calls: Mapping[str, int], turns: Mapping[str, Sequence[Turn]]
) -> dict[str, Row]:
    """Return the medians of turns.

    Args:
        contenders: Contender of each row.
        calls: Number of calls per turn of each.
        turns: The turns of each, in the order of the rounds.
    """
    rates = {
        name: [Turn(*(calls[name] * contender.size / max(spent, 1e-9) for spent in turn)) for turn in turns[name]]
        for name, contender in contenders.items()
    }
    rows = {}
    for name, contender in contenders.items():
        pairs = list(zip(rates[name], rates[contender.base], strict=True))
        ratios = [mine.wall / base.wall for mine, base in pairs]
        rows[name] = Row(
            by=contender.by,
            size=contender.size,
            threads=contender.threads,
            base=contender.base,
            steps_per_second=statistics.median(rate.wall for rate in rates[name]),
            steps_per_cpu_second=statistics.median(rate.cpu for rate in rates[name]),
            ratio=statistics.median(ratios),
            cpu_ratio=statistics.median(mine.cpu / base.cpu for mine, base in pairs),
            ratio_range=(min(ratios), max(ratios)),
        )
    return rows
