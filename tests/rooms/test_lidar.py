"""The LiDAR: when beams are measured, what they say, what a policy is shown and how blind beams look."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.models.random import SCAN, sub_key
from turtlebot_gym.rooms.lidar import LIDARS, SECTORS, SIGHT, Lidar, age_of_scan, aim, beams_by, bias_of, reading, time_of_beam
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scan import mounted
from turtlebot_gym.rooms.sectors import NEAR, divide, pool
from turtlebot_gym.rooms.sensing import measure
from turtlebot_gym.values import Pose, State

QUIET = Lidar(beams=8, rate=5.0, range_min=0.0, range_max=20.0)
STAND = Pose(0.0, 0.0, 0.0)


def room(half_length, half_width, lidar):
    """Return an empty room with a LiDAR in it."""
    scene = FloorPlan(walls=(0.0, 0.0, half_length, half_width)).scene(beams=lidar.beams)
    aim(scene.lidar.beams, lidar)
    divide(scene.lidar.spans, scene.lidar.beams, lidar.yaw, lidar.beams)
    return scene


@pytest.mark.parametrize(
    ("changes", "beams", "times", "ages"),
    [
        ({}, [0, 4, 8, 12, 16], {0: 0.025, 3: 0.1, 7: 0.2, 8: 0.225}, [0.2, 0.3, 0.2, 0.3, 0.2]),
        ({"stamped_at_end": True}, [0, 4, 8, 12, 16], {7: 0.2}, [0.0, 0.1, 0.0, 0.1, 0.0]),
        ({"beams": 13, "rate": 1.0 / 0.13}, [0, 10, 20, 30, 40], {12: 0.13}, [0.13, 0.23, 0.2, 0.17, 0.14]),
        ({"turning": False}, [0, 0, 8, 8, 16], {0: 0.2, 7: 0.2}, [0.0, 0.1, 0.0, 0.1, 0.0]),
    ],
)
def test_beams_are_measured_one_after_the_other_or_all_at_the_end_of_the_period(changes, beams, times, ages):
    lidar = replace(QUIET, **changes)
    assert [beams_by(at, lidar, 0.1) for at in range(5)] == beams
    assert {beam: time_of_beam(beam, lidar) for beam in times} == pytest.approx(times)
    assert [age_of_scan(at, lidar, 0.1) for at in range(5)] == pytest.approx(ages)


def test_a_reading_has_the_errors_and_limits_that_it_is_said_to_have():
    lidar = replace(QUIET, deviation=0.02, deviation_share=0.05)
    read = np.array([[reading(length, 0.0, beam, 0.0, 7, lidar) for beam in range(4000)] for length in (0.2, 2.0)])
    assert read.mean(axis=1) == pytest.approx([0.2, 2.0], abs=0.006)
    assert read.std(axis=1) == pytest.approx([0.02, 0.1], rel=0.05)
    assert reading(2.0, 0.0, 3, 0.03, 7, QUIET) == pytest.approx(2.06)
    assert reading(1.2345, 0.0, 3, 0.0, 7, replace(QUIET, quantization=0.01)) == pytest.approx(1.23)
    lidar = replace(QUIET, range_min=0.5, range_max=3.0)
    assert [reading(length, 0.5, 0, 0.0, 7, lidar) for length in (0.4, 0.6, 2.9, 3.1)] == [math.inf, 0.6, 2.9, math.inf]
    lost = [reading(1.0, 0.0, beam, 0.0, 7, replace(QUIET, dropout=0.3)) for beam in range(4000)]
    assert np.isinf(lost).mean() == pytest.approx(0.3, abs=0.03)
    biases = np.array([bias_of(sub_key(key, SCAN), replace(QUIET, accuracy=0.05)) for key in range(2000)])
    assert np.abs(biases).max() <= 0.05
    assert (biases.mean(), biases.std()) == pytest.approx((0.0, 0.1 / math.sqrt(12.0)), abs=0.003)


def test_a_lidar_without_noise_reads_the_same_without_draws():
    lidar = replace(QUIET, range_min=0.5, range_max=3.0, quantization=0.01)
    for length in np.linspace(0.0, 3.5, 50).tolist():
        assert reading(length, 0.5, 3, 0.02, 7, lidar) == reading(length, 0.5, 3, 0.02, 7, lidar, False)


def test_beams_begin_at_the_yaw_and_some_are_blind():
    beams = np.empty((3, 8))
    aim(beams, replace(QUIET, yaw=math.pi / 2.0, range_min=0.1, dead=((math.pi - 0.1, 0.2), (-0.1, 0.2))))
    np.testing.assert_allclose(np.arctan2(beams[1], beams[0])[:3], [math.pi / 2.0, 3.0 * math.pi / 4.0, math.pi])
    assert np.flatnonzero(np.isinf(beams[2])).tolist() == [2, 6]  # at 180 and at 0 degrees
    assert beams[2, 0] == 0.1


@pytest.mark.parametrize("beams", [1, 7, 24, 36, 72, 269, 360, 1000])
@pytest.mark.parametrize("yaw", [0.0, math.pi / 2.0, -1.3, 7.7])
def test_a_sector_holds_its_shortest_range_and_what_is_not_measured_is_free(beams, yaw):
    random = np.random.default_rng(beams)
    ranges = random.uniform(0.1, 5.0, beams).astype(np.float32)
    lost = random.random(beams) < 0.1
    sent = np.where(lost, random.choice([np.inf, np.nan, -1.0], beams), ranges).astype(np.float32)
    ranges[lost] = np.inf
    spans, sectors = np.zeros((SECTORS, 2), np.int64), np.zeros(SECTORS, np.float32)
    divide(spans, np.zeros((3, beams)), yaw, beams)
    pool(sent, spans, beams, sectors)
    angles = yaw + 2.0 * np.pi * np.arange(beams) / beams
    for sector, shown in enumerate(sectors):
        off = (angles - sector * 2.0 * np.pi / SECTORS + np.pi) % (2.0 * np.pi) - np.pi
        inside = (off >= -np.pi / SECTORS - 1e-9) & (off < np.pi / SECTORS - 1e-9)
        nearest = np.abs(off) <= np.abs(off).min() + 1e-9  # two of them, where the middle lies between two beams
        allowed = [ranges[inside].min()] if inside.any() else ranges[nearest]
        assert np.abs(shown - np.minimum(allowed, SIGHT) / SIGHT).min() < 1e-6


@pytest.mark.parametrize(
    ("changes", "before", "now", "beams", "ranges"),
    [
        # Beam 0 looks along x while the robot drives 0.4 m towards a wall, and beam 4 looks back.
        ({}, STAND, Pose(0.4, 0.0, 0.0), [0, 4], [5.0 - 0.05, 5.0 + 0.25]),
        # Beam 2 looks to the left, three eighths of the way through a turn.
        ({}, STAND, Pose(0.0, 0.0, 0.4), [2], [2.0 / math.cos(0.4 * 3.0 / 8.0)]),
        ({"x": 0.1, "y": -0.2}, *[Pose(1.0, 0.5, math.pi / 2.0)] * 2, [0, 2, 4, 6], [1.4, 6.2, 2.6, 3.8]),
    ],
)
def test_each_beam_is_cast_from_where_the_lidar_was(changes, before, now, beams, ranges):
    lidar = replace(QUIET, **changes)
    scene = room(5.0, 2.0, lidar)
    measure(scene, before, now, 0, 8, 0.0, 7, lidar, 0.2)
    np.testing.assert_allclose(scene.lidar.ranges[1, beams], ranges, rtol=1e-6)


def test_a_scan_is_published_when_its_last_beam_is_there_and_not_before():
    scene = room(3.0, 3.0, QUIET)
    measure(scene, STAND, STAND, 0, 7, 0.0, 7, QUIET, 0.2)
    assert not scene.lidar.ranges[1].any()
    assert not scene.lidar.sectors.any()
    measure(scene, STAND, STAND, 7, 9, 0.0, 7, QUIET, 0.2)
    assert scene.lidar.ranges[1, 7] == pytest.approx(3.0 * math.sqrt(2.0), rel=1e-6)
    assert scene.lidar.sectors[0] == pytest.approx(3.0 / 3.5, rel=1e-6)


def test_a_lidar_turns_and_moves_with_its_robot():
    """0.1 m ahead and 0.2 m to the left of a robot that looks along y: 0.2 m against x, 0.1 m along y."""
    lidar, beside = Lidar(x=0.1, y=0.2, yaw=3.0), math.pi / 2.0
    for theta, expected in ((0.0, (1.1, 2.2, 3.0)), (beside, (0.8, 2.1, beside + 3.0 - 2.0 * math.pi))):
        assert mounted(State(1.0, 2.0, theta, 0.0, 0.0), lidar) == pytest.approx(expected)


def test_sectors_to_which_a_lidar_is_blind_are_as_near_as_what_is_beside_them_and_never_far():
    lidar = replace(LIDARS["urg04lx"], deviation=0.0, deviation_share=0.0)
    for half_width, behind in ((3.0, NEAR), (0.6, 0.6 / math.sin(math.radians(115.0)))):
        scene = room(3.0, half_width, lidar)
        measure(scene, STAND, STAND, -lidar.beams, 0, 0.0, 7, lidar, 0.1)
        np.testing.assert_allclose(scene.lidar.sectors[13:24] * SIGHT, behind, rtol=0.01)
        assert (scene.lidar.sectors[[12, 24]] * SIGHT > 0.6).all()
