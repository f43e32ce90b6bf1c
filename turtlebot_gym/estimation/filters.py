"""The filter for a tuning; and filters as objects with inspectable state.

Environments and nodes call a filter's functions; the objects are for interactive use, notebooks and tests.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import FINITE, POSITIVE, Numbers, choose, refusal
from turtlebot_gym.estimation.ekf import DEAD_RECKONING, EXTENDED_KALMAN, GATED, Estimate
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.tutorial import TUTORIAL
from turtlebot_gym.models.unicycle import INTEGRATORS, Integrator, motion
from turtlebot_gym.parameters import FilterTuning, Gate
from turtlebot_gym.values import ORIGIN, STOP, Belief, Command, Covariance, Odometry, Pose, Senses, State

PLACES = np.array([0, 0, 0, 1, 1, 2, 3, 4]), np.array([0, 1, 2, 1, 2, 2, 3, 4])
"""Rows and columns of a `Covariance` in the matrix (5, 5)."""

FILTERS = {type(known.kind): known for known in (EXTENDED_KALMAN, DEAD_RECKONING, GATED, TUTORIAL)}
"""Filters by the class of their own numbers."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter for a tuning; a class of numbers from elsewhere names its filter as its attribute ``filter``.

    Raises:
        ValueError: If its kind belongs to no filter.
    """
    brought = getattr(tuning.kind, "filter", None)
    if not isinstance(brought, Filter) and type(tuning.kind) not in FILTERS:
        known = ", ".join(kind.__name__ for kind in FILTERS)
        raise refusal("FilterTuning.kind", f"one of {known}, or have a Filter as its attribute 'filter'", tuning.kind)
    return brought if isinstance(brought, Filter) else FILTERS[type(tuning.kind)]


def matrix(covariance: ArrayLike) -> NDArray[np.float64]:
    """Return a covariance as the symmetric matrix (5, 5)."""
    P = np.zeros((5, 5))
    P[PLACES] = P[PLACES[::-1]] = covariance
    return P


def covariance_of(P: NDArray[np.float64]) -> Covariance:
    """Return the covariance of a pose and the variances of the twist in a symmetric matrix (5, 5)."""
    return Covariance(*P[PLACES].tolist())


class KalmanFilter:
    """A filter of any kind as an object, which does in a `step` what environments and nodes do in a control interval.

    Args:
        tuning: Noise, gate and kind.
        state: Mean of the initial belief, shape (5,): x, y, theta, v, omega; m, m, rad, m/s, rad/s. None for a filter that
            begins at the origin, or with `start`.
        covariance: Its covariance, shape (5, 5), symmetric and positive semidefinite; None for the tuning's P0.
        dt: Control interval, s.
        integrator: "euler" or "midpoint".

    Raises:
        ValueError: If an argument is unknown or out of its range, or a filter that keeps more than a belief gets a state.
    """

    def __init__(
        self,
        tuning: FilterTuning,
        *,
        state: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        dt: float = 0.1,
        integrator: str = "euler",
    ) -> None:
        self.tuning, self._filter = tuning, filter_of(tuning)
        self.dt, self._integrator = POSITIVE.check("dt", dt), choose("integrator", integrator, INTEGRATORS)
        self._estimate: Any = self._filter.start(_first(ORIGIN), tuning)
        if isinstance(self._estimate, Estimate):  # other kinds keep more than a belief
            mean = Numbers(FINITE, 5).check("state", (0.0,) * 5 if state is None else state)
            P = np.diag(tuning.P0) if covariance is None else np.asarray(covariance, np.float64)
            self._estimate = Estimate(Belief(State(*mean), covariance_of(P)), 0.0, 0.0)
        elif state is not None or covariance is not None:
            raise ValueError("A filter of this kind begins with its first measurement: leave out state and covariance.")
        self._odometry: Pose | None = None

    @property
    def belief(self) -> Belief:
        """The filter's belief, as the functions of `estimation.ekf` take it."""
        return self._estimate.belief

    @property
    def state(self) -> NDArray[np.float64]:
        """Mean of the belief, shape (5,): x, y, theta, v, omega; m, m, rad, m/s, rad/s."""
        return np.array(self.belief.mean)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the belief, shape (5, 5)."""
        return matrix(self.belief.covariance)

    @property
    def nis(self) -> float:
        """Normalized innovation squared of the last measurement; for a correct filter, chi-square with 3 degrees of freedom."""
        return self._estimate.nis

    @property
    def rejections(self) -> int:
        """Number of measurements in a row that the gate has refused; 0 for a filter without a gate."""
        return max(int(self._estimate.rejections), 0) if isinstance(self.tuning.kind, Gate) else 0

    def start(self, odometry: Pose) -> None:
        """Restart from a first measurement, or as the tuning says."""
        self._odometry = Pose(*odometry)
        self._estimate = self._filter.start(_first(self._odometry), self.tuning)

    def step(self, command: Command, odometry: Pose | None = None) -> None:
        """Predict with the command that holds from now on, and correct, gate included; None if no odometry arrived."""
        mean, last = self.belief.mean, self._odometry
        z = Pose(*odometry) if odometry is not None else last or Pose(mean.x, mean.y, mean.theta)
        before, senses = (Senses(Odometry(pose, Command(*command), odometry is not None)) for pose in (last or z, z))
        self._estimate = self._filter.step(self._estimate, before, senses, self.tuning, self.dt, self._integrator)
        self._odometry = z


def _first(pose: Pose) -> Senses:
    """Return the senses at the start, at rest in a measured pose."""
    return Senses(Odometry(pose, STOP, True))


def jacobian(state: State, *, dt: float, integrator: float = Integrator.EULER) -> NDArray[np.float64]:
    """Return the derivative F (5, 5) of the motion with respect to the state.

    Its rows for v and omega are zero, because commands replace the twist. `ekf.predict` writes out the products with it.
    """
    moved, F = motion(state.theta, state.v, state.omega, dt, integrator), np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
    F[0, 2:], F[1, 2:], F[2, 4] = moved[3:6], moved[6:], dt
    return F
