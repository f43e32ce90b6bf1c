"""A filter that also estimates the executed share of a twist: wheels 2 % larger than stated drive 2 % farther.

The extended Kalman filter of `ekf` with a sixth, constant state: the share of the twist that is executed.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import innovation, predict
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.sixth import Sixth, correct_both, moved_column
from turtlebot_gym.estimation.update import Variances
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import FilterTuning, Scale
from turtlebot_gym.values import Belief, Command, Covariance, Pose, Senses, State


class _ScaleEstimate(NamedTuple):
    belief: Belief
    nis: float
    """Normalized innovation squared of the last measurement."""
    scale: Sixth
    """The executed share of a twist."""


@kernel
def _start(senses: Senses, tuning: FilterTuning) -> _ScaleEstimate:
    """Start from the first measurement, with a scale of 1; see `interface.Filter`."""
    belief = ekf.initialize(senses.odometry.pose, tuning).belief
    deviation = tuning.kind.scale_deviation
    return _ScaleEstimate(belief, 0.0, Sixth(1.0, deviation * deviation, State(0.0, 0.0, 0.0, 0.0, 0.0)))


@kernel
def _predict(
    belief: Belief, scale: Sixth, twist: Command, tuning: FilterTuning, dt: float, middle: float
) -> tuple[Belief, Sixth]:
    """Move the pose; then the twist becomes the executed share of the new one."""
    share, variance = scale.mean, scale.variance
    to = moved_column(scale, belief.mean, dt, middle)
    (x, y, heading, _, _), P = predict(belief, twist, tuning, dt, middle)
    V, W = twist.v, twist.omega
    covariance = Covariance(
        P.xx, P.xy, P.xt, V * to.x, W * to.x,
        P.yy, P.yt, V * to.y, W * to.y,
        P.tt, V * to.theta, W * to.theta,
        P.vv + V * V * variance, V * W * variance,
        P.ww + W * W * variance,
    )  # fmt: skip
    mean = State(x, y, heading, share * V, share * W)
    return Belief(mean, covariance), Sixth(share, variance, State(to.x, to.y, to.theta, V * variance, W * variance))


@kernel
def _step(
    estimate: _ScaleEstimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, middle: float
) -> _ScaleEstimate:
    """Predict with the executed share of the twist, and correct; see `interface.Filter`."""
    z = senses.odometry.pose
    prior, scale = _predict(estimate.belief, estimate.scale, senses.odometry.twist, tuning, dt, middle)
    now = _ScaleEstimate(prior, estimate.nis, scale)
    belief, scale, nis = correct_both(prior, scale, z, tuning.R, innovation(prior.mean, z).theta)
    return _ScaleEstimate(belief, nis, scale) if senses.odometry.measured else now


@kernel
def _fix(estimate: _ScaleEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _ScaleEstimate:
    turn = wrap(z.theta - estimate.belief.mean.theta)
    belief, scale, _ = correct_both(estimate.belief, estimate.scale, z, R, turn)
    return _ScaleEstimate(belief, estimate.nis, scale)


SCALE = Filter(_start, _step, _fix, kind=Scale())
