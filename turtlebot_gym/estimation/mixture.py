"""Filters that model heading spikes, and slip: a measured heading is true, or too large or too small by a spike.

A measurement is a mixture of the three, and the posterior is approximated by a Gaussian with the mixture's mean and covariance.
The first measurement has no prior to be weighed against, and a filter that believed a spike there would take all later
measurements for spikes. So three beliefs start, one for each explanation, and later measurements decide between them.

With slip each hypothesis has two modes, gripping and slipping wheels. By interacting multiple models, a measurement updates the
probabilities of the modes, and the modes are mixed by their transition probabilities before the next twist is executed.

References:
    Alspach, Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", *IEEE Transactions on Automatic
    Control* 17 (1972). Bar-Shalom, Li, Kirubarajan (2001), section 1.4.16: the moments of a mixture.
    Blom, Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching coefficients", *IEEE
    Transactions on Automatic Control* 33 (1988).
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.correlated import correct_correlated
from turtlebot_gym.estimation.ekf import correct_position, innovation, predict
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.update import Variances, absorb, innovation_variance, inverse_of, of_heading, wrapped
from turtlebot_gym.kernel import algebra, kernel, sqrt
from turtlebot_gym.models.angles import wrap, wrap_once
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, Mixture, Slip
from turtlebot_gym.values import Belief, Command, Covariance, Odometry, Pose, Senses, State

_LEAST = 1e-100
"""Least density of a measurement, without its exponent, so that one that was certain beforehand does not count as
impossible."""

Three = tuple[float, float, float]


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


class _Tracked(NamedTuple):
    """A hypothesis, and the measurement's likelihood under it, ``factor e^-exponent``."""

    belief: Belief
    nis: float
    exponent: float
    factor: float


class _Tracks(NamedTuple):
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
def _share_of(part: float, rest: float) -> float:
    """Return the share of one weight in the sum of two; 0 if both are 0."""
    total = part + rest
    return part / (total if total > 0.0 else 1.0)


@kernel
def _merged(hypotheses: Hypotheses, weights: Three) -> Belief:
    true, high, low = weights
    first = merge(hypotheses.true, hypotheses.high, _share_of(high, true))
    return merge(first, hypotheses.low, _share_of(low, true + high))


@kernel
def _turned(belief: Belief, turn: float) -> Belief:
    x, y, theta, v, omega = belief.mean
    return Belief(State(x, y, wrap(theta + turn), v, omega), belief.covariance)


@kernel
def begin(z: Pose, tuning: FilterTuning) -> tuple[Hypotheses, Three]:
    """Return a belief for each explanation of the first heading, and their probabilities."""
    belief = wrapped(ekf.initialize(z, tuning).belief)
    spike = 0.0 if tuning.from_origin else tuning.kind.spike
    half = 0.5 * tuning.kind.spike_probability
    return Hypotheses(belief, _turned(belief, -spike), _turned(belief, spike)), (
        1.0 - tuning.kind.spike_probability,
        half,
        half,
    )


@kernel
def _start(senses: Senses, tuning: FilterTuning) -> _MixtureEstimate:
    hypotheses, weights = begin(senses.odometry.pose, tuning)
    return _MixtureEstimate(_merged(hypotheses, weights), 0.0, hypotheses, weights)


@kernel
def track(belief: Belief, odometry: Odometry, tuning: FilterTuning, dt: float, middle: float) -> _Tracked:
    """Predict a hypothesis, and correct it by a measurement's three explanations."""
    R, share, spike, measured = tuning.R, tuning.kind.spike_probability, tuning.kind.spike, odometry.measured
    prior = predict(belief, odometry.twist, tuning, dt, middle)
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
    one = 1.0 / likely
    is_true, is_high, is_low = is_true * one, is_high * one, is_low * one
    mean = is_true * turn + is_high * high + is_low * low
    off_true, off_high, off_low = turn - mean, high - mean, low - mean
    spread = is_true * off_true * off_true + is_high * off_high * off_high + is_low * off_low * off_low
    posterior = wrapped(absorb(placed, h.column, mean * inverse, inverse - spread * inverse * inverse))
    told = nis + is_true * q_true + is_high * q_high + is_low * q_low
    return _Tracked(
        posterior if measured else prior,
        told,
        0.5 * (nis + least) if measured else 0.0,
        likely * max(sqrt(precision * inverse), _LEAST) if measured else 1.0,
    )


@kernel
def track_all(hypotheses: Hypotheses, odometry: Odometry, tuning: FilterTuning, dt: float, middle: float) -> _Tracks:
    """Predict and correct all hypotheses."""
    return _Tracks(
        track(hypotheses.true, odometry, tuning, dt, middle),
        track(hypotheses.high, odometry, tuning, dt, middle),
        track(hypotheses.low, odometry, tuning, dt, middle),
    )


@kernel
def _fix_one(belief: Belief, z: Pose, R: Variances) -> _Tracked:
    posterior, nis, precision = correct_correlated(belief, z, R)
    return _Tracked(posterior, nis, 0.5 * nis, max(sqrt(precision), _LEAST))


@kernel
def _fix_all(hypotheses: Hypotheses, z: Pose, R: Variances) -> _Tracks:
    return _Tracks(_fix_one(hypotheses.true, z, R), _fix_one(hypotheses.high, z, R), _fix_one(hypotheses.low, z, R))


@kernel
def _beliefs(tracks: _Tracks) -> Hypotheses:
    return Hypotheses(tracks.true.belief, tracks.high.belief, tracks.low.belief)


