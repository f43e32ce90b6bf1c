"""Scans as messages: no bit is lost, what says nothing is infinite, and what cannot be a scan is refused with one line."""

import math
import re

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from turtlebot_gym.rooms.lidar import LIDARS, SECTORS, SIGHT
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Pooling, Scan
from turtlebot_gym_ros.node.convert import conversion

WAY = conversion(Scan)
INF = np.float32(np.inf)


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def a_message(beams=360, **changes):
    """A driver's scan."""
    message = WAY.write(
        Scan(np.full(beams, 2.0, np.float32), 0.0, 2.0 * math.pi / beams, 0.12, 3.5, 0.2 / beams, 0.2),
        Header(frame_id="base_scan"),
    )
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize("beams", [1, 2, 36, 269, 360, 1080])
def test_a_scan_travels_to_the_bit(beams):
    rng = np.random.default_rng(beams)
    single = [float(np.float32(number)) for number in (-1.0, 2.0 * math.pi / beams, 0.12, 3.5, 1e-3, 0.2)]
    for _ in range(20):
        ranges = rng.uniform(0.12, 3.5, beams).astype(np.float32)
        ranges = np.where(rng.random(beams) < 0.2, INF, np.maximum(ranges, np.float32(0.12)))
        scan = Scan(ranges, *single)
        back = WAY.read(over_the_wire(WAY.write(scan, Header())))
        assert back.ranges.dtype == np.float32
        assert back.ranges.tobytes() == ranges.tobytes()
        assert back[1:] == scan[1:]


def test_a_message_says_what_the_definition_asks_for():
    message = a_message(4)
    assert message.angle_max == pytest.approx(1.5 * math.pi)
    assert (message.header.frame_id, message.scan_time, message.time_increment) == ("base_scan", 0.2, 0.05)
    assert len(message.intensities) == 0


def test_what_is_outside_the_limits_returned_nothing_and_too_near_is_near():
    ranges = [0.0, 0.11, -1.0, 0.12, 3.5, 3.6, math.inf, -math.inf]
    read = WAY.read(over_the_wire(a_message(8, ranges=ranges))).ranges
    np.testing.assert_array_equal(read, np.array([INF, INF, INF, 0.12, 3.5, INF, INF, 0.12], np.float32))


@pytest.mark.parametrize("ends", [0, 1])
def test_drivers_may_count_both_ends_of_a_turn(ends):
    increment = 2.0 * math.pi / (360 - ends)
    assert len(WAY.read(a_message(angle_increment=increment)).ranges) == 360


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ranges": []}, "the scan has no ranges"),
        ({"angle_increment": 0.0}, "angle_increment must be positive and finite, got 0"),
        ({"angle_increment": -0.0174}, "angle_increment must be positive"),
        ({"angle_increment": math.nan}, "angle_increment must be positive"),
        ({"angle_increment": math.inf}, "angle_increment must be positive"),
        ({"angle_min": math.nan}, "angle_min must be finite"),
        ({"ranges": [1.0] * 270}, "must look around a whole turn, but 270 beams"),
        ({"ranges": [1.0] * 720}, "must look around a whole turn, but 720 beams"),
        ({"ranges": [math.nan] + [1.0] * 359}, "1 of the scan's 360 ranges are not numbers"),
        ({"ranges": [math.nan] * 360}, "360 of the scan's 360 ranges are not numbers"),
        ({"range_min": 3.5}, "range_min must be below range_max, got 3.5 and 3.5"),
        ({"range_min": math.nan}, "range_min must be below range_max"),
        ({"range_min": -1.0}, "range_min must be below range_max"),
        ({"range_max": math.nan}, "range_min must be below range_max"),
    ],
)
def test_what_cannot_be_a_scan_is_refused_with_one_line(changes, said):
    with pytest.raises(ValueError, match=re.escape(said)) as refused:
        WAY.read(over_the_wire(a_message(**changes)))
    assert "\n" not in str(refused.value)


def nearest_by_hand(ranges, directions):
    """The shortest range in each sector of 10 degrees, by the direction of each beam."""
    sectors = [SIGHT] * SECTORS
    for length, direction in zip(ranges, directions, strict=True):
        at = math.floor(direction / (2.0 * math.pi) * SECTORS + 0.5) % SECTORS
        sectors[at] = min(sectors[at], length)
    return np.array(sectors) / SIGHT


