"""The search and its intervals against likelihoods that are known, and clocks: the likeliest shift of a grid."""

import math

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.drive import Drive
from turtlebot_gym_lab.calibration.alignment import _best, _shift_truth
from turtlebot_gym_lab.calibration.fit import Z, interval, maximize

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


def test_a_profile_maximizes_over_the_other_coordinates():
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


def test_an_undetermined_parameter_has_an_unbounded_interval():
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


GRID = 0.1 * np.arange(-5, 6)


def test_a_parabola_has_its_top_between_the_places_of_the_grid():
    # -50 (s - 0.03)^2 falls by half of chi-square's 3.841 at 0.03 +- 0.196: of the grid, -0.1 to 0.2 are within.
    best = _best(GRID, -50.0 * (GRID - 0.03) ** 2 + 7.0)
    assert best == pytest.approx((0.03, -0.2, 0.3, False))


@pytest.mark.parametrize(("height", "is_sure"), [(9.9, False), (10.1, True)])
def test_a_shift_is_sure_where_none_is_far_less_likely(height, is_sure):
    best = _best(GRID, np.where(np.abs(GRID - 0.3) < 0.01, height, 0.0))
    assert best == pytest.approx((0.3, 0.2, 0.4, is_sure))


def test_at_the_end_of_the_grid_there_is_no_parabola():
    assert _best(GRID, 100.0 * GRID).value == pytest.approx(0.5)
    assert _best(GRID, -100.0 * GRID).value == pytest.approx(-0.5)


def test_poses_that_lag_behind_the_truth_get_the_truth_of_their_own_moment():
    time = 0.1 * np.arange(10)
    drive = Drive(time=time, true_state=np.column_stack([time, 0.0 * time, 0.0 * time]))
    np.testing.assert_allclose(_shift_truth(drive, 0.2).truth[:, 0], [np.nan, np.nan, *(time[2:] - 0.2)], atol=1e-12)
