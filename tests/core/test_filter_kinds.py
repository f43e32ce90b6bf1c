"""Filters that know of outliers, slip and scale, against textbook forms with matrices that share no code with them."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.stats import multivariate_normal

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, make_filter
from turtlebot_gym.estimation.filters import KalmanFilter, filter_of, matrix
from turtlebot_gym.estimation.mixture import exp_minus, merge
from turtlebot_gym.parameters import Gated, Kalman, Mixture, Scale, Slip
from turtlebot_gym.values import Belief, Command, Covariance, Odometry, Pose, Senses, State

DT = 0.1
NOISE = Noise(
    process=ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.05, alpha4=0.02, slip=0.4, slip_start=0.05, slip_end=0.2),
    odometry=OdometryNoise(R=(0.03**2, 0.02**2, 0.05**2), spike_probability=0.1, spike=0.4, dropout_probability=0.1),
)
ROUGH = Noise(
    process=ProcessNoise(slip=0.5, slip_start=0.01, slip_end=0.2),
    odometry=OdometryNoise(R=(0.02**2, 0.02**2, 0.02**2), spike_probability=0.02, spike=0.3, dropout_probability=0.05),
)
PI_3 = (0.9, 0.05, 0.05)
OFFSETS = (0.0, 0.4, -0.4)
"""What the heading is measured too great by, with the probabilities above."""


def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def at(x, y, theta):
    """Return the senses of a robot at rest in a measured pose."""
    return Senses(Odometry(Pose(x, y, theta), Command(0.0, 0.0), True))


def drive(seed, steps=80):
    """Yield commands and measured poses, or None, of a drive with spikes, slip and drop-outs, drawn by numpy."""
    rng = np.random.default_rng(seed)
    x, y, theta, v, omega, slipping = 0.5, -0.3, 2.9, 0.0, 0.0, False
    for k in range(steps + 1):
        if k > 0:
            x, y, theta = x + DT * v * math.cos(theta), y + DT * v * math.sin(theta), wrap(theta + DT * omega)
            slipping = rng.random() >= 0.2 if slipping else rng.random() < 0.05
            command = Command(0.2, 0.8 * math.sin(0.1 * k))
            v, omega = (u * (0.6 if slipping else 1.0) for u in command)
        else:
            command = Command(0.0, 0.0)
        spike = rng.choice(OFFSETS, p=PI_3)
        z = Pose(x + rng.normal(0.0, 0.03), y + rng.normal(0.0, 0.02), wrap(theta + rng.normal(0.0, 0.05) + spike))
        yield command, z if k == 0 or rng.random() > 0.1 else None


def moved(m, P, command, tuning, share=1.0, floor=True):
    """Return the prediction of the textbook: the pose by Euler's rule with the old twist, then a new twist."""
    x, y, theta, v, omega = m
    F = np.zeros((5, 5))
    F[:3, :3] = np.eye(3)
    F[0, 2:4] = -DT * v * math.sin(theta), DT * math.cos(theta)
    F[1, 2:4] = DT * v * math.cos(theta), DT * math.sin(theta)
    F[2, 4] = DT
    mean = np.array(
        [
            x + DT * v * math.cos(theta),
            y + DT * v * math.sin(theta),
            wrap(theta + DT * omega),
            share * command.v,
            share * command.omega,
        ]
    )
    a, v2, w2 = tuning.process, command.v**2, command.omega**2
    Q = np.diag([0.0, 0.0, 0.0, max(a.alpha1 * v2 + a.alpha2 * w2, 0.005**2), max(a.alpha3 * v2 + a.alpha4 * w2, 0.01**2)])
    return mean, F @ P @ F.T + Q


