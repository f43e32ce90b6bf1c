"""A filter that models heading spikes: a measured heading is true, or too large or too small by a spike.

A measurement is a mixture of the three, and the posterior is approximated by a Gaussian with the mixture's mean and covariance.
The first measurement has no prior to be weighed against, and a filter that believed a spike there would take all later
measurements for spikes. So three beliefs start, one for each explanation, and later measurements decide between them.

References:
    Alspach, Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", *IEEE Transactions on Automatic
    Control* 17 (1972). Bar-Shalom, Li, Kirubarajan (2001), section 1.4.16: the moments of a mixture.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.ekf import correct_position, innovation, predict
from turtlebot_gym.estimation.gate import ONE_MEASUREMENT, Three, Verdict, choose, either, judge, restart
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.update import (
    Variances,
    absorb,
    correct_correlated,
    innovation_variance,
    inverse_of,
    of_heading,
    wrapped,
)
from turtlebot_gym.kernel import algebra, kernel, sqrt
from turtlebot_gym.models.angles import wrap, wrap_once
from turtlebot_gym.parameters import FilterTuning, Mixture
from turtlebot_gym.values import Belief, Covariance, Odometry, Pose, Senses, State

_LEAST = 1e-100
"""Least density of a measurement, without its exponent, so that one that was certain beforehand does not count as
impossible."""


class Hypotheses(NamedTuple):
    """Beliefs for each explanation of the first heading: true, too large by a spike, too small by one."""

    true: Belief
    high: Belief
    low: Belief


class _MixtureEstimate(NamedTuple):
    belief: Belief
    """The hypotheses, merged."""
    nis: float
    """Normalized innovation squared of the last measurement, averaged over its explanations."""
    hypotheses: Hypotheses
    weights: Three
    """Probabilities of the hypotheses."""
    rejections: float
    """See `ekf.Estimate`."""


class _Tracked(NamedTuple):
    """A hypothesis, and the measurement's likelihood under it, ``factor e^-exponent``."""

    belief: Belief
    nis: float
    exponent: float
    factor: float
    prior: Belief
    """The hypothesis before the measurement."""


class Tracks(NamedTuple):
    """All hypotheses, in the order of `Hypotheses`."""

    true: _Tracked
    high: _Tracked
    low: _Tracked


@kernel
def exp_minus(q: float) -> float:
    """Return ``e^-q`` for ``q >= 0``, to 2e-12 relative, without a branch; above 60 as for 60."""
    # A Taylor series, squared seven times: 2^7 = 128.
    x = min(q, 60.0) * (1.0 / 128.0)
    y = 2.505210838544172e-08 - x * 2.08767569878681e-09
    y = 2.48015873015873e-05 - x * (2.7557319223985893e-06 - x * (2.755731922398589e-07 - x * y))
    y = 0.008333333333333333 - x * (0.001388888888888889 - x * (0.0001984126984126984 - x * y))
    y = 1.0 - x * (1.0 - x * (0.5 - x * (0.16666666666666666 - x * (0.041666666666666664 - x * y))))
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    return y * y


@algebra
def merge(one: Belief, other: Belief, share: float) -> Belief:
    """Return the Gaussian with the moments of a mixture; ``other`` has the weight ``share``."""
    a, b, P, Q = one.mean, other.mean, one.covariance, other.covariance
    x, y, t, v, w = b.x - a.x, b.y - a.y, wrap_once(b.theta - a.theta), b.v - a.v, b.omega - a.omega
    rest, both = 1.0 - share, share * (1.0 - share)
    mean = State(a.x + share * x, a.y + share * y, wrap_once(a.theta + share * t), a.v + share * v, a.omega + share * w)
    covariance = Covariance(
        rest * P.xx + share * Q.xx + both * x * x,
        rest * P.xy + share * Q.xy + both * x * y,
        rest * P.xt + share * Q.xt + both * x * t,
        rest * P.xv + share * Q.xv + both * x * v,
        rest * P.xw + share * Q.xw + both * x * w,
        rest * P.yy + share * Q.yy + both * y * y,
        rest * P.yt + share * Q.yt + both * y * t,
        rest * P.yv + share * Q.yv + both * y * v,
        rest * P.yw + share * Q.yw + both * y * w,
        rest * P.tt + share * Q.tt + both * t * t,
        rest * P.tv + share * Q.tv + both * t * v,
        rest * P.tw + share * Q.tw + both * t * w,
        rest * P.vv + share * Q.vv + both * v * v,
        rest * P.vw + share * Q.vw + both * v * w,
        rest * P.ww + share * Q.ww + both * w * w,
    )
    return Belief(mean, covariance)


