"""A filter that reads a gyro: the extended Kalman filter of `ekf`, with the gyro's bias as a sixth state.

The gyro measures the turning rate that the robot executes, which neither commands nor wheels know. So the heading drifts less
between two measured poses; with wheel odometry, which measures none, the gyro alone corrects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

from turtlebot_gym.config import NON_NEGATIVE
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import predict
from turtlebot_gym.estimation.gate import ONE_MEASUREMENT
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.sixth import Sixth, correct_both_correlated, moved_column, settle_both, update_both
from turtlebot_gym.estimation.update import Projection, Variances, wrapped
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import FilterTuning, Gate
from turtlebot_gym.values import Belief, Pose, State


@dataclass(frozen=True, slots=True, kw_only=True)
class Gyro(Gate):
    """The filter's own numbers, `FilterTuning.kind`."""

    variance: Annotated[float, NON_NEGATIVE]
    """Variance of a measured turning rate, (rad/s)^2."""
    bias_deviation: Annotated[float, NON_NEGATIVE]
    """Standard deviation of the bias at the start, rad/s."""
    bias_walk: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation that the bias gains in the first second, rad/s; it grows with the root of time."""
    corrects: bool = True
    """Whether the measured poses correct the belief; not with wheel odometry."""

    filter: ClassVar[Any]
    """The `Filter` that these numbers belong to."""


class _GyroEstimate(NamedTuple):
    belief: Belief
    nis: float
    """Normalized innovation squared of the last measured pose."""
    bias: Sixth
    """The gyro's bias, rad/s."""
    rejections: float
    """See `ekf.Estimate`."""


@kernel
def _start(senses: Any, tuning: FilterTuning) -> _GyroEstimate:
    """Start from the first measurement, without a bias; see `interface.Filter`."""
    belief, deviation = ekf.initialize(senses.odometry.pose, tuning).belief, tuning.kind.bias_deviation
    bias = Sixth(0.0, deviation * deviation, State(0.0, 0.0, 0.0, 0.0, 0.0))
    return _GyroEstimate(belief, 0.0, bias, ONE_MEASUREMENT)


@kernel
def _turn_rate(belief: Belief, bias: Sixth) -> Projection:
    """Project on what the gyro measures, the turning rate plus the bias."""
    P, c = belief.covariance, bias.column
    # var(omega + b) = var(omega) + 2 cov + var(b).
    column = State(P.xw + c.x, P.yw + c.y, P.tw + c.theta, P.vw + c.v, P.ww + c.omega)
    return Projection(column, P.ww + 2.0 * c.omega + bias.variance)


@kernel
def _step(
    estimate: _GyroEstimate, before: Any, senses: Any, tuning: FilterTuning, dt: float, integrator: float
) -> _GyroEstimate:
    """Predict, and correct by turning rate and pose; see `interface.Filter`."""
    odometry, gyro = senses.odometry, tuning.kind
    to = moved_column(estimate.bias, estimate.belief.mean, dt, integrator)
    belief = predict(estimate.belief, odometry.twist, tuning, dt, integrator)
    variance = estimate.bias.variance + gyro.bias_walk * gyro.bias_walk * dt
    bias = Sixth(estimate.bias.mean, variance, State(to.x, to.y, to.theta, 0.0, 0.0))  # a new twist is executed

    surprise = senses.imu.omega - belief.mean.omega - bias.mean
    h = _turn_rate(belief, bias)
    belief, bias, _ = update_both(belief, bias, h, bias.column.omega + bias.variance, surprise, gyro.variance)
    corrects = odometry.measured & gyro.corrects
    belief, bias, nis, rejections = settle_both(estimate.rejections, wrapped(belief), bias, odometry.pose, corrects, tuning, dt)
    return _GyroEstimate(belief, nis if corrects else estimate.nis, bias, rejections)


@kernel
def _fix(estimate: _GyroEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _GyroEstimate:
    belief, bias = correct_both_correlated(estimate.belief, estimate.bias, z, R)
    return _GyroEstimate(belief, estimate.nis, bias, estimate.rejections)


Gyro.filter = Filter(_start, _step, _fix, ("odometry", "imu"), Gyro(variance=3e-6, bias_deviation=0.01))