def explained(m, P, z, R):
    """Return the moments of three joint updates, the likelihood of the measurement, and that times its mean NIS."""
    H, parts, surprise = np.eye(3, 5), [], 0.0
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    for share, offset in zip(PI_3, OFFSETS, strict=True):
        nu = np.array([z.x - m[0], z.y - m[1], wrap(z.theta - m[2]) - offset])
        parts.append((share * multivariate_normal.pdf(nu, np.zeros(3), S), m + K @ nu, P - K @ H @ P))
        surprise += parts[-1][0] * (nu @ np.linalg.solve(S, nu))
    mean, P, likelihood = moments(parts)
    return mean, P, likelihood, surprise


def moments(parts):
    """Return mean, covariance and total weight of a mixture of Gaussians whose headings lie near each other."""
    total = sum(weight for weight, _, _ in parts)
    first = parts[0][1]

    def off(m):
        d = m - first
        d[2] = wrap(d[2])
        return d

    if total == 0.0:
        return first, parts[0][2], 0.0
    mean = sum(weight / total * off(m) for weight, m, _ in parts)
    P = sum(weight / total * (P + np.outer(off(m) - mean, off(m) - mean)) for weight, m, P in parts)
    mean = first + mean
    mean[2] = wrap(mean[2])
    return mean, P, total


def ours(tuning, seed):
    """Yield our filter's belief at each step of a drive."""
    start, step, *_ = filter_of(tuning)
    estimate = before = None
    for command, z in drive(seed):
        if estimate is None:
            before = Senses(Odometry(z, command, True))
            estimate = start(before, tuning)
        else:
            senses = Senses(Odometry(z or before.odometry.pose, command, z is not None))
            estimate, before = step(estimate, before, senses, tuning, DT, 0.0), senses
        yield estimate


def hypotheses(z, R):
    """Return the three explanations of a first measurement."""
    P = np.zeros((5, 5))
    P[:3, :3] = R
    return [(share, np.array([z.x, z.y, wrap(z.theta - a), 0.0, 0.0]), P) for share, a in zip(PI_3, OFFSETS, strict=True)]


def mixture_oracle(tuning, seed):
    R, told, nis = np.diag(tuning.R), None, 0.0
    for command, z in drive(seed):
        if told is None:
            told = hypotheses(z, R)
        else:
            told = [(weight, *moved(m, P, command, tuning)) for weight, m, P in told]
            if z is not None:
                after = [(weight, *explained(m, P, z, R)) for weight, m, P in told]
                total = sum(weight * likelihood for weight, _, _, likelihood, _ in after)
                nis = sum(weight * surprise / total for weight, _, _, _, surprise in after)
                told = [(weight * likelihood / total, m, P) for weight, m, P, likelihood, _ in after]
        yield *moments(told), nis


def slip_oracle(tuning, seed):
    R, told, nis = np.diag(tuning.R), None, 0.0
    change = {False: (0.95, 0.05), True: (0.2, 0.8)}  # from gripping, from slipping: to gripping, to slipping
    for command, z in drive(seed):
        if told is None:
            told = {}
            for k, (weight, m, P) in enumerate(hypotheses(z, R)):
                told |= {(k, False): (weight, m, P), (k, True): (0.0, m, P)}
        else:
            told = {key: (weight, *moved(m, P, command, tuning)) for key, (weight, m, P) in told.items()}
            if z is not None:
                after = {key: (weight, *explained(m, P, z, R)) for key, (weight, m, P) in told.items()}
                total = sum(weight * likelihood for weight, _, _, likelihood, _ in after.values())
                nis = sum(weight * surprise / total for weight, _, _, _, surprise in after.values())
                told = {key: (weight * likelihood / total, m, P) for key, (weight, m, P, likelihood, _) in after.items()}
            mixed = {}
            for k, mode in itertools.product(range(3), (False, True)):
                from_grip, from_slip = told[k, False], told[k, True]
                parts = [
                    (from_grip[0] * change[False][mode], *from_grip[1:]), (from_slip[0] * change[True][mode], *from_slip[1:])
                ]  # fmt: skip
                m, P, weight = moments(parts)
                m = np.array([*m[:3], *(u * (0.6 if mode else 1.0) for u in command)])
                mixed[k, mode] = (weight, m, P)
            told = mixed
        yield *moments(list(told.values())), nis