@pytest.mark.parametrize("beams", [180, 269, 360, 1080])
@pytest.mark.parametrize(("yaw", "first"), [(0.0, 0.0), (math.pi / 2.0, 0.0), (0.3, -math.pi), (-2.0, 1.0)])
def test_sectors_are_those_of_the_beams_directions(beams, yaw, first):
    ranges = np.random.default_rng(beams).uniform(0.2, 5.0, beams).astype(np.float32)
    directions = yaw + first + 2.0 * math.pi * (np.arange(beams) + 1e-9) / beams
    scan = Scan(ranges, first, 2.0 * math.pi / beams, 0.12, 12.0)
    on_an_edge = np.abs((directions / (2.0 * math.pi) * SECTORS + 0.5) % 1.0 - 0.5) > 0.499
    if not on_an_edge.any():
        np.testing.assert_allclose(Pooling(yaw=yaw)(scan), nearest_by_hand(ranges, directions), rtol=1e-6)
    one = np.full(beams, INF)
    one[5] = 1.0  # a single thing seen: the sector around its direction, and no other but a neighbour's edge
    (seen,) = np.flatnonzero(np.array(Pooling(yaw=yaw)(scan._replace(ranges=one))) < 1.0)
    off = (directions[5] - seen * 2.0 * math.pi / SECTORS + math.pi) % (2.0 * math.pi) - math.pi
    assert abs(off) <= math.pi / SECTORS + 1e-6


def test_an_unexpected_number_of_beams_is_refused():
    scan = WAY.read(a_message(180))
    assert len(Pooling()(scan)) == len(Pooling(beams=180)(scan)) == SECTORS
    with pytest.raises(ValueError, match="the scan has 180 beams, but lidar_beams says 360"):
        Pooling(beams=360)(scan)


def test_scans_of_different_numbers_of_beams_are_pooled_each_by_its_own():
    """An RPLIDAR's scans differ in length."""
    pool, scans = Pooling(), [WAY.read(a_message(beams)) for beams in (269, 270, 269)]
    for scan in scans:
        scan.ranges[len(scan.ranges) // 2] = 1.0  # behind
        assert np.flatnonzero(np.array(pool(scan)) < 0.5).tolist() in ([17], [18])


@pytest.mark.parametrize("distance", [0.25, -0.125, math.inf, 0.0])
def test_a_clearance_travels(distance):
    way = conversion(Clearance)
    assert way.read(over_the_wire(way.write(Clearance(distance), Header()))) == Clearance(distance)


def test_a_clearance_that_is_no_number_is_refused():
    way = conversion(Clearance)
    with pytest.raises(ValueError, match="not a number"):
        way.read(way.write(Clearance(math.nan), Header()))


def test_obstacles_travel_as_markers():
    way = conversion(Obstacles)
    room = Obstacles((1.0, -1.0, 2.5, 2.0), ((0.5, 0.25, 0.3), (-1.0, 0.0, 0.1)), ((0.0, 1.0, 0.4, 1.2, 0.7),))
    message = over_the_wire(way.write(room, Header(frame_id="odom")))
    assert [marker.header.frame_id for marker in message.markers] == ["odom"] * 4
    assert len({(marker.ns, marker.id) for marker in message.markers}) == 4
    back = way.read(message)
    for one, other in zip(back, room, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    message.markers.pop(0)
    with pytest.raises(ValueError, match="no walls"):
        way.read(message)


def test_presets_lose_nothing_at_their_limits():
    """The limits of every preset are single-precision numbers that their own ranges respect."""
    for lidar in LIDARS.values():
        ends = np.array([lidar.range_min, lidar.range_max] * (lidar.beams // 2) + [1.0] * (lidar.beams % 2), np.float32)
        scan = Scan(ends, 0.0, 2.0 * math.pi / lidar.beams, lidar.range_min, lidar.range_max)
        assert WAY.read(over_the_wire(WAY.write(scan, Header()))).ranges.tobytes() == ends.tobytes()


def test_a_scan_is_a_laser_scan():
    assert WAY.message is LaserScan
    assert not WAY.in_world  # it stands in the LiDAR's frame