@kernel
def share_of(part: float, rest: float) -> float:
    """Return the share of one weight in the sum of two; 0 if both are 0."""
    total = part + rest
    return part / (total if total > 0.0 else 1.0)


@kernel
def merged(hypotheses: Hypotheses, weights: Three) -> Belief:
    """Return the Gaussian with the moments of all hypotheses."""
    true, high, low = weights
    first = merge(hypotheses.true, hypotheses.high, share_of(high, true))
    return merge(first, hypotheses.low, share_of(low, true + high))


@kernel
def _turned(belief: Belief, turn: float) -> Belief:
    x, y, theta, v, omega = belief.mean
    return Belief(State(x, y, wrap(theta + turn), v, omega), belief.covariance)


@kernel
def begin(z: Pose, tuning: FilterTuning) -> tuple[Hypotheses, Three]:
    """Return a belief for each explanation of the first heading, and their probabilities."""
    spike = 0.0 if tuning.from_origin else tuning.kind.spike
    return explained(wrapped(ekf.initialize(z, tuning).belief), spike), first_weights(tuning)


@kernel
def explained(belief: Belief, spike: float) -> Hypotheses:
    """Return a belief for each explanation of its heading."""
    return Hypotheses(belief, _turned(belief, -spike), _turned(belief, spike))


@kernel
def first_weights(tuning: FilterTuning) -> Three:
    """Return the probabilities of the explanations of a first heading."""
    half = 0.5 * tuning.kind.spike_probability
    return (1.0 - tuning.kind.spike_probability, half, half)


@kernel
def settled(verdict: Verdict, measured: bool, tracks: Tracks, anew: Hypotheses) -> Hypotheses:
    """Return the hypotheses after the gate's verdict: predicted, corrected, or anew."""
    true, high, low = tracks
    return Hypotheses(
        choose(verdict, measured, true.prior, true.belief, anew.true),
        choose(verdict, measured, high.prior, high.belief, anew.high),
        choose(verdict, measured, low.prior, low.belief, anew.low),
    )


@kernel
def _start(senses: Senses, tuning: FilterTuning) -> _MixtureEstimate:
    hypotheses, weights = begin(senses.odometry.pose, tuning)
    return _MixtureEstimate(merged(hypotheses, weights), 0.0, hypotheses, weights, ONE_MEASUREMENT)


@kernel
def track(belief: Belief, odometry: Odometry, tuning: FilterTuning, dt: float, integrator: float) -> _Tracked:
    """Predict a hypothesis, and correct it by a measurement's three explanations."""
    R, share, spike, measured = tuning.R, tuning.kind.spike_probability, tuning.kind.spike, odometry.measured
    prior = predict(belief, odometry.twist, tuning, dt, integrator)
    turn = innovation(prior.mean, odometry.pose).theta
    placed, nis, precision, turn = correct_position(prior, odometry.pose, R, turn)
    h = of_heading(placed.covariance)
    inverse = inverse_of(innovation_variance(h, R[2]))
    high, low = turn - spike, turn + spike
    q_true, q_high, q_low = turn * turn * inverse, high * high * inverse, low * low * inverse
    # Relative to the likeliest explanation; its own power is e^0 = 1.
    near, far = min(q_high, q_low), max(q_high, q_low)
    least, other = min(q_true, near), max(q_true, near)
    of_other, of_far = exp_minus(0.5 * (other - least)), exp_minus(0.5 * (far - least))
    of_true, of_near = (1.0 if q_true <= near else of_other), (of_other if q_true <= near else 1.0)
    is_true = (1.0 - share) * of_true
    is_high = 0.5 * share * (of_near if q_high <= q_low else of_far)
    is_low = 0.5 * share * (of_far if q_high <= q_low else of_near)
    likely = is_true + is_high + is_low
    scale = 1.0 / likely
    is_true, is_high, is_low = is_true * scale, is_high * scale, is_low * scale
    mean = is_true * turn + is_high * high + is_low * low
    off_true, off_high, off_low = turn - mean, high - mean, low - mean
    spread = is_true * off_true * off_true + is_high * off_high * off_high + is_low * off_low * off_low
    posterior = wrapped(absorb(placed, h.column, mean * inverse, inverse - spread * inverse * inverse))
    expected_nis = nis + is_true * q_true + is_high * q_high + is_low * q_low
    return _Tracked(
        posterior if measured else prior,
        expected_nis,
        0.5 * (nis + least) if measured else 0.0,
        likely * max(sqrt(precision * inverse), _LEAST) if measured else 1.0,
        prior,
    )