@pytest.mark.parametrize(("kind", "oracle"), [("mixture", mixture_oracle), ("slip", slip_oracle)])
@pytest.mark.parametrize("seed", range(4))
def test_mixtures_are_those_of_the_textbook(kind, oracle, seed):
    tuning = make_filter(kind, NOISE)
    seen = 0.0
    for estimate, (mean, P, total, nis) in zip(ours(tuning, seed), oracle(tuning, seed), strict=True):
        assert total == pytest.approx(1.0)
        assert estimate.nis == pytest.approx(nis, rel=1e-6, abs=1e-9)
        off = np.array(estimate.belief.mean) - mean
        off[2] = wrap(off[2])
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
        np.testing.assert_allclose(matrix(estimate.belief.covariance), P, atol=1e-11)
        seen = max(seen, P[2, 2])
    assert seen > 3.0 * tuning.R[2]  # there was something to be in doubt about


def test_the_scale_is_a_sixth_state_of_the_textbooks_filter():
    tuning = make_filter("scale", NOISE)
    reference = ExtendedKalmanFilter(dim_x=6, dim_z=3)
    reference.R = np.diag(tuning.R)
    H = np.eye(3, 6)
    wrapped = lambda z, h: np.array([z[0] - h[0], z[1] - h[1], wrap(z[2] - h[2])])  # noqa: E731
    for k, (estimate, (command, z)) in enumerate(zip(ours(tuning, 5), drive(5), strict=True)):
        if k == 0:
            reference.x, reference.P = np.array([*z, 0.0, 0.0, 1.0]), np.diag([*tuning.R, 0.0, 0.0, 0.05**2])
        else:
            share = reference.x[5]
            (mean, P), F = moved(reference.x[:5], np.zeros((5, 5)), command, tuning, share), np.zeros((6, 6))
            _, _, theta, v, _, _ = reference.x
            F[:3, :3] = np.eye(3)
            F[0, 2:4], F[1, 2:4] = (
                (-DT * v * math.sin(theta), DT * math.cos(theta)),
                (DT * v * math.cos(theta), DT * math.sin(theta)),
            )
            F[2, 4], F[3, 5], F[4, 5], F[5, 5] = DT, command.v, command.omega, 1.0
            Q = np.zeros((6, 6))
            Q[:5, :5] = P
            reference.x, reference.P = np.array([*mean, share]), F @ reference.P @ F.T + Q
            if z is not None:
                reference.update(np.array(z), lambda x: H, lambda x: x[:3], residual=wrapped)
                reference.x[2] = wrap(reference.x[2])
        np.testing.assert_allclose(estimate.belief.mean, reference.x[:5], atol=1e-9)
        np.testing.assert_allclose(matrix(estimate.belief.covariance), reference.P[:5, :5], atol=1e-11)
        assert estimate.scale.mean == pytest.approx(reference.x[5], abs=1e-9)
        assert estimate.scale.variance == pytest.approx(reference.P[5, 5], abs=1e-12)


def gated_step(heading, rejections=0.0, **changes):
    """Return prior position, measurement and what the gated filter makes of them, with a heading that is off by so much."""
    tuning = replace(make_filter("gated", NOISE), **changes)
    start, step, *_ = filter_of(tuning)
    first = start(at(1.0, 2.0, 0.5), tuning)._replace(rejections=rejections)
    senses = Senses(Odometry(Pose(1.1, 2.05, 0.5 + heading), Command(0.1, 0.2), True))
    return step(first, senses, senses, tuning, DT, 0.0), tuning


