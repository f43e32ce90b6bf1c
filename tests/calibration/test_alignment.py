"""Clocks: the likeliest shift of a grid, and the lag of a motion that is known."""

import math

import numpy as np
import pytest

from turtlebot_gym.calibration.alignment import NO_SHIFT, _best, _shift_truth, _twist_delay
from turtlebot_gym.drives import Drive

GRID = 0.1 * np.arange(-5, 6)


def test_a_parabola_has_its_top_between_the_places_of_the_grid():
    # -50 (s - 0.03)^2 falls by half of chi-square's 3.841 at 0.03 +- 0.196: of the grid, -0.1 to 0.2 are within.
    found = _best(GRID, -50.0 * (GRID - 0.03) ** 2 + 7.0)
    assert found == pytest.approx((0.03, -0.2, 0.3, False))


@pytest.mark.parametrize(("height", "is_sure"), [(9.9, False), (10.1, True)])
def test_a_shift_is_sure_where_none_is_far_less_likely(height, is_sure):
    found = _best(GRID, np.where(np.abs(GRID - 0.3) < 0.01, height, 0.0))
    assert found == pytest.approx((0.3, 0.2, 0.4, is_sure))


def test_at_the_end_of_the_grid_there_is_no_parabola():
    assert _best(GRID, 100.0 * GRID).value == pytest.approx(0.5)
    assert _best(GRID, -100.0 * GRID).value == pytest.approx(-0.5)


@pytest.mark.parametrize("lag", [-0.2, 0.1, 0.3])
@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi, 2.0])
def test_a_robot_that_follows_its_twist_later_lags_by_that(heading, lag):
    """On a straight line in any direction, with a speed that swings."""
    time = 0.05 * np.arange(1200)
    speed, swing = 0.2, 1.3

    def way(at):
        return speed * at - 0.1 / swing * np.cos(swing * at)

    twist = np.stack([np.gradient(way(time), time), np.zeros(len(time))], axis=1)
    driven = way(time - lag)
    poses = np.stack([driven * math.cos(heading), driven * math.sin(heading), np.full(len(time), heading)], axis=1)
    found = _twist_delay(Drive(time=time, twist=twist, true_state=poses), poses, 0.1)
    assert found.value == pytest.approx(lag, abs=0.03)  # a twist of a row is that of the interval before it
    assert found.is_sure


def test_a_short_drive_tells_nothing_of_clocks():
    time = 0.05 * np.arange(40)
    poses = np.zeros((40, 3))
    assert _twist_delay(Drive(time=time, twist=np.zeros((40, 2)), true_state=poses), poses, 0.1) == NO_SHIFT


def test_poses_that_lag_behind_the_truth_get_the_truth_of_their_own_moment():
    time = 0.1 * np.arange(10)
    drive = Drive(time=time, true_state=np.column_stack([time, 0.0 * time, 0.0 * time]))
    np.testing.assert_allclose(_shift_truth(drive, 0.2).truth[:, 0], [np.nan, np.nan, *(time[2:] - 0.2)], atol=1e-12)
