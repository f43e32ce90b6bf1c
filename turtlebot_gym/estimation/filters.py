"""The filter for a tuning; and a filter as an object, which interactive use, deployed policies and tests step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import POSITIVE, choose, refusal
from turtlebot_gym.estimation.ekf import DEAD_RECKONING, EXTENDED_KALMAN, GATED
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.tutorial import TUTORIAL
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import ORIGIN, STOP, Belief, Command, Covariance, Odometry, Pose, Senses

FILTERS = {type(known.kind): known for known in (EXTENDED_KALMAN, DEAD_RECKONING, GATED, TUTORIAL)}
"""Filters by the class of their own numbers."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter for a tuning; a class of numbers from elsewhere names its filter as its attribute ``filter``.

    A ``ValueError`` refuses a kind that belongs to no filter.
    """
    found = FILTERS.get(type(tuning.kind)) or getattr(tuning.kind, "filter", None)
    if not isinstance(found, Filter):
        known = ", ".join(kind.__name__ for kind in FILTERS)
        raise refusal("FilterTuning.kind", f"one of {known}, or have a Filter as its attribute 'filter'", tuning.kind)
    return found


def matrix(covariance: ArrayLike) -> NDArray[Any]:
    """Return the covariance of a pose as a matrix (3, 3), from the numbers of a `Covariance` or arrays of each."""
    xx, xy, xt, yy, yt, tt = np.asarray(covariance)[:6]
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])


def covariance_of(P: NDArray[np.float64]) -> Covariance:
    """Return the covariance of a pose and the variances of the twist in a symmetric matrix (5, 5)."""
    return Covariance(*P[[0, 0, 0, 1, 1, 2, 3, 4], [0, 1, 2, 1, 2, 2, 3, 4]].tolist())


class FilterObject:
    """A filter of any kind as an object, which does in a `step` what environments and nodes do in a control interval, s."""

    def __init__(self, tuning: FilterTuning, *, dt: float = 0.1, integrator: str = "euler") -> None:
        self.tuning, self._filter = tuning, filter_of(tuning)
        self.dt, self._integrator = POSITIVE.check("dt", dt), choose("integrator", integrator, INTEGRATORS)
        self.start(ORIGIN)
        self._odometry: Pose | None = None

    @property
    def belief(self) -> Belief:
        return self.estimate.belief

    @property
    def nis(self) -> float:
        """Normalized innovation squared of the last measurement; for a correct filter, chi-square with 3 degrees of freedom."""
        return self.estimate.nis

    def start(self, odometry: Pose) -> None:
        """Restart from a first measurement, or as the tuning says."""
        self._odometry = Pose(*odometry)
        self.estimate: Any = self._filter.start(Senses(Odometry(self._odometry, STOP, True)), self.tuning)

    def step(self, command: Command, odometry: Pose | None = None) -> None:
        """Predict with the command that holds from now on, and correct, gate included; None if no odometry arrived."""
        mean, last = self.belief.mean, self._odometry
        z = Pose(*odometry) if odometry is not None else last or Pose(mean.x, mean.y, mean.theta)
        before, senses = (Senses(Odometry(pose, Command(*command), odometry is not None)) for pose in (last or z, z))
        self.estimate = self._filter.step(self.estimate, before, senses, self.tuning, self.dt, self._integrator)
        self._odometry = z