def test_a_gate_on_the_heading_keeps_the_position():
    tuning = make_filter("gated", NOISE)
    deviation = math.sqrt(2.0 * tuning.R[2])  # of the difference of two measured headings, at rest
    inside, _ = gated_step(2.5 * deviation)
    outside, _ = gated_step(2.6 * deviation)  # chi-square's 99 % quantile is 6.63, whose root is 2.58
    assert inside.belief.mean.theta == pytest.approx(0.5 + 1.25 * deviation)
    assert outside.belief.mean.theta == pytest.approx(0.5)
    assert (inside.rejections, outside.rejections) == (0.0, 1.0)
    for estimate in (inside, outside):
        assert estimate.belief.mean[:2] == pytest.approx((1.05, 2.025))
        assert estimate.belief.covariance.xx == pytest.approx(0.5 * tuning.R[0])
    assert outside.belief.covariance.tt == pytest.approx(tuning.R[2])
    assert outside.nis == pytest.approx(0.1**2 / (2 * 0.03**2) + 0.05**2 / (2 * 0.02**2) + 2.6**2)


def test_a_filter_that_refuses_for_long_begins_again():
    lost, _ = gated_step(1.0, rejections=9.0)
    assert lost.belief.mean[:3] == pytest.approx((1.1, 2.05, 1.5))
    assert lost.rejections == 0.0
    assert gated_step(1.0, rejections=8.0)[0].belief.mean.theta == pytest.approx(0.5)


@pytest.mark.parametrize("kind", ["mixture", "slip"])
@pytest.mark.parametrize("spike", [0.4, -0.4])
@pytest.mark.parametrize("deviation", [0.05, 0.004])
def test_a_spike_in_the_first_measurement_is_found_out(kind, spike, deviation):
    """A filter that took the first heading for the true one would take all that follow for spikes.

    With the better sensor the wrong explanations are less likely than any number can say.
    """
    tuning = replace(make_filter(kind, NOISE), R=(0.03**2, 0.02**2, deviation**2))
    start, step, *_ = filter_of(tuning)
    estimate = start(at(0.0, 0.0, 1.0 + spike), tuning)
    assert estimate.belief.mean.theta == pytest.approx(1.0 + spike)
    assert estimate.belief.covariance.tt == pytest.approx(deviation**2 + 0.1 * 0.4**2)
    for k in range(10):
        theta = 1.0 - spike if k == 4 else 1.0  # another spike, which the right explanation alone can explain
        senses = Senses(Odometry(Pose(0.0, 0.0, theta), Command(0.0, 0.0), True))
        estimate = step(estimate, senses, senses, tuning, DT, 0.0)
    assert estimate.belief.mean.theta == pytest.approx(1.0, abs=0.01)
    assert estimate.belief.covariance.tt < 0.03**2


@pytest.mark.parametrize("kind", ["gated", "mixture", "slip", "scale"])
def test_what_is_lost_only_moves_the_belief(kind):
    tuning = make_filter(kind, NOISE)
    start, step, *_ = filter_of(tuning)
    senses = Senses(Odometry(Pose(5.0, 5.0, -1.0), Command(0.2, 0.1), False))
    before = start(at(0.0, 0.0, 0.0), tuning)
    after = step(step(before, senses, senses, tuning, DT, 0.0), senses, senses, tuning, DT, 0.0)
    assert abs(after.belief.mean.x) < 0.03
    assert after.nis == 0.0
    assert after.belief.covariance.xx > before.belief.covariance.xx


@pytest.mark.parametrize("kind", ["mixture", "slip", "scale"])
def test_a_filter_that_remembers_more_than_a_belief_begins_with_a_measurement(kind):
    tuning = make_filter(kind, NOISE)
    for given in ({"state": (1.0, 0.0, 0.0, 0.0, 0.0)}, {"covariance": np.eye(5)}):
        with pytest.raises(ValueError, match="begins with its first measurement"):
            KalmanFilter(tuning, **given)
    kf = KalmanFilter(tuning)
    assert kf.rejections == 0
    for half, argument in ((kf.predict, Command(0.1, 0.0)), (kf.update, Pose(0.0, 0.0, 0.0))):
        with pytest.raises(ValueError, match="halves of the extended Kalman filter"):
            half(argument)


