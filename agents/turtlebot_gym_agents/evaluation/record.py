"""The record of a batch of episodes: the rows in which each was running."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.evaluation.driving import Moment


class Record(NamedTuple):
    """Record of n episodes in the order of time: their n starts, and then S steps, each of an episode that was running."""

    episode: NDArray[np.intp]
    """Number of each step's episode, shape (S,)."""
    before: NDArray[np.intp]
    """The row before each step in its episode, shape (S,)."""
    true_state: NDArray[np.float64]
    """Shape (n + S, 5), of ``info`` like the next ones."""
    odometry: NDArray[np.float64]
    estimate: NDArray[np.float64]
    reference: NDArray[np.float64]
    command: NDArray[np.float64]
    is_success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    """False on open ground."""
    clearance: NDArray[np.float64]
    """NaN on open ground, like the next field."""
    way_left: NDArray[np.float64]
    """At the starts, shape (n,)."""
    covariance: NDArray[np.float64]
    """Of the first episode, shape (T + 1, 3, 3)."""

    def trajectory(self, *, dt: float) -> Drive:
        """Return the first episode."""
        rows = np.concatenate([[0], len(self.way_left) + np.flatnonzero(self.episode == 0)])
        names = ("true_state", "odometry", "estimate", "reference", "command", "clearance")
        time = dt * np.arange(len(rows), dtype=np.float64)
        return Drive(time=time, covariance=self.covariance, **{name: getattr(self, name)[rows] for name in names})


_OPEN_GROUND = ("true_state", "odometry", "estimate", "reference", "command", "is_success")


class Recorder:
    """Collects the rows of episodes; call it with what `driving.driven` yields.

    Args:
        episodes: Number of episodes.
    """

    def __init__(self, episodes: int) -> None:
        self._episodes = episodes
        self._starts: list[tuple[NDArray[np.intp], list[NDArray[Any]]]] = []
        self._steps: list[tuple[NDArray[np.intp], list[NDArray[Any]]]] = []
        self._covariance: list[NDArray[np.float64]] = []

    def __call__(self, moment: Moment) -> None:
        info, rows = moment.info, moment.rows
        if not self._starts:
            self._names = (*_OPEN_GROUND, *(name for name in ("collision", "clearance") if name in info))
        values = [info[name][rows] for name in self._names]
        if moment.is_start:
            self._starts.append(
                (moment.number, [*values, info["way_left"][rows] if "way_left" in info else 0.0 * rows + np.nan])
            )
        else:
            self._steps.append((moment.number, values))
        if len(moment.number) and moment.number[0] == 0:
            self._covariance.append(info["covariance"][rows[0]])

    def result(self) -> Record:
        """Return what was collected."""
        n = self._episodes
        order = np.argsort(np.concatenate([number for number, _ in self._starts]))
        *starts, way_left = (np.concatenate(column)[order] for column in zip(*(each for _, each in self._starts), strict=True))
        newest, before, end = np.arange(n), list[NDArray[np.intp]](), n
        for number, _ in self._steps:
            before.append(newest[number])
            newest[number] = np.arange(end, end + len(number))
            end += len(number)
        columns: dict[str, NDArray[Any]] = {"collision": np.zeros(end, np.bool_), "clearance": np.full(end, np.nan)}
        steps = zip(*(each for _, each in self._steps), strict=True)
        columns |= {
            name: np.concatenate([start, *column]) for name, start, column in zip(self._names, starts, steps, strict=True)
        }
        return Record(
            episode=np.concatenate([number for number, _ in self._steps]),
            before=np.concatenate(before),
            way_left=way_left,
            covariance=np.array(self._covariance),
            **columns,
        )
