"""How consistent a filter is over many episodes: its NEES and NIS at each step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.estimation.consistency import nees

DEGREES = 3
"""Degrees of freedom of the NEES of a pose, and of the NIS of a measured one."""


class Consistency(NamedTuple):
    """NEES and NIS of n episodes at T + 1 times; NaN where an episode has ended."""

    time: NDArray[np.float64]
    """Shape (T + 1,), s."""
    nees: NDArray[np.float64]
    """Of the pose, shape (n, T + 1); NaN also where the filter states that it has no error."""
    nis: NDArray[np.float64]
    """Of the measured pose, shape (n, T + 1); NaN also at the start and without a measurement. On wheels alone it is 0."""


def pose_nees(
    estimate: NDArray[np.float64], truth: NDArray[np.float64], covariance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the NEES of poses, NaN where the filter states no error; shapes as in `estimation.consistency.nees`."""
    pose = covariance[..., :DEGREES, :DEGREES]
    is_certain = ~(np.linalg.det(pose) > 0.0)
    stated = np.where(is_certain[..., None, None], np.eye(DEGREES), pose)
    return np.where(is_certain, np.nan, nees(estimate, truth, stated, components=DEGREES))


class Consistent:
    """Collects the NEES and the NIS of episodes, step by step; call it with what `evaluate.driven` yields."""

    def __init__(self) -> None:
        self._nees: list[NDArray[np.float64]] = []
        self._nis: list[NDArray[np.float64]] = []

    def __call__(self, info: dict[str, Any], running: NDArray[np.bool_]) -> None:
        values = pose_nees(info["estimate"], info["true_state"], info["covariance"])
        self._nees.append(np.where(running, values, np.nan))
        is_measured = running & np.asarray(info["measured"], np.bool_) & bool(self._nis)  # the start is no prediction
        self._nis.append(np.where(is_measured, info["nis"], np.nan))

    def result(self, dt: float) -> Consistency:
        """Return what was collected in steps of ``dt``, s."""
        time = dt * np.arange(len(self._nees), dtype=np.float64)
        return Consistency(time, np.stack(self._nees, axis=1), np.stack(self._nis, axis=1))


def joined(parts: Sequence[Consistency]) -> Consistency:
    """Return the episodes of several batches, one after the other."""
    longest = max((part.time for part in parts), key=len)

    def padded(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.pad(values, ((0, 0), (0, len(longest) - values.shape[1])), constant_values=np.nan)

    return Consistency(longest, *(np.concatenate([padded(getattr(part, name)) for part in parts]) for name in ("nees", "nis")))