def test_exponentials_are_those_of_the_library():
    for q in np.concatenate([[0.0], np.geomspace(1e-300, 60.0, 4000)]).tolist():
        assert exp_minus(q) == pytest.approx(math.exp(-q), rel=3e-12, abs=0.0)
    assert exp_minus(1e9) == exp_minus(60.0)


def test_moments_of_two_beliefs_by_hand():
    one = Belief(State(0.0, 0.0, 3.0, 0.1, 0.2), Covariance(*(0.01 * k for k in range(15))))
    other = Belief(State(1.0, -1.0, -3.0, 0.3, 0.1), Covariance(*(0.02 * k for k in range(15))))
    mean, P, _ = moments(
        [(0.7, np.array(one.mean), matrix(one.covariance)), (0.3, np.array(other.mean), matrix(other.covariance))]
    )
    both = merge(one, other, 0.3)
    np.testing.assert_allclose(both.mean, mean, atol=1e-12)
    np.testing.assert_allclose(matrix(both.covariance), P, atol=1e-12)
    assert merge(one, other, 0.0) == one


def test_tunings_by_name():
    """Numbers of the preset rough: 0.02 rad, spikes of 0.3 rad in 2 %, half of the motion lost in slip."""
    gated, mixture, slip, scale = (make_filter(name, ROUGH) for name in ("gated", "mixture", "slip", "scale"))
    matched = make_filter("matched", ROUGH)
    assert (matched.kind, gated.kind, scale.kind) == (Kalman(), Gated(heading_gate=6.635), Scale())
    assert (type(mixture.kind), type(slip.kind)) == (Mixture, Slip)
    assert matched.R[2] == pytest.approx(0.02**2 + 0.02 * 0.3**2)
    assert gated.R[2] == mixture.R[2] == slip.R[2] == 0.02**2
    assert scale == replace(matched, kind=Scale())
    assert (mixture.kind.spike_probability, mixture.kind.spike) == (slip.kind.spike_probability, slip.kind.spike) == (0.02, 0.3)
    assert mixture.process == gated.process == matched.process
    assert mixture.process.alpha1 > 0.05  # what slip adds in the mean
    assert slip.process == ProcessNoise(slip=0.5, slip_start=0.01, slip_end=0.2)


def test_a_tuning_of_no_filter_is_refused():
    with pytest.raises(ValueError, match=r"FilterTuning\.kind must be one of"):
        filter_of(replace(make_filter("matched", NOISE), kind=NOISE))
    with pytest.raises(ValueError, match="FilterTuning has no gate; it has Q, R"):
        make_filter({"Q": (0.0,) * 5, "R": (1.0,) * 3, "gate": 9.0}, NOISE)


@pytest.mark.parametrize("kind", ["mixture", "slip"])
def test_what_is_certain_stays_certain(kind):
    """Neither the measurement nor the motion has any noise: then nothing can be weighed, and nothing may break."""
    tuning = replace(make_filter(kind, NOISE), R=(0.0, 0.0, 0.0), Q=(0.0,) * 5, process=ProcessNoise())
    tuning = replace(tuning, kind=replace(tuning.kind, spike=0.0))
    start, step, *_ = filter_of(tuning)
    estimate = start(at(0.1, 0.2, 0.3), tuning)
    for _ in range(20):
        senses = Senses(Odometry(Pose(0.1, 0.2, 0.3), Command(0.0, 0.0), True))
        estimate = step(estimate, senses, senses, tuning, DT, 0.0)
    assert estimate.belief.mean == (0.1, 0.2, 0.3, 0.0, 0.0)
    assert max(map(abs, estimate.belief.covariance)) == 0.0
