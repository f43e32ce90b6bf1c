"""The filter for a tuning; and filters as objects with inspectable state.

Environments and nodes call a filter's functions; the objects are for interactive use, notebooks and tests.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import POSITIVE, choose, refusal
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import DEAD_RECKONING, EXTENDED_KALMAN, GATED, Estimate
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.models.unicycle import INTEGRATORS, motion
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Gate, Kalman
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Odometry, Pose, Senses, State

_UPPER = np.triu_indices(5)

FILTERS = {type(known.kind): known for known in (EXTENDED_KALMAN, DEAD_RECKONING, GATED)}
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


def matrix(covariance: Covariance) -> NDArray[np.float64]:
    """Return a covariance's 15 independent entries as the symmetric matrix (5, 5)."""
    P = np.zeros((5, 5))
    P[_UPPER] = covariance
    return P + np.triu(P, 1).T


def entries(P: ArrayLike, *, name: str = "covariance") -> Covariance:
    """Return the 15 independent entries of a covariance matrix, checked.

    Args:
        P: Shape (5, 5).
        name: Name of the matrix in error messages.

    Raises:
        ValueError: If the matrix is not finite, not symmetric, not positive semidefinite or of another shape.
    """
    P = np.asarray(P, np.float64)
    if P.shape != (5, 5) or not np.isfinite(P).all():
        raise ValueError(f"{name} must be a finite 5 x 5 matrix, got {P.tolist()!r}.")
    scale = np.abs(P).max()
    if np.abs(P - P.T).max() > 1e-12 * scale:  # tolerate rounding of F P F'
        raise ValueError(f"{name} must be symmetric, got {P.tolist()!r}.")
    least = np.linalg.eigvalsh(P)[0]
    if least < -1e-12 * scale or np.diag(P).min() < 0.0:
        raise ValueError(f"{name} must be positive semidefinite, got one with the eigenvalue {least:.3g}.")
    return Covariance(*P[_UPPER].tolist())


