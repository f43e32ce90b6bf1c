"""A filter that reads a gyro: the extended Kalman filter of `ekf`, with the gyro's bias as a further state.

The gyro measures the turning rate that the robot executes, which neither commands nor wheels know. So the heading drifts less
between two measured poses; with wheel odometry, which measures none, the gyro alone corrects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

from turtlebot_gym.config import NON_NEGATIVE
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import ONE_MEASUREMENT, judge, settle
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.update import Projection, Sixth, Variances, correct_both, inverse_of, update_both, wrapped
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.unicycle import motion
from turtlebot_gym.parameters import FilterTuning, Kalman
from turtlebot_gym.values import Belief, Command, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Gyro(Kalman):
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
    offset: float
    """The turning rate is this, rad/s, minus a `share` of the bias, with an error of the variance `rest`, (rad/s)^2."""
    share: float
    rest: float


@kernel
def _start(senses: Any, tuning: FilterTuning) -> _GyroEstimate:
    belief, deviation = ekf.start(senses, tuning).belief, tuning.kind.bias_deviation
    bias = Sixth(0.0, deviation * deviation, Pose(0.0, 0.0, 0.0))
    return _GyroEstimate(belief, 0.0, bias, ONE_MEASUREMENT, 0.0, 0.0, belief.covariance.ww)


@kernel
def _predict(
    estimate: _GyroEstimate, twist: Command, tuning: FilterTuning, dt: float, integrator: float
) -> tuple[Belief, Sixth]:
    """Move the belief; the bias adds to its covariance, since the turning rate has a share of it."""
    mean, c, vb = estimate.belief.mean, estimate.bias.column, estimate.bias.variance
    by = motion(mean.theta, mean.v, mean.omega, dt, integrator)
    fx, fy, ft = -estimate.share * by.x_omega, -estimate.share * by.y_omega, -estimate.share * dt
    cx, cy, ct = c.x + by.x_theta * c.theta, c.y + by.y_theta * c.theta, c.theta
    alone = estimate.belief._replace(covariance=estimate.belief.covariance._replace(ww=estimate.rest))
    belief = ekf.predict(alone, twist, tuning, dt, integrator)
    P = belief.covariance
    moved = P._replace(
        xx=P.xx + fx * (2.0 * cx + fx * vb),
        xy=P.xy + fx * cy + fy * cx + fx * fy * vb,
        xt=P.xt + fx * ct + ft * cx + fx * ft * vb,
        yy=P.yy + fy * (2.0 * cy + fy * vb),
        yt=P.yt + fy * ct + ft * cy + fy * ft * vb,
        tt=P.tt + ft * (2.0 * ct + ft * vb),
    )
    walk, column = tuning.kind.bias_walk, Pose(cx + fx * vb, cy + fy * vb, ct + ft * vb)
    return belief._replace(covariance=moved), Sixth(estimate.bias.mean, vb + walk * walk * dt, column)


@kernel
def _turning(estimate: _GyroEstimate, belief: Belief, bias: Sixth) -> _GyroEstimate:
    """Return an estimate with another belief and bias, and the turning rate that follows from the bias."""
    share = estimate.share
    mean = belief.mean._replace(omega=estimate.offset - share * bias.mean)
    P = belief.covariance._replace(ww=estimate.rest + share * share * bias.variance)
    return estimate._replace(belief=Belief(mean, P), bias=bias)


@kernel
def _step(
    estimate: _GyroEstimate, before: Any, senses: Any, tuning: FilterTuning, dt: float, integrator: float
) -> _GyroEstimate:
    odometry, gyro, measured = senses.odometry, tuning.kind, senses.imu.omega
    belief, bias = _predict(estimate, odometry.twist, tuning, dt, integrator)
    # The gyro minus the turning rate of the wheels measures the bias; what remains of both is the turning rate itself.
    told, unsure = belief.mean.omega, belief.covariance.ww
    off, noise = measured - told - bias.mean, unsure + gyro.variance
    belief, bias, _ = update_both(belief, bias, Projection(bias.column, bias.variance), bias.variance, off, noise)
    share, prior, z, R = unsure * inverse_of(noise), wrapped(belief), odometry.pose, tuning.R
    corrects = odometry.measured & gyro.corrects
    posterior, corrected, nis = correct_both(prior, bias, z, (R[0], R[1], R[2], 0.0, 0.0, 0.0))
    verdict = judge(estimate.rejections, corrects, nis > gyro.gate, tuning, dt)
    belief = settle(verdict, corrects, prior, posterior, z, tuning)
    bias = corrected if corrects & (nis <= gyro.gate) else bias
    alone = bias._replace(column=Pose(0.0, 0.0, 0.0))  # a belief that starts anew has nothing in common with the bias
    bias = alone if verdict.lost else bias
    nis, offset = nis if corrects else estimate.nis, told + share * (measured - told)
    return _turning(_GyroEstimate(belief, nis, bias, verdict.rejections, offset, share, share * gyro.variance), belief, bias)


@kernel
def _fix(estimate: _GyroEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _GyroEstimate:
    belief, bias, _ = correct_both(estimate.belief, estimate.bias, z, R)
    return _turning(estimate, belief, bias)


Gyro.filter = Filter(_start, _step, _fix, ("odometry", "imu"), Gyro(variance=3e-6, bias_deviation=0.01))
