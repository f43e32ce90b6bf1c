"""The search and its intervals, held against likelihoods whose maxima and intervals are known."""

import math

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.calibration.fit import Z, interval, maximize

random = np.random.default_rng(1)


def test_the_mean_and_deviation_of_normal_numbers():
    x = random.normal(3.0, 2.0, 400)

    def likelihood(at):
        mean, deviation = at
        return float(stats.norm.logpdf(x, mean, abs(deviation)).sum())

    fit = maximize(likelihood, np.array([0.0, 1.0]), np.array([1.0, 1.0]))
    np.testing.assert_allclose(fit.x, [x.mean(), x.std()], rtol=1e-3)
    # textbook: s / sqrt(n) and s / sqrt(2 n)
    np.testing.assert_allclose(fit.deviations, [x.std() / 20.0, x.std() / math.sqrt(800.0)], rtol=0.03)
    low, high, is_profile = interval(likelihood, fit, 0)
    assert not is_profile
    np.testing.assert_allclose([low, high], x.mean() + np.array([-Z, Z]) * x.std() / 20.0, rtol=3e-3)


def test_a_skewed_likelihood_has_the_profile_interval():
    # a rate from 4 events: the deviance 2 (n log(n / m) - (n - m)) is 3.84 at 1.21 and 9.43 (by bisection)
    fit = maximize(lambda at: float(4.0 * np.log(at[0]) - at[0]) if at[0] > 0 else -math.inf, np.array([3.0]), np.array([1.0]))
    assert abs(fit.x[0] - 4.0) < 0.1 * 2.0  # a tenth of its standard deviation
    low, high, is_profile = interval(lambda at: float(4.0 * np.log(at[0]) - at[0]) if at[0] > 0 else -math.inf, fit, 0)
    assert is_profile

    def deviance(mean):
        return 2.0 * (4.0 * math.log(4.0 / mean) - (4.0 - mean))

    assert abs(math.sqrt(deviance(low)) - Z) < 0.1
    assert abs(math.sqrt(deviance(high)) - Z) < 0.1


def test_the_profile_lets_the_other_coordinates_go_along():
    # y = a + b, seen with noise, b known to 2: a's interval is that of the sum of both variances, not that of y alone
    def likelihood(at):
        return -0.5 * ((at[0] + at[1] - 5.0) / 0.5) ** 2 - 0.5 * (at[1] / 2.0) ** 2 - 0.001 * (at[0] - 5.0) ** 4

    fit = maximize(likelihood, np.array([0.0, 0.0]), np.array([1.0, 1.0]))
    low, high, is_profile = interval(likelihood, fit, 0)
    assert is_profile
    grid = np.linspace(-5.0, 5.0, 20001)

    def profile(a):
        return max(-0.5 * ((a + grid - 5.0) / 0.5) ** 2 - 0.5 * (grid / 2.0) ** 2) - 0.001 * (a - 5.0) ** 4

    for end in (low, high):
        assert abs(math.sqrt(2.0 * (profile(5.0) - profile(end))) - Z) < 0.1


def test_what_a_likelihood_does_not_say_has_no_end():
    fit = maximize(lambda at: -0.5 * at[0] ** 2, np.array([1.0, 0.0]), np.array([1.0, 1.0]))
    low, high, _ = interval(lambda at: -0.5 * at[0] ** 2, fit, 1)
    assert low == -math.inf
    assert high == math.inf


def test_a_variance_that_may_be_zero_begins_there():
    x = np.array([0.1, -0.2, 0.05, -0.15, 0.2, 0.02])

    def likelihood(at):  # numbers of variance 0.02, and perhaps some more
        return float(stats.norm.logpdf(x, 0.0, math.sqrt(0.02 + at[0] ** 2)).sum())

    fit = maximize(likelihood, np.array([0.1]), np.array([0.1]))
    low, high, _ = interval(likelihood, fit, 0, least=0.0)
    assert low <= 0.0 or low == pytest.approx(-high, rel=0.1)
    assert math.sqrt(max(2.0 * (fit.value - likelihood([high])), 0.0)) == pytest.approx(Z, abs=0.1)
