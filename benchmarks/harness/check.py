"""A guard against speed regressions: compare measured ratios with those in a file.

Ratios of scalar environments and of one thread are judged by CPU seconds, which also hold on a busy machine. Ratios of all
threads are judged by wall time, and only if other programs leave the cores free, since the time that threads wait for a core
says nothing about the code.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from harness.environments import OURS
from harness.turns import Row
from turtlebot_gym.files import load

TOLERANCE = 0.25
"""Tolerated loss of a ratio, as a share of it."""
FREE = 0.9
"""Share of the cores that other programs must leave free for threads to be judged."""


class Verdict(NamedTuple):
    """Verdict on one ratio."""

    name: str
    """Contender."""
    clock: Literal["CPU seconds", "wall time"]
    """Clock by which the ratio is judged."""
    before: float
    """Ratio in the file."""
    now: float | None
    """Measured ratio; None if it was not measured."""
    state: Literal["ok", "LOST", "left out"]
    """Whether it is worse than the tolerance allows; left out if the machine is too busy to tell."""

    def __str__(self) -> str:
        """Return the verdict as one line."""
        if self.state == "left out":
            return f"left out  {self.name}: other programs keep the cores busy"
        if self.now is None:
            return f"LOST      {self.name}: is no longer measured"
        change = f"{100.0 * (self.now / self.before - 1.0):+.0f} %"
        return f"{self.state:9} {self.name}: {self.now:.2f} times CartPole, {self.before:.2f} before ({change}, {self.clock})"


def free(used_by_others: float | None, cores: int) -> bool:
    """Return whether threads can be judged; true if the use by others is unknown."""
    return used_by_others is None or used_by_others <= (1.0 - FREE) * cores


def judge(
    before: Mapping[str, Mapping[str, Any]], now: Mapping[str, Row], *, quiet: bool, tolerance: float = TOLERANCE
) -> list[Verdict]:
    """Return a verdict on each of this package's ratios in a file.

    Args:
        before: Rows of the file, by name.
        now: Rows that were measured.
        quiet: Whether threads can be judged.
        tolerance: Tolerated loss of a ratio, as a share of it, in [0, 1).

    Raises:
        ValueError: If the file has no ratio of this package.
    """
    ours = {name: row for name, row in before.items() if row["by"] == OURS}
    if not ours:
        raise ValueError("The file must hold this package's ratios: make it with `python -m harness.measure --json FILE`.")
    verdicts = []
    for name, row in ours.items():
        single = row["size"] == 1 or row["threads"] == 1
        key = "cpu_ratio" if single else "ratio"
        measured = None if name not in now else getattr(now[name], key)
        if measured is not None and not single and not quiet:
            state = "left out"
        else:
            state = "ok" if measured is not None and measured >= (1.0 - tolerance) * row[key] else "LOST"
        verdicts.append(Verdict(name, "CPU seconds" if single else "wall time", row[key], measured, state))
    return verdicts


def lost(verdicts: Iterable[Verdict]) -> list[str]:
    """Return the names of the contenders that got slower."""
    return [verdict.name for verdict in verdicts if verdict.state == "LOST"]


def read(path: Path) -> dict[str, Any]:
    """Return the result in a file written by `python -m harness.measure --json`.

    Raises:
        ValueError: If it is another file.
    """
    try:
        result = load(path)
        for row in result["environments"].values():
            if not {"by", "size", "threads", "base", "ratio", "cpu_ratio"} <= row.keys():
                raise KeyError
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} must be a file that `python -m harness.measure --json` has written.") from error
    return result


def elsewhere(before: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """Describe differences between a file's machine and this one that may affect ratios; None if there are none."""
    differing = [key for key in ("cpu", "cores", "llvmlite", "numpy", "gymnasium") if before.get(key) != now.get(key)]
    differences = ", ".join(f"{key} {before.get(key)} there and {now.get(key)} here" for key in differing)
    return f"The file comes from elsewhere, and ratios differ between machines: {differences}." if differences else None
