"""The statistics that judge filters, and the bound on how good one can be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.consistency import cramer_rao_bound, heading_information, mean_bounds, nees, normalized
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import advance, execute
from turtlebot_gym.parameters import FilterTuning, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import DOCUMENTED, TUTORIAL
from turtlebot_gym.values import Command, Odometry, Pose, Senses, State

RNG_SEED = 11


def gaussian(n, seed=RNG_SEED):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5))
    P = root @ root.T + 0.1 * np.eye(5)
    return rng.multivariate_normal(np.zeros(5), P, n), P


def test_nees_is_chi_square():
    # Kolmogorov and Smirnov: a right one fails for one seed in 10^4.
    error, P = gaussian(4000)
    error[:, 2] = np.clip(error[:, 2], -3.0, 3.0)  # beyond pi the heading's error would be wrapped
    values = nees(error, np.zeros(5), P, components=2)
    assert stats.kstest(values, "chi2", args=(2,)).pvalue > 1e-4
    assert stats.kstest(1.1 * values, "chi2", args=(2,)).pvalue < 1e-4


def test_nees_is_the_quadratic_form_with_the_heading_wrapped():
    P = np.diag([1.0, 4.0, 0.25, 9.0, 16.0])
    estimate, truth = np.array([1.0, 2.0, 3.0, 3.0, 4.0]), np.array([0.0, 0.0, -3.0, 0.0, 0.0])
    heading = (6.0 - 2.0 * math.pi) ** 2 / 0.25
    assert nees(estimate, truth, P) == pytest.approx(1.0 + 1.0 + heading + 1.0 + 1.0)
    assert nees(estimate, truth, P, components=3) == pytest.approx(2.0 + heading)
    assert estimate[2] == 3.0  # the caller's
    many = nees(np.stack([estimate] * 6).reshape(2, 3, 5), truth, np.stack([P] * 6).reshape(2, 3, 5, 5))
    assert many.shape == (2, 3)
    assert normalized([2.0, 0.0, 0.0], np.diag([4.0, 1.0, 1.0])) == pytest.approx(1.0)


def test_mean_bounds_hold_their_false_alarm_rate():
    # 4000 means, of which 5 % should be outside: binomial, so this fails for one seed in 10^4.
    low, high = mean_bounds(5, 20, false_alarm=0.05)
    means = np.random.default_rng(RNG_SEED).chisquare(5, (4000, 20)).mean(axis=1)
    outside = int(((means < low) | (means > high)).sum())
    assert stats.binomtest(outside, 4000, 0.05).pvalue > 1e-4
    assert stats.binomtest(outside, 4000, 0.03).pvalue < 1e-4  # and it would notice another rate


def test_mean_bounds_narrow_round_the_degrees_of_freedom():
    for degrees in (3, 5):
        widths = []
        for runs in (10, 100, 1000):
            low, high = mean_bounds(degrees, runs, false_alarm=1e-4)
            assert low < degrees < high
            widths.append(high - low)
        assert widths[0] > 2.5 * widths[1] > 6.0 * widths[2]


@pytest.mark.parametrize(
    ("arguments", "name"),
    [((0, 5, 0.1), "degrees"), ((5, 0, 0.1), "runs"), ((5, 5, 0.0), "false_alarm"), ((5, 5, 1.0), "false_")],
)
def test_mean_bounds_refuse_nonsense(arguments, name):
    with pytest.raises(ValueError, match=name):
        mean_bounds(*arguments[:2], false_alarm=arguments[2])


def test_heading_information_without_spikes_is_one_over_the_variance():
    for variance in (1e-8, 0.01, 4.0):
        assert heading_information(OdometryNoise(R=(0.0, 0.0, variance))) == pytest.approx(1.0 / variance, rel=1e-10)
        unused = OdometryNoise(R=(0.0, 0.0, variance), spike=0.3)
        assert heading_information(unused) == pytest.approx(1.0 / variance, rel=1e-10)


def test_heading_information_of_the_presets():
    assert heading_information(TUTORIAL.odometry) * 0.1 == pytest.approx(0.982, abs=5e-4)
    assert heading_information(DOCUMENTED.odometry) * 0.1**2 == pytest.approx(0.908, abs=5e-4)


def test_heading_information_equals_the_integral():
    s, a, e = 0.05, 0.2, 0.1

    def integrand(x):
        parts = [(1.0 - e, 0.0), (0.5 * e, a), (0.5 * e, -a)]
        p = sum(w * stats.norm.pdf(x, m, s) for w, m in parts)
        return sum(w * stats.norm.pdf(x, m, s) * (m - x) / s**2 for w, m in parts) ** 2 / p

    expected, _ = integrate.quad(integrand, -0.7, 0.7, points=[-a, 0.0, a], epsabs=0.0, epsrel=1e-10)
    noise = OdometryNoise(R=(0.0, 0.0, s**2), spike_probability=e, spike=a)
    assert heading_information(noise) == pytest.approx(expected, rel=1e-8)
    assert 1.0 / (s**2 + e * a**2) < heading_information(noise) < 1.0 / s**2


def test_far_spikes_cost_only_their_share():
    noise = OdometryNoise(R=(0.0, 0.0, 0.01**2), spike_probability=0.1, spike=3.0)
    assert heading_information(noise) * 0.01**2 == pytest.approx(1.0, rel=1e-9)  # told apart for certain, they cost nothing


def test_heading_information_needs_white_noise():
    with pytest.raises(ValueError, match=r"OdometryNoise\.R"):
        heading_information(OdometryNoise())


def test_bounds_of_a_mean_are_those_of_the_tables():
    # Tables of chi-square, 2.5 % on each side, for 5, 10 and 12 degrees of freedom; then 5 % on each side for 1.
    assert mean_bounds(5, 1, false_alarm=0.05) == pytest.approx((0.831212, 12.832502), rel=1e-6)
    assert mean_bounds(5, 2, false_alarm=0.05) == pytest.approx((3.246973 / 2.0, 20.483177 / 2.0), rel=1e-6)
    assert mean_bounds(3, 4, false_alarm=0.05) == pytest.approx((4.403789 / 4.0, 23.336664 / 4.0), rel=1e-6)
    assert mean_bounds(1, 1, false_alarm=0.1) == pytest.approx((0.003932, 3.841459), rel=1e-4)


@pytest.mark.parametrize(
    ("degrees", "runs", "false_alarm", "message"),
    [
        (0, 5, 0.1, "degrees and runs must be at least 1, got 0 and 5."),
        (5, 0, 0.1, "degrees and runs must be at least 1, got 5 and 0."),
        (5, 5, 0.0, "false_alarm must be between 0 and 1, got 0.0."),
        (5, 5, 1.0, "false_alarm must be between 0 and 1, got 1.0."),
        (5, 5, math.nan, "false_alarm must be between 0 and 1, got nan."),
    ],
)
def test_bounds_refuse_nonsense(degrees, runs, false_alarm, message):
    with pytest.raises(ValueError, match="must be") as caught:
        mean_bounds(degrees, runs, false_alarm=false_alarm)
    assert str(caught.value) == message


def test_quadratic_forms_by_hand():
    # [[2, 1], [1, 2]]^-1 = [[2, -1], [-1, 2]] / 3: (2 * 9 - 2 * 3 * 5 + 2 * 25) / 3
    assert normalized([3.0, 5.0], [[2.0, 1.0], [1.0, 2.0]]) == pytest.approx(38.0 / 3.0)
    truth, estimate = np.zeros(5), np.array([1.0, 2.0, -4.0, 0.5, 0.25])  # -4 rad is 2.2832 rad
    assert nees(estimate, truth, np.eye(5)) == pytest.approx(1.0 + 4.0 + (2.0 * math.pi - 4.0) ** 2 + 0.25 + 0.0625)
    assert nees(estimate, truth, np.eye(5), components=2) == pytest.approx(5.0)


def test_heading_information_by_hand():
    # Spikes at a distance `a` on either side, and nothing in between: of p = (N(a) + N(-a)) / 2 the score is
    # a tanh(a x) - x, so the information is 1 - a^2 E[1 / cosh(a x)^2], here by Simpson's rule.
    a, x = 0.5, np.linspace(-12.0, 12.0, 200_001)
    p = (np.exp(-0.5 * (x - a) ** 2) + np.exp(-0.5 * (x + a) ** 2)) / (2.0 * math.sqrt(2.0 * math.pi))
    weights = np.ones_like(x)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    expected = 1.0 - a**2 * float((weights * p / np.cosh(a * x) ** 2).sum() * (x[1] - x[0]) / 3.0)
    noise = OdometryNoise(R=(0.0, 0.0, 1.0), spike_probability=1.0, spike=0.5)
    assert heading_information(noise) == pytest.approx(expected, rel=1e-9)
    with pytest.raises(ValueError, match=r"OdometryNoise\.R must have a positive heading variance for this, got 0\.0\."):
        heading_information(OdometryNoise(R=(1.0, 1.0, 0.0)))


# The bound, against filters on simulated drives.

RUNS, STEPS, DT = 250, 30, 0.1
EXECUTION = ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.1, alpha4=0.02)
R = (0.05**2, 0.04**2, 0.1**2)
TRUE = FilterTuning(Q=(0.0,) * 5, R=R, process=EXECUTION)


def simulate(tuning):
    """Return true states, commands and the filter's errors of some runs."""
    rng = np.random.default_rng(RNG_SEED)
    states, commands, errors = np.zeros((RUNS, STEPS + 1, 5)), np.zeros((RUNS, STEPS, 2)), np.zeros((RUNS, STEPS + 1, 5))
    for run in range(RUNS):
        truth = State(0.0, 0.0, float(rng.uniform(-3.0, 3.0)), 0.0, 0.0)

        def measured(truth):
            x, y, theta = rng.normal(truth[:3], np.sqrt(R)).tolist()
            return Pose(x, y, wrap(theta))

        estimate = ekf.initialize(measured(truth), tuning)
        for k in range(STEPS + 1):
            states[run, k] = truth
            errors[run, k] = np.array(estimate.belief.mean) - truth
            if k < STEPS:
                command = Command(*rng.uniform([0.1, -0.5], [0.22, 0.5]).tolist())
                commands[run, k] = command
                pose = advance(Pose(*truth[:3]), truth.v, truth.omega, DT, 0.5)
                truth = State(*pose, *execute(command, EXECUTION, False, tuple(rng.normal(size=2).tolist()), DT))
                z = measured(truth)
                senses = Senses(Odometry(z, command, True))
                estimate = ekf.step(estimate, senses, senses, tuning, DT, 0.5)
    errors[..., 2] = np.remainder(errors[..., 2] + math.pi, 2.0 * math.pi) - math.pi
    return states, commands, errors