class KalmanFilter:
    """A filter of any kind, with access to its state, covariance and innovation.

    ``step`` does what environments and nodes do in a control interval. ``predict`` and ``update`` are the two halves of the
    extended Kalman filter, for a look in between; they apply no gate, and the odometry corrects even if the tuning makes it the
    filter's input.

    Args:
        tuning: Noise, gate and kind. Kinds that keep more than a belief accept no state and no
            covariance; they begin at the origin, or with `start`.
        state: Mean of the initial belief, shape (5,): x, y, theta, v, omega; m, m, rad, m/s, rad/s.
        covariance: Its covariance, shape (5, 5), symmetric and positive semidefinite; None for the tuning's P0.
        dt: Control interval, s.
        integrator: "euler" or "midpoint".

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """

    def __init__(
        self,
        tuning: FilterTuning,
        *,
        state: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0),
        covariance: ArrayLike | None = None,
        dt: float = 0.1,
        integrator: str = "euler",
    ) -> None:
        mean = np.asarray(state, np.float64)
        if mean.shape != (5,) or not np.isfinite(mean).all():
            raise ValueError(f"state must be 5 finite numbers, got {state!r}.")
        self.tuning = tuning
        self.dt, self._integrator = POSITIVE.check("dt", dt), choose("integrator", integrator, INTEGRATORS)
        P = entries(np.diag(tuning.P0) if covariance is None else covariance)
        self._filter = filter_of(tuning)
        self._rules = tuning.kind if isinstance(tuning.kind, Kalman) else Kalman()
        self._estimate: Any = self._filter.start(_first(Pose(0.0, 0.0, 0.0)), tuning)
        self._is_simple = isinstance(self._estimate, Estimate)  # other kinds keep more than a belief
        if self._is_simple:
            self._estimate = Estimate(Belief(State(*mean.tolist()), P), 0.0, 0.0)
        elif covariance is not None or mean.any():
            raise ValueError("A filter of this kind begins with its first measurement: leave out state and covariance.")
        self._odometry: Pose | None = None
        self._innovation = np.full(3, np.nan)
        self._innovation_covariance = np.full((3, 3), np.nan)

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
    def innovation(self) -> NDArray[np.float64]:
        """Last measured minus predicted pose, shape (3,); m, m, rad. NaN before a measurement."""
        return self._innovation.copy()

    @property
    def innovation_covariance(self) -> NDArray[np.float64]:
        """Covariance that the filter predicted for the last innovation, shape (3, 3). NaN before a measurement."""
        return self._innovation_covariance.copy()

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

    def predict(self, command: Command) -> None:
        """Move the belief by one control interval, with the command that holds from now on.

        Raises:
            ValueError: If the filter is of a kind that has no such halves.
        """
        self._require_halves()
        belief = self._moved(Command(*command))
        self._estimate = self._estimate._replace(belief=belief)

    def update(self, odometry: Pose) -> None:
        """Condition the belief on a measured pose.

        Raises:
            ValueError: If the filter is of a kind that has no such halves.
        """
        self._require_halves()
        z = Pose(*odometry)
        self._note(self.belief, z)
        belief, nis = ekf.correct(self.belief, z, self.tuning.R, self._rules.wrap_innovation)
        self._estimate = Estimate(belief, nis, self._estimate.rejections)

    def step(self, command: Command, odometry: Pose | None = None) -> None:
        """Predict and correct, gate included; None if no odometry arrived."""
        command = Command(*command)
        measured = odometry is not None
        mean = self.belief.mean
        z = Pose(*odometry) if measured else (self._odometry or Pose(mean.x, mean.y, mean.theta))
        if measured and not isinstance(self.tuning.kind, DeadReckoning):
            self._note(self._moved(command), z)
        before, senses = Senses(Odometry(self._odometry or z, command, True)), Senses(Odometry(z, command, measured))
        self._estimate = self._filter.step(self._estimate, before, senses, self.tuning, self.dt, self._integrator)
        self._odometry = z

    def _moved(self, command: Command) -> Belief:
        keep = self._rules.remember_velocity
        return ekf.predict(self.belief, command, self.tuning, self.dt, self._integrator, keep)

    def _require_halves(self) -> None:
        if not self._is_simple:
            raise ValueError(
                "predict and update are halves of the extended Kalman filter; a filter of this kind has step alone."
            )

    def _note(self, prior: Belief, z: Pose) -> None:
        """Store the innovation nu of a measurement against the prior, and S = H P H' + R."""
        self._innovation = np.array(ekf.innovation(prior.mean, z, self._rules.wrap_innovation))
        self._innovation_covariance = matrix(prior.covariance)[:3, :3] + np.diag(self.tuning.R)


def _first(pose: Pose) -> Senses:
    """Return the senses at the start, at rest in a measured pose."""
    return Senses(Odometry(pose, STOP, True))


def jacobian(state: State, *, dt: float, integrator: str = "euler") -> NDArray[np.float64]:
    """Return the derivative F (5, 5) of the motion with respect to the state.

    Its rows for v and omega are zero, because commands replace the twist. `ekf.predict` writes out the products with it.
    """
    return jacobians(np.array([state]), dt=dt, integrator=choose("integrator", integrator, INTEGRATORS))[0]


def jacobians(states: ArrayLike, *, dt: float, integrator: float) -> NDArray[np.float64]:
    """Return `jacobian` for many states (n, 5), shape (n, 5, 5); the integrator is a value of `models.unicycle.Integrator`."""
    twists = np.asarray(states, np.float64)[:, 2:].tolist()
    moved = np.array([motion(theta, v, omega, dt, integrator)[3:] for theta, v, omega in twists])
    F = np.zeros((len(twists), 5, 5))
    F[:, [0, 1, 2], [0, 1, 2]] = 1.0
    F[:, 0, 2:], F[:, 1, 2:], F[:, 2, 4] = moved[:, :3], moved[:, 3:], dt
    return F
