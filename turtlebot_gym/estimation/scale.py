"""A filter that also estimates the executed share of a twist: wheels 2 % larger than stated drive 2 % farther.

The extended Kalman filter of `ekf` with a sixth, constant state: the share of the twist that is executed.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import innovation, predict, wrapped
from turtlebot_gym.estimation.update import (
    Projection,
    Variances,
    innovation_variance,
    inverse_of,
    of_heading,
    of_x,
    of_y,
    update,
)
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import motion
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Belief, Command, Covariance, Pose, Senses, State


class ScaleEstimate(NamedTuple):
    """State that the filter keeps between steps: a Gaussian over the robot's state and the scale."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the last measurement."""
    scale: float
    """Mean of the scale, the executed share of a twist."""
    variance: float
    """Variance of the scale."""
    column: State
    """Covariance of the scale with each component of the state."""


@kernel
def start(senses: Senses, tuning: FilterTuning) -> ScaleEstimate:
    """Start from the first measurement, with a scale of 1; see `interface.Filter`."""
    belief = ekf.initialize(senses.odometry.pose, tuning).belief
    deviation = tuning.kind.scale_deviation
    return ScaleEstimate(belief, 0.0, 1.0, deviation * deviation, State(0.0, 0.0, 0.0, 0.0, 0.0))


@kernel
def _predict(estimate: ScaleEstimate, twist: Command, tuning: FilterTuning, dt: float, middle: float) -> ScaleEstimate:
    """Move by a control interval: the pose with the believed twist, then the twist to the executed share of the new one."""
    (_, _, theta, v, omega), _ = estimate.belief
    moved = motion(theta, v, omega, dt, middle)
    c, share, variance = estimate.column, estimate.scale, estimate.variance
    (x, y, heading, _, _), P = predict(estimate.belief, twist, tuning, dt, middle)
    to_x = c.x + moved.x_theta * c.theta + moved.x_v * c.v + moved.x_omega * c.omega
    to_y = c.y + moved.y_theta * c.theta + moved.y_v * c.v + moved.y_omega * c.omega
    to_theta = c.theta + dt * c.omega
    V, W = twist.v, twist.omega
    covariance = Covariance(
        P.xx, P.xy, P.xt, V * to_x, W * to_x,
        P.yy, P.yt, V * to_y, W * to_y,
        P.tt, V * to_theta, W * to_theta,
        P.vv + V * V * variance, V * W * variance,
        P.ww + W * W * variance,
    )  # fmt: skip
    mean = State(x, y, heading, share * V, share * W)
    column = State(to_x, to_y, to_theta, V * variance, W * variance)
    return ScaleEstimate(Belief(mean, covariance), estimate.nis, share, variance, column)


@kernel
def _update(estimate: ScaleEstimate, h: Projection, across: float, innovation: float, r: float) -> ScaleEstimate:
    """Condition on a scalar measurement, whose covariance with the scale is ``across``, and add to the NIS; see `update`."""
    inverse = inverse_of(innovation_variance(h, r))
    belief, nis = update(estimate.belief, h, innovation, r)
    c, s, k = estimate.column, h.column, across * inverse
    column = State(c.x - k * s.x, c.y - k * s.y, c.theta - k * s.theta, c.v - k * s.v, c.omega - k * s.omega)
    variance = max(estimate.variance - k * across, 0.0)
    return ScaleEstimate(belief, estimate.nis + nis, estimate.scale + k * innovation, variance, column)


@kernel
def _correct(prior: ScaleEstimate, z: Pose, R: Variances, turn: float) -> ScaleEstimate:
    """Condition on a measured pose, whose heading's innovation is ``turn``."""
    now = ScaleEstimate(prior.belief, 0.0, prior.scale, prior.variance, prior.column)
    now = _update(now, of_x(now.belief.covariance), now.column.x, z.x - now.belief.mean.x, R[0])
    now = _update(now, of_y(now.belief.covariance), now.column.y, z.y - now.belief.mean.y, R[1])
    turn = turn - (now.belief.mean.theta - prior.belief.mean.theta)
    now = _update(now, of_heading(now.belief.covariance), now.column.theta, turn, R[2])
    return ScaleEstimate(wrapped(now.belief), now.nis, now.scale, now.variance, now.column)


@kernel
def step(
    estimate: ScaleEstimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, middle: float
) -> ScaleEstimate:
    """Predict with the executed share of the twist, and correct by the measured pose; see `interface.Filter`."""
    z = senses.odometry.pose
    prior = _predict(estimate, senses.odometry.twist, tuning, dt, middle)
    now = _correct(prior, z, tuning.R, innovation(prior.belief.mean, z).theta)
    return now if senses.odometry.measured else prior


@kernel
def fix(estimate: ScaleEstimate, z: Pose, R: Variances) -> ScaleEstimate:
    """Condition on an external pose measurement; see `interface.Filter`."""
    now = _correct(estimate, z, R, wrap(z.theta - estimate.belief.mean.theta))
    return ScaleEstimate(now.belief, estimate.nis, now.scale, now.variance, now.column)
