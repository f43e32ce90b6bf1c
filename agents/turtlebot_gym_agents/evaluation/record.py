"""The record of a batch of episodes: the rows in which each was running, and how consistent the filter was in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym_agents.evaluation.driving import Moment

DEGREES = 3
"""Degrees of freedom of the NEES of a pose, and of the NIS of a measured one."""
_NAMES = ("true_state", "odometry", "estimate", "reference", "command", "clearance", "is_success", "collision", "way_left")
_Columns = dict[str, NDArray[Any]]


class Record(NamedTuple):
    """Record of n episodes in the order of time: their n starts, and then S steps, each of an episode that was running."""

    number: int
    """Number of episodes, n."""
    episode: NDArray[np.intp]
    """Number of each step's episode, shape (S,)."""
    before: NDArray[np.intp]
    """The row before each step in its episode, shape (S,)."""
    columns: _Columns
    """Infos by their names, shape (n + S, ...); clearance and way_left are NaN on open ground, and nobody collides there."""

    def consistency(self, dt: float) -> Consistency:
        """Return the NEES and the NIS of each episode, if they were recorded, in steps of ``dt``, s."""
        number = np.concatenate([np.arange(self.number), self.episode])
        order, count = np.argsort(number, kind="stable"), np.bincount(number)
        step = np.arange(len(number)) - np.repeat(np.cumsum(count) - count, count)
        tables = np.full((2, len(count), count.max()), np.nan)
        tables[:, number[order], step] = np.array([self.columns["nees"], self.columns["nis"]])[:, order]
        return Consistency(dt * np.arange(count.max(), dtype=np.float64), *tables)


class Consistency(NamedTuple):
    """NEES and NIS of n episodes at T + 1 times; NaN where an episode has ended."""

    time: NDArray[np.float64]
    """Shape (T + 1,), s."""
    nees: NDArray[np.float64]
    """Of the pose, shape (n, T + 1); NaN also where the filter states that it has no error."""
    nis: NDArray[np.float64]
    """Of the measured pose, shape (n, T + 1); NaN also at the start and without a measurement. On wheels alone it is 0."""

    @classmethod
    def joined(cls, parts: Sequence[Consistency]) -> Consistency:
        """Return the episodes of several batches, one after the other."""
        longest = max((part.time for part in parts), key=len)

        def column(name: str) -> NDArray[np.float64]:
            rows = [getattr(part, name) for part in parts]
            pads = [((0, 0), (0, len(longest) - each.shape[1])) for each in rows]
            return np.concatenate([np.pad(each, pad, constant_values=np.nan) for each, pad in zip(rows, pads, strict=True)])

        return cls(longest, column("nees"), column("nis"))


class Recorder:
    """Collects the rows of episodes, with ``consistency`` also NEES and NIS; call it with what `driving.driven` yields."""

    def __init__(self, *, consistency: bool = False) -> None:
        self._consistency = consistency
        self._starts: list[tuple[NDArray[np.intp], _Columns]] = []
        self._steps: list[tuple[NDArray[np.intp], _Columns]] = []

    def __call__(self, moment: Moment) -> None:
        columns = {name: moment.info[name][moment.rows] for name in _NAMES if name in moment.info}
        if self._consistency:
            covariance, measured, nis = (moment.info[name][moment.rows] for name in ("covariance", "measured", "nis"))
            is_certain = ~(np.linalg.det(covariance) > 0.0)
            stated = np.where(is_certain[:, None, None], np.eye(DEGREES), covariance)
            errors = nees(columns["estimate"], columns["true_state"], stated)
            is_measured = np.asarray(measured, np.bool_) & (not moment.is_start)  # the start is no prediction
            columns["nees"] = np.where(is_certain, np.nan, errors)
            columns["nis"] = np.where(is_measured, nis, np.nan)
        (self._starts if moment.is_start else self._steps).append((moment.number, columns))

    def result(self) -> Record:
        """Return what was collected."""
        (number, starts), (episode, steps) = _stacked(self._starts), _stacked(self._steps)
        n, order, at = len(number), np.argsort(number), np.argsort(episode, kind="stable")
        before = np.empty_like(at)
        # In its episode, the row before a step is the step before it, or the start.
        before[at] = np.where(np.diff(episode[at], prepend=-1) > 0, episode[at], n + np.roll(at, 1))
        end = n + len(episode)
        unknown = np.full(end, np.nan)
        open_ground = {"collision": np.zeros(end, np.bool_), "clearance": unknown, "way_left": unknown}
        columns = {name: np.concatenate([starts[name][order], values]) for name, values in steps.items()}
        return Record(n, episode, before, open_ground | columns)


def _stacked(parts: Sequence[tuple[NDArray[np.intp], _Columns]]) -> tuple[NDArray[np.intp], _Columns]:
    rows = {name: np.concatenate([columns[name] for _, columns in parts]) for name in parts[0][1]}
    return np.concatenate([number for number, _ in parts]), rows