@kernel
def track_all(hypotheses: Hypotheses, odometry: Odometry, tuning: FilterTuning, dt: float, integrator: float) -> Tracks:
    """Predict and correct all hypotheses."""
    return Tracks(
        track(hypotheses.true, odometry, tuning, dt, integrator),
        track(hypotheses.high, odometry, tuning, dt, integrator),
        track(hypotheses.low, odometry, tuning, dt, integrator),
    )


@kernel
def _fix_one(belief: Belief, z: Pose, R: Variances) -> _Tracked:
    posterior, nis, precision = correct_correlated(belief, z, R)
    return _Tracked(posterior, nis, 0.5 * nis, max(sqrt(precision), _LEAST), belief)


@kernel
def fix_all(hypotheses: Hypotheses, z: Pose, R: Variances) -> Tracks:
    """Correct all hypotheses by an external pose measurement, with R as in `interface.Filter`."""
    return Tracks(_fix_one(hypotheses.true, z, R), _fix_one(hypotheses.high, z, R), _fix_one(hypotheses.low, z, R))


@kernel
def beliefs(tracks: Tracks) -> Hypotheses:
    """Return the hypotheses without their likelihoods."""
    return Hypotheses(tracks.true.belief, tracks.high.belief, tracks.low.belief)


@kernel
def least_exponent(tracks: Tracks) -> float:
    """Return the likeliest hypothesis' exponent, to subtract before weighing."""
    return min(tracks.true.exponent, min(tracks.high.exponent, tracks.low.exponent))


@kernel
def weigh(weights: Three, tracks: Tracks, least: float) -> Three:
    """Return the weights of the hypotheses after a measurement, not normalized yet."""
    true, high, low = tracks
    return (
        weights[0] * true.factor * exp_minus(true.exponent - least),
        weights[1] * high.factor * exp_minus(high.exponent - least),
        weights[2] * low.factor * exp_minus(low.exponent - least),
    )


@kernel
def scaled(weights: Three, factor: float) -> Three:
    """Return weights times a factor."""
    return (weights[0] * factor, weights[1] * factor, weights[2] * factor)


@kernel
def _step(
    estimate: _MixtureEstimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float
) -> _MixtureEstimate:
    """Predict, correct and weigh all hypotheses; see `interface.Filter`."""
    z, measured = senses.odometry.pose, senses.odometry.measured
    tracks = track_all(estimate.hypotheses, senses.odometry, tuning, dt, integrator)
    true, high, low = tracks
    likely = weigh(estimate.weights, tracks, least_exponent(tracks))
    weights = scaled(likely, 1.0 / (likely[0] + likely[1] + likely[2]))
    nis = weights[0] * true.nis + weights[1] * high.nis + weights[2] * low.nis
    verdict = judge(estimate.rejections, measured, nis > tuning.kind.gate, tuning, dt)
    hypotheses = settled(verdict, measured, tracks, explained(restart(true.prior, z, tuning), tuning.kind.spike))
    weights = either(verdict.lost, first_weights(tuning), either(verdict.refused, estimate.weights, weights))
    belief = merged(hypotheses, weights)
    return _MixtureEstimate(belief, nis if measured else estimate.nis, hypotheses, weights, verdict.rejections)


@kernel
def _fix(estimate: _MixtureEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _MixtureEstimate:
    """Correct and weigh all hypotheses; see `interface.Filter`."""
    tracks = fix_all(estimate.hypotheses, z, R)
    likely = weigh(estimate.weights, tracks, least_exponent(tracks))
    weights = scaled(likely, 1.0 / (likely[0] + likely[1] + likely[2]))
    hypotheses = beliefs(tracks)
    return _MixtureEstimate(merged(hypotheses, weights), estimate.nis, hypotheses, weights, estimate.rejections)


MIXTURE = Filter(_start, _step, _fix, kind=Mixture(spike_probability=0.02, spike=0.3))
"""Models heading spikes."""