def position_share(tuning):
    """Return the filter's mean squared position error at the end, as a share of the bound."""
    states, commands, errors = simulate(tuning)
    bound = cramer_rao_bound(states, commands, TRUE, dt=DT, integrator="midpoint")
    assert bound.shape == (STEPS + 1, 5, 5)
    return (errors[:, -1, :2] ** 2).sum(axis=1).mean() / np.trace(bound[-1, :2, :2])


def test_a_right_filter_reaches_the_bound():
    # Of two components with nearly equal variances: 2 RUNS times the share is about chi2(2 RUNS); one seed in 10^4 fails.
    low, high = mean_bounds(2, RUNS, false_alarm=1e-4)
    assert low / 2.0 < position_share(TRUE) < high / 2.0


def test_a_wrong_filter_does_not():
    assert position_share(replace(TRUE, Q=(0.05, 0.05, 0.05, 0.1, 0.1))) > mean_bounds(2, RUNS, false_alarm=1e-4)[1] / 2.0


def test_the_bound_is_the_average_of_the_filters_covariances_along_the_truth():
    states, commands, _ = simulate(TRUE)
    one = cramer_rao_bound(states[0], commands[0], TRUE, dt=DT, integrator="midpoint")
    two = cramer_rao_bound(states[1], commands[1], TRUE, dt=DT, integrator="midpoint")
    both = cramer_rao_bound(states[:2], commands[:2], TRUE, dt=DT, integrator="midpoint")
    np.testing.assert_allclose(both, (one + two) / 2.0, rtol=1e-12)
    np.testing.assert_array_equal(one[0], matrix(ekf.initialize(Pose(0.0, 0.0, 0.0), TRUE).belief.covariance))
