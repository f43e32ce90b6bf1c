"""The record of a batch of episodes: the rows in which each was running."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive


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
    """Of the first episode, shape (T + 1, 5, 5)."""

    def trajectory(self, *, dt: float) -> Drive:
        """Return the first episode."""
        rows = np.concatenate([[0], len(self.way_left) + np.flatnonzero(self.episode == 0)])
        names = ("true_state", "odometry", "estimate", "reference", "command", "clearance")
        time = dt * np.arange(len(rows), dtype=np.float64)
        return Drive(time=time, covariance=self.covariance, **{name: getattr(self, name)[rows] for name in names})


_OPEN_GROUND = ("true_state", "odometry", "estimate", "reference", "command", "is_success")


class Recorder:
    """Collects the rows of running episodes, step by step; call it with what `evaluate.driven` yields."""

    def __init__(self) -> None:
        self._running: list[NDArray[np.intp]] = []
        self._rows: list[list[NDArray[Any]]] = []
        self._covariance: list[NDArray[np.float64]] = []

    def __call__(self, info: dict[str, Any], running: NDArray[np.bool_]) -> None:
        if not self._rows:
            self._names = (*_OPEN_GROUND, *(name for name in ("collision", "clearance") if name in info))
            self._way_left = info.get("way_left", np.full(running.shape, np.nan))
        at = np.flatnonzero(running)
        self._running.append(at)
        self._rows.append([info[name][at] for name in self._names])
        if running[0]:
            self._covariance.append(info["covariance"][0])

    def result(self) -> Record:
        """Return what was collected."""
        starts, *steps = self._running
        newest, before, end = starts.copy(), list[NDArray[np.intp]](), len(starts)
        for at in steps:
            before.append(newest[at])
            newest[at] = np.arange(end, end + len(at))
            end += len(at)
        columns: dict[str, NDArray[Any]] = {"collision": np.zeros(end, np.bool_), "clearance": np.full(end, np.nan)}
        columns |= {
            name: np.concatenate(column) for name, column in zip(self._names, zip(*self._rows, strict=True), strict=True)
        }
        return Record(
            episode=np.concatenate(steps),
            before=np.concatenate(before),
            way_left=self._way_left,
            covariance=np.array(self._covariance),
            **columns,
        )
