"""A scan taken in motion, with exact odometry, gives the points of one taken at rest."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.localization.points import Timing, directions, remember, rest, swept, to_points
from turtlebot_gym.rooms.lidar import Lidar, aim
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.sectors import divide
from turtlebot_gym.rooms.sensing import clearance, measure
from turtlebot_gym.values import Pose

PLAN = FloorPlan(walls=(0.3, -0.2, 2.5, 2.0), circles=((1.2, 0.7, 0.2),), boxes=((-1.0, 0.5, 0.6, 0.4, 0.7),))
LIDAR = Lidar(beams=90, rate=5.0, range_min=0.0, range_max=9.0, x=-0.05, y=0.02, yaw=0.6)
POSES = [Pose(-0.4, -0.6, 2.9), Pose(-0.38, -0.58, 3.05), Pose(-0.35, -0.57, -3.08)]
DT = 0.1


def scan():
    """Return the scene after a revolution on the way through the poses."""
    scene, half = PLAN.scene(beams=LIDAR.beams), LIDAR.beams // 2
    aim(scene.lidar.beams, LIDAR)
    divide(scene.lidar.spans, scene.lidar.beams, LIDAR.yaw, LIDAR.beams)
    for at in (1, 2):
        measure(scene, POSES[at - 1], POSES[at], (at - 1) * half, at * half, (at - 1) * DT, 1, LIDAR, DT)
    return scene


def off(interval):
    """Return how far each end lies from the nearest surface, m."""
    scene, trail, points = scan(), np.empty((4, 4)), np.empty((5, LIDAR.beams))
    rest(trail, 0.0, POSES[0])
    for at in (1, 2):
        remember(trail, at * DT, POSES[at])
    timing = Timing(2.0 * DT, interval, LIDAR.x, LIDAR.y, LIDAR.range_max)
    number = to_points(scene.lidar.ranges[1], scene.lidar.beams, 0, timing, trail, points)
    assert number == LIDAR.beams
    x, y, theta = POSES[-1]
    c, s = math.cos(theta), math.sin(theta)
    np.testing.assert_allclose(np.hypot(*points[2:4]), 1.0)
    return np.abs([clearance(scene, x + c * a - s * b, y + s * a + c * b) for a, b in points[:2].T])


def test_deskewed_ends_lie_on_the_surfaces_that_they_hit():
    """The partner: without the times of the beams they miss them."""
    assert off(1.0 / (LIDAR.rate * LIDAR.beams)).max() < 1e-6  # ranges are of single precision
    assert off(0.0).max() > 0.1


def test_the_beams_are_spread_over_those_with_a_measurement_and_successive_scans_use_all():
    timing, trail = Timing(0.0, 0.0, 0.0, 0.0, 400.0), np.zeros((2, 4))
    ranges = np.array([1.0, np.nan, np.inf, 0.0, -1.0, 400.5, 2.0, 3.0], np.float32)
    for turn, most, expected in ((0, 2, [2.0]), (1, 2, [1.0, 3.0]), (2, 2, [2.0]), (0, 3, [1, 2, 3]), (5, 9, [1, 2, 3])):
        points = np.empty((5, most))
        number = to_points(ranges, directions(np.linspace(0.0, 3.0, 8)), turn, timing, trail, points)
        np.testing.assert_array_equal(points[4, :number], expected)
    ranges, points, used = np.arange(1.0, 361.0, dtype=np.float32), np.empty((5, 20)), set()
    for turn in range(18):
        assert to_points(ranges, directions(np.zeros(360)), turn, timing, trail, points) == 20
        np.testing.assert_array_equal(np.diff(points[4]), 18.0)
        used |= set(points[4].tolist())
    assert len(used) == 360


@pytest.mark.parametrize(("rate", "dt", "poses"), [(5.0, 0.1, 4), (10.0, 0.1, 3), (0.5, 0.1, 22)])
def test_a_trail_reaches_back_to_the_first_beam(rate, dt, poses):
    from turtlebot_gym.systems import Options, system_of

    setup = Options(world="clutter", noise="wheel", localizer="match", lidar=replace(LIDAR, rate=rate), dt=dt).setup()
    assert system_of(setup.parameters).surroundings.make([setup.parameters]).memory.trail.shape[1] == poses


def test_the_odometry_counts_its_intervals_since_a_scan_and_during_it():
    trail = np.zeros((3, 4))
    trail[:, 0] = 0.5, 0.4, 0.3
    assert swept(Timing(0.5, 0.0, 0.0, 0.0, 9.0), 90, trail) == (0.0, 0.0)  # measured now, and at once
    assert swept(Timing(0.5, 0.2 / 90, 0.0, 0.0, 9.0), 90, trail) == pytest.approx((0.0, 2.0))
    assert swept(Timing(0.45, 0.0, 0.0, 0.0, 9.0), 90, trail) == pytest.approx((0.5, 0.0))
    assert swept(Timing(0.5, 0.01, 0.0, 0.0, 9.0), 90, np.zeros((3, 4))) == (0.0, 0.0)
