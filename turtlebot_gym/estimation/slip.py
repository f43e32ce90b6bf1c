"""A filter that models heading spikes, as `mixture` does, and slip.

Each hypothesis has two modes, gripping and slipping wheels. By interacting multiple models, a measurement updates the
probabilities of the modes, and the modes are mixed by their transition probabilities before the next twist is executed.

References:
    Blom, Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching coefficients", *IEEE
    Transactions on Automatic Control* 33 (1988).
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.gate import ONE_MEASUREMENT, Three, either, judge, restart
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.mixture import (
    Hypotheses,
    Tracks,
    begin,
    beliefs,
    explained,
    first_weights,
    fix_all,
    least_exponent,
    merge,
    merged,
    scaled,
    settled,
    share_of,
    track_all,
    weigh,
)
from turtlebot_gym.estimation.update import Variances
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, Slip
from turtlebot_gym.values import Belief, Command, Pose, Senses, State


class _SlipEstimate(NamedTuple):
    belief: Belief
    """All hypotheses in both modes, merged."""
    nis: float
    """Normalized innovation squared of the last measurement, averaged over its explanations."""
    gripping: Hypotheses
    """Hypotheses for wheels that grip, so that the twist is fully executed ..."""
    slipping: Hypotheses
    """... and for wheels that slip, so that slip takes its share."""
    grip_weights: Three
    """Probability of each hypothesis with wheels that grip ..."""
    slip_weights: Three
    """... and that slip; the six sum to 1."""
    rejections: float
    """See `ekf.Estimate`."""


@kernel
def _all(gripping: Hypotheses, slipping: Hypotheses, grip: Three, slip: Three) -> Belief:
    share = slip[0] + slip[1] + slip[2]
    return merge(merged(gripping, grip), merged(slipping, slip), share)


@kernel
def _start(senses: Senses, tuning: FilterTuning) -> _SlipEstimate:
    """Start from the first measurement, with wheels that grip; see `interface.Filter`."""
    hypotheses, weights = begin(senses.odometry.pose, tuning)
    none = (0.0, 0.0, 0.0)
    belief = _all(hypotheses, hypotheses, weights, none)
    return _SlipEstimate(belief, 0.0, hypotheses, hypotheses, weights, none, ONE_MEASUREMENT)


@kernel
def _moving(belief: Belief, twist: Command, share: float) -> Belief:
    x, y, theta, _, _ = belief.mean
    return Belief(State(x, y, theta, share * twist.v, share * twist.omega), belief.covariance)


@kernel
def _mix(
    gripped: Belief, slipped: Belief, grip: float, slip: float, twist: Command, tuning: FilterTuning, dt: float
) -> tuple[Belief, Belief, float, float]:
    """Return a hypothesis in both modes after a possible transition, with its weights."""
    process, scale = tuning.process, dt / REFERENCE_PERIOD
    start, end = process.slip_start * scale, process.slip_end * scale
    stays, ends, starts, goes_on = grip * (1.0 - start), slip * end, grip * start, slip * (1.0 - end)
    gripping = merge(gripped, slipped, share_of(ends, stays))
    slipping = merge(gripped, slipped, share_of(goes_on, starts))
    return _moving(gripping, twist, 1.0), _moving(slipping, twist, 1.0 - process.slip), stays + ends, starts + goes_on


@kernel
def _weigh_both(estimate: _SlipEstimate, gripped: Tracks, slipped: Tracks) -> tuple[Three, Three]:
    least = min(least_exponent(gripped), least_exponent(slipped))
    grip, slip = weigh(estimate.grip_weights, gripped, least), weigh(estimate.slip_weights, slipped, least)
    scale = 1.0 / (grip[0] + grip[1] + grip[2] + slip[0] + slip[1] + slip[2])
    return scaled(grip, scale), scaled(slip, scale)


@kernel
def _fix(estimate: _SlipEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _SlipEstimate:
    """Correct and weigh all hypotheses; see `interface.Filter`."""
    gripped, slipped = fix_all(estimate.gripping, z, R), fix_all(estimate.slipping, z, R)
    grip, slip = _weigh_both(estimate, gripped, slipped)
    gripping, slipping = beliefs(gripped), beliefs(slipped)
    belief = _all(gripping, slipping, grip, slip)
    return _SlipEstimate(belief, estimate.nis, gripping, slipping, grip, slip, estimate.rejections)


@kernel
def _step(
    estimate: _SlipEstimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float
) -> _SlipEstimate:
    """Predict, correct and weigh, and mix the modes; see `interface.Filter`."""
    odometry, twist = senses.odometry, senses.odometry.twist
    gripped = track_all(estimate.gripping, odometry, tuning, dt, integrator)
    slipped = track_all(estimate.slipping, odometry, tuning, dt, integrator)
    grip, slip = _weigh_both(estimate, gripped, slipped)
    nis = (
        grip[0] * gripped.true.nis
        + grip[1] * gripped.high.nis
        + grip[2] * gripped.low.nis
        + slip[0] * slipped.true.nis
        + slip[1] * slipped.high.nis
        + slip[2] * slipped.low.nis
    )
    z, measured, first, none = odometry.pose, odometry.measured, first_weights(tuning), (0.0, 0.0, 0.0)
    verdict = judge(estimate.rejections, measured, nis > tuning.kind.gate, tuning, dt)
    lost, refused = verdict.lost, verdict.refused
    anew = explained(restart(gripped.true.prior, z, tuning), tuning.kind.spike)
    gripping, slipping = settled(verdict, measured, gripped, anew), settled(verdict, measured, slipped, anew)
    grip = either(lost, first, either(refused, estimate.grip_weights, grip))
    slip = either(lost, none, either(refused, estimate.slip_weights, slip))
    g_true, s_true, grip_0, slip_0 = _mix(gripping.true, slipping.true, grip[0], slip[0], twist, tuning, dt)
    g_high, s_high, grip_1, slip_1 = _mix(gripping.high, slipping.high, grip[1], slip[1], twist, tuning, dt)
    g_low, s_low, grip_2, slip_2 = _mix(gripping.low, slipping.low, grip[2], slip[2], twist, tuning, dt)
    gripping, slipping = Hypotheses(g_true, g_high, g_low), Hypotheses(s_true, s_high, s_low)
    grip, slip = (grip_0, grip_1, grip_2), (slip_0, slip_1, slip_2)
    belief = _all(gripping, slipping, grip, slip)
    nis = nis if measured else estimate.nis
    return _SlipEstimate(belief, nis, gripping, slipping, grip, slip, verdict.rejections)


SLIP = Filter(_start, _step, _fix, kind=Slip(spike_probability=0.02, spike=0.3))