@kernel
def least_exponent(tracks: _Tracks) -> float:
    """Return the likeliest hypothesis' exponent, to subtract before weighing."""
    return min(tracks.true.exponent, min(tracks.high.exponent, tracks.low.exponent))


@kernel
def weigh(weights: Three, tracks: _Tracks, least: float) -> Three:
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
    estimate: _MixtureEstimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, middle: float
) -> _MixtureEstimate:
    """Predict, correct and weigh all hypotheses; see `interface.Filter`."""
    tracks = track_all(estimate.hypotheses, senses.odometry, tuning, dt, middle)
    true, high, low = tracks
    likely = weigh(estimate.weights, tracks, least_exponent(tracks))
    weights = scaled(likely, 1.0 / (likely[0] + likely[1] + likely[2]))
    nis = weights[0] * true.nis + weights[1] * high.nis + weights[2] * low.nis
    hypotheses = _beliefs(tracks)
    return _MixtureEstimate(
        _merged(hypotheses, weights), nis if senses.odometry.measured else estimate.nis, hypotheses, weights
    )


@kernel
def _fix(estimate: _MixtureEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _MixtureEstimate:
    """Correct and weigh all hypotheses; see `interface.Filter`."""
    tracks = _fix_all(estimate.hypotheses, z, R)
    likely = weigh(estimate.weights, tracks, least_exponent(tracks))
    weights = scaled(likely, 1.0 / (likely[0] + likely[1] + likely[2]))
    hypotheses = _beliefs(tracks)
    return _MixtureEstimate(_merged(hypotheses, weights), estimate.nis, hypotheses, weights)


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


@kernel
def _all(gripping: Hypotheses, slipping: Hypotheses, grip: Three, slip: Three) -> Belief:
    share = slip[0] + slip[1] + slip[2]
    return merge(_merged(gripping, grip), _merged(slipping, slip), share)


@kernel
def _slip_start(senses: Senses, tuning: FilterTuning) -> _SlipEstimate:
    """Start from the first measurement, with wheels that grip; see `interface.Filter`."""
    hypotheses, weights = begin(senses.odometry.pose, tuning)
    none = (0.0, 0.0, 0.0)
    return _SlipEstimate(_all(hypotheses, hypotheses, weights, none), 0.0, hypotheses, hypotheses, weights, none)


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
    gripping = merge(gripped, slipped, _share_of(ends, stays))
    slipping = merge(gripped, slipped, _share_of(goes_on, starts))
    return _moving(gripping, twist, 1.0), _moving(slipping, twist, 1.0 - process.slip), stays + ends, starts + goes_on


@kernel
def _weigh_both(estimate: _SlipEstimate, gripped: _Tracks, slipped: _Tracks) -> tuple[Three, Three]:
    least = min(least_exponent(gripped), least_exponent(slipped))
    grip, slip = weigh(estimate.grip_weights, gripped, least), weigh(estimate.slip_weights, slipped, least)
    one = 1.0 / (grip[0] + grip[1] + grip[2] + slip[0] + slip[1] + slip[2])
    return scaled(grip, one), scaled(slip, one)


@kernel
def _slip_fix(estimate: _SlipEstimate, z: Pose, R: Variances, tuning: FilterTuning) -> _SlipEstimate:
    """Correct and weigh all hypotheses; see `interface.Filter`."""
    gripped, slipped = _fix_all(estimate.gripping, z, R), _fix_all(estimate.slipping, z, R)
    grip, slip = _weigh_both(estimate, gripped, slipped)
    gripping, slipping = _beliefs(gripped), _beliefs(slipped)
    return _SlipEstimate(_all(gripping, slipping, grip, slip), estimate.nis, gripping, slipping, grip, slip)


@kernel
def _slip_step(
    estimate: _SlipEstimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, middle: float
) -> _SlipEstimate:
    """Predict, correct and weigh, and mix the modes; see `interface.Filter`."""
    odometry, twist = senses.odometry, senses.odometry.twist
    gripped = track_all(estimate.gripping, odometry, tuning, dt, middle)
    slipped = track_all(estimate.slipping, odometry, tuning, dt, middle)
    grip, slip = _weigh_both(estimate, gripped, slipped)
    nis = (
        grip[0] * gripped.true.nis + grip[1] * gripped.high.nis + grip[2] * gripped.low.nis
        + slip[0] * slipped.true.nis + slip[1] * slipped.high.nis + slip[2] * slipped.low.nis
    )  # fmt: skip
    g_true, s_true, grip_0, slip_0 = _mix(gripped.true.belief, slipped.true.belief, grip[0], slip[0], twist, tuning, dt)
    g_high, s_high, grip_1, slip_1 = _mix(gripped.high.belief, slipped.high.belief, grip[1], slip[1], twist, tuning, dt)
    g_low, s_low, grip_2, slip_2 = _mix(gripped.low.belief, slipped.low.belief, grip[2], slip[2], twist, tuning, dt)
    gripping, slipping = Hypotheses(g_true, g_high, g_low), Hypotheses(s_true, s_high, s_low)
    grip, slip = (grip_0, grip_1, grip_2), (slip_0, slip_1, slip_2)
    belief = _all(gripping, slipping, grip, slip)
    return _SlipEstimate(belief, nis if odometry.measured else estimate.nis, gripping, slipping, grip, slip)


_SPIKES = {"spike_probability": 0.02, "spike": 0.3}
MIXTURE = Filter(_start, _step, _fix, kind=Mixture(**_SPIKES))
"""Models heading spikes."""
SLIP = Filter(_slip_start, _slip_step, _slip_fix, kind=Slip(**_SPIKES))
"""Models heading spikes and slip."""
