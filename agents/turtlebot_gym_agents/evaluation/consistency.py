"""How consistent a filter is over many episodes: its NEES and NIS at each step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym_agents.evaluation.driving import Moment

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
    is_certain = ~(np.linalg.det(covariance) > 0.0)
    stated = np.where(is_certain[..., None, None], np.eye(DEGREES), covariance)
    return np.where(is_certain, np.nan, nees(estimate, truth, stated))


class Consistent:
    """Collects the NEES and the NIS of episodes; call it with what `driving.driven` yields."""

    def __init__(self) -> None:
        self._moments: list[tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]] = []

    def __call__(self, moment: Moment) -> None:
        info = {name: moment.info[name][moment.rows] for name in ("estimate", "true_state", "covariance", "measured", "nis")}
        is_measured = np.asarray(info["measured"], np.bool_) & (not moment.is_start)  # the start is no prediction
        values = pose_nees(info["estimate"], info["true_state"], info["covariance"])
        self._moments.append((moment.number, values, np.where(is_measured, info["nis"], np.nan)))

    def result(self, dt: float) -> Consistency:
        """Return what was collected in steps of ``dt``, s."""
        number, *collected = (np.concatenate(column) for column in zip(*self._moments, strict=True))
        order, count = np.argsort(number, kind="stable"), np.bincount(number)
        step = np.arange(len(number)) - np.repeat(np.cumsum(count) - count, count)
        tables = np.full((2, len(count), count.max()), np.nan)
        tables[:, number[order], step] = np.array(collected)[:, order]
        return Consistency(dt * np.arange(count.max(), dtype=np.float64), *tables)


def joined(parts: Sequence[Consistency]) -> Consistency:
    """Return the episodes of several batches, one after the other."""
    longest = max((part.time for part in parts), key=len)

    def padded(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.pad(values, ((0, 0), (0, len(longest) - values.shape[1])), constant_values=np.nan)

    return Consistency(longest, *(np.concatenate([padded(getattr(part, name)) for part in parts]) for name in ("nees", "nis")))
