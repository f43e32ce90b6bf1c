"""The tutorial's extended Kalman filter, as the reference system has it: a state of five, and two mistakes.

Its Jacobian keeps the velocities of the previous step, though commands replace them, and the innovation of the heading jumps by
2 pi. So all five states are correlated, and their covariance is written out here alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from turtlebot_gym.estimation.ekf import start
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.update import Variances, independent, innovation_variance, inverse_of
from turtlebot_gym.kernel import algebra, kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import expected, motion
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, Tutorial
from turtlebot_gym.values import Belief, Covariance, Pose, State

PLACES = tuple((i, j) for i in range(5) for j in range(i, 5))  # of a symmetric 5 x 5 matrix, row by row from the diagonal on
ROWS = tuple(tuple(PLACES.index((min(i, j), max(i, j))) for j in range(5)) for i in range(5))  # where a row's numbers are there


class TutorialEstimate(NamedTuple):
    """State that the filter keeps between steps."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the last measurement."""
    P: tuple[float, ...]
    """The 15 independent numbers of the state's covariance, at `PLACES`."""


@kernel
def _estimate(mean: State, nis: float, P: tuple[float, ...]) -> TutorialEstimate:
    return TutorialEstimate(Belief(mean, Covariance(P[0], P[1], P[2], P[5], P[6], P[9], P[12], P[14])), nis, P)


@algebra
def _dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]


@algebra
def _update(
    mean: State, P: tuple[float, ...], h: tuple[float, float, float], innovation: float, r: float
) -> tuple[State, tuple[float, ...], float]:
    """Condition on one scalar measurement ``h (x, y, theta)``; see `update.update`."""
    x, y, t = (tuple(P[at] for at in row) for row in ROWS[:3])
    column = tuple(h[0] * x[at] + h[1] * y[at] + h[2] * t[at] for at in (0, 1, 2, 3, 4))
    inverse = inverse_of(innovation_variance(h[0] * column[0] + h[1] * column[1] + h[2] * column[2], r))
    gain, by = innovation * inverse, tuple(number * inverse for number in column)
    mean = State(*(number + gain * other for number, other in zip(mean, column, strict=True)))
    less = tuple(number - by[i] * column[j] for number, (i, j) in zip(P, PLACES, strict=True))
    P = tuple(max(number, 0.0) if i == j else number for number, (i, j) in zip(less, PLACES, strict=True))
    return mean, P, gain * innovation


@kernel
def _correct(mean: State, P: tuple[float, ...], z: Pose, turn: float, R: Variances) -> tuple[State, tuple[float, ...], float]:
    """Condition on a measured pose with the heading's innovation ``turn``; R as in `update.independent`."""
    a, b, c, (r_x, r_y, r_theta) = independent(R)
    theta = mean.theta
    mean, P, nis_x = _update(mean, P, (1.0, 0.0, 0.0), z.x - mean.x, r_x)
    mean, P, nis_y = _update(mean, P, (a, 1.0, 0.0), a * (z.x - mean.x) + (z.y - mean.y), r_y)
    off = b * (z.x - mean.x) + c * (z.y - mean.y) + (turn - (mean.theta - theta))
    mean, P, nis_theta = _update(mean, P, (b, c, 1.0), off, r_theta)
    return mean._replace(theta=wrap(mean.theta)), P, nis_x + nis_y + nis_theta


@kernel
def _start(senses: Any, tuning: FilterTuning) -> TutorialEstimate:
    belief = start(senses, tuning).belief
    P = belief.covariance
    return _estimate(belief.mean, 0.0, (P.xx, 0.0, 0.0, 0.0, 0.0, P.yy, 0.0, 0.0, 0.0, P.tt, 0.0, 0.0, P.vv, 0.0, P.ww))


@algebra
def _predict(estimate: TutorialEstimate, twist: Any, tuning: FilterTuning, dt: float, integrator: float) -> TutorialEstimate:
    """Move by one control interval with ``F P F' + Q``, in which F keeps the velocities."""
    mean, P = estimate.belief.mean, estimate.P
    by = motion(mean.theta, mean.v, mean.omega, dt, integrator)
    executed, var_v, var_omega = expected(twist, tuning.process, dt)
    F = (
        (1.0, 0.0, by.x_theta, by.x_v, by.x_omega),
        (0.0, 1.0, by.y_theta, by.y_v, by.y_omega),
        (0.0, 0.0, 1.0, 0.0, dt),
        (0.0, 0.0, 0.0, 1.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 1.0),
    )
    rows = tuple(tuple(P[at] for at in row) for row in ROWS)
    FP = tuple(tuple(_dot(row, column) for column in rows) for row in F)
    xx, xy, xt, xv, xw, yy, yt, yv, yw, tt, tv, tw, vv, vw, ww = tuple(_dot(FP[i], F[j]) for i, j in PLACES)
    Q, share = tuning.Q, dt / REFERENCE_PERIOD
    xx, yy, tt = max(xx, 0.0) + Q[0] * share, max(yy, 0.0) + Q[1] * share, max(tt, 0.0) + Q[2] * share
    vv, ww = vv + max(var_v, Q[3] * share), ww + max(var_omega, Q[4] * share)
    moved = State(mean.x + by.x, mean.y + by.y, wrap(mean.theta + by.theta), executed.v, executed.omega)
    return _estimate(moved, estimate.nis, (xx, xy, xt, xv, xw, yy, yt, yv, yw, tt, tv, tw, vv, vw, ww))


@kernel
def _step(
    estimate: TutorialEstimate, before: Any, senses: Any, tuning: FilterTuning, dt: float, integrator: float
) -> TutorialEstimate:
    """Predict, and correct by the measured pose if one arrived; see `interface.Filter`."""
    prior, (z, _, measured), R = _predict(estimate, senses.odometry.twist, tuning, dt, integrator), senses.odometry, tuning.R
    mean = prior.belief.mean
    mean, P, nis = _correct(mean, prior.P, z, z.theta - mean.theta, (R[0], R[1], R[2], 0.0, 0.0, 0.0))
    posterior = _estimate(mean, nis, P)
    return posterior if measured else prior


@kernel
def _fix(estimate: TutorialEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> TutorialEstimate:
    mean = estimate.belief.mean
    mean, P, _ = _correct(mean, estimate.P, z, wrap(z.theta - mean.theta), R)
    return _estimate(mean, estimate.nis, P)


TUTORIAL = Filter(_start, _step, _fix, kind=Tutorial())
"""The tutorial's filter, mistakes included."""
