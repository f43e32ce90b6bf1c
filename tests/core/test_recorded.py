"""Wheel odometry as recordings have it: leaps, resets, wrong directions and gaps, and what dead reckoning makes of them."""

import math
from itertools import pairwise

import numpy as np
import pytest

from turtlebot_gym.estimation.filters import KalmanFilter
from turtlebot_gym.models.odometry import counted, sense
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.parameters import OdometryNoise
from turtlebot_gym.presets import WHEEL, matched
from turtlebot_gym.values import STOP, Command, Odometry, Pose

KEY, DT = episode_key(3, 0), 0.1
BEFORE, AFTER = Pose(1.5, 2.5, 0.5), Pose(1.6, 2.55, 0.6)


def wheel(**numbers):
    return OdometryNoise(wheel=True, **numbers)


@pytest.mark.parametrize(("rate", "v", "dt"), [("leap", 0.1, 0.1), ("reset", 0.1, 0.05), ("reverse", -0.1, 0.1)])
def test_rates_are_per_tenth_of_a_second(rate, v, dt):
    numbers, steps = {f"{rate}_probability": 0.1, "leap": 1.0}, round(4000 * DT / dt)
    wrong = sum(counted(BEFORE, AFTER, v, wheel(**numbers), KEY, at, dt) != AFTER for at in range(steps))
    assert abs(wrong - 400) < 4.0 * math.sqrt(400.0)  # one key in 10^4
    assert all(counted(BEFORE, AFTER, v, wheel(leap=1.0), KEY, at, dt) == AFTER for at in range(100))


def test_a_leap_has_its_length_in_any_direction_and_its_turn_to_either_side():
    noise = wheel(leap_probability=1.0, leap=0.3, leap_turn=0.4)
    poses = [counted(BEFORE, AFTER, 0.1, noise, KEY, at, DT) for at in range(400)]
    x, y, theta = np.array(poses).T - np.array([AFTER]).T
    np.testing.assert_allclose(np.hypot(x, y), 0.3)
    np.testing.assert_allclose(np.abs(theta), 0.4)
    # Sums of 400 directions and of 400 sides: each bound is more than four standard deviations.
    assert max(abs(x.sum()), abs(y.sum())) < 4.0 * 0.3 * math.sqrt(200.0)
    assert abs(theta.sum()) < 4.0 * 0.4 * math.sqrt(400.0)


def test_a_reset_is_at_the_origin_and_reverse_motion_is_mirrored():
    assert counted(BEFORE, AFTER, 0.1, wheel(reset_probability=1.0), KEY, 1, DT) == Pose(0.0, 0.0, 0.0)
    noise = wheel(reverse_probability=1.0)
    assert counted(BEFORE, AFTER, 0.1, noise, KEY, 1, DT) == AFTER
    assert counted(BEFORE, AFTER, -0.1, noise, KEY, 1, DT) == pytest.approx((1.4, 2.45, 0.6))


@pytest.mark.parametrize("gap_end", [1.0, 0.25])
def test_gaps_are_as_long_as_they_should_be(gap_end):
    noise, odometry, lost = OdometryNoise(dropout_probability=0.05, gap_end=gap_end), Odometry(BEFORE, STOP, True), []
    for at in range(1, 8000):
        odometry = sense(AFTER, AFTER, STOP, odometry, noise, KEY, at)
        lost.append(not odometry.measured)
    starts = sum(now and not before for before, now in pairwise(lost))
    expected = 1.0 / min(gap_end, 1.0 - noise.dropout_probability)  # a loss may follow a loss by chance
    assert sum(lost) / starts == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(("way", "lost", "carried"), [(0.31, 0, True), (0.33, 0, False), (0.35, 2, True), (0.37, 2, False)])
def test_a_leap_is_what_is_farther_than_the_twist_explains_in_the_time_since_the_last_pose(way, lost, carried):
    """0.3 m beyond 0.2 m/s for 0.1 s, and for 0.3 s after two lost poses."""
    kf = KalmanFilter(matched(WHEEL))
    kf.start(Pose(0.0, 0.0, 0.0))
    for _ in range(lost):
        kf.step(Command(0.2, 0.0))
    kf.step(Command(0.2, 0.0), Pose(way, 0.0, 0.0))
    assert bool(kf.belief.mean[0] == pytest.approx(way)) is carried
