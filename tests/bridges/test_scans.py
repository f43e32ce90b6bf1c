"""Scans as messages: no bit is lost, each beam is judged by itself, and only what cannot be read at all is refused."""

import math

import numpy as np
import pytest
from bench import over_the_wire
from burger import Parameters
from drive_samples import recorded
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import RawScan as MonitorScan
from turtlebot_gym.rooms.lidar import LIDARS, SECTORS, SIGHT
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan
from turtlebot_gym.rooms.sectors import NARROW, NEAR, Pooling
from turtlebot_gym.values import Command
from turtlebot_gym_ros.node.convert import conversion

WAY = conversion(Scan)
INF, NAN = np.float32(np.inf), np.float32(np.nan)


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


def test_each_beam_is_judged_by_itself():
    ranges = [0.0, 0.11, -1.0, 0.12, 3.5, 3.6, math.inf, -math.inf, math.nan]
    read = WAY.read(over_the_wire(a_message(9, ranges=ranges))).ranges
    np.testing.assert_array_equal(read, np.array([INF, NAN, NAN, 0.12, 3.5, INF, INF, 0.12, NAN], np.float32))


@pytest.mark.parametrize("changes", [{"ranges": []}, {"angle_increment": 0.0}, {"ranges": [math.nan] * 360}])
def test_what_cannot_be_read_at_all_is_refused_with_one_line(changes):
    """By the rule of the collision monitor, whose tests list what that is."""
    with pytest.raises(ValueError, match=r"^(the|none of the) scan.*$"):
        WAY.read(over_the_wire(a_message(**changes)))


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
    single = np.full(beams, INF)
    single[5] = 1.0  # a single thing seen: the sector around its direction, and no other but a neighbour's edge
    (seen,) = np.flatnonzero(np.array(Pooling(yaw=yaw)(scan._replace(ranges=single))) < 1.0)
    off = (directions[5] - seen * 2.0 * math.pi / SECTORS + math.pi) % (2.0 * math.pi) - math.pi
    assert abs(off) <= math.pi / SECTORS + 1e-6


def test_an_unexpected_number_of_beams_is_refused():
    scan = WAY.read(a_message(180))
    assert len(Pooling()(scan)) == len(Pooling(beams=180)(scan)) == SECTORS
    with pytest.raises(ValueError, match="the scan has 180 beams, but lidar_beams says 360"):
        Pooling(beams=360)(scan)


ROOM = np.random.default_rng(0).uniform(0.3, 3.0, 360).astype(np.float32)
"""Ranges by the degree, of a LiDAR that looks along the robot."""
WHOLE = Scan(ROOM, 0.0, math.radians(1.0), 0.12, 3.5)


@pytest.mark.parametrize(
    "same",
    [
        WHOLE._replace(ranges=ROOM[::-1], first=math.radians(359.0), increment=-math.radians(1.0)),
        WHOLE._replace(ranges=np.roll(ROOM, 100), first=-math.radians(100.0)),
        WHOLE._replace(ranges=np.append(ROOM, ROOM[0])),
        WHOLE._replace(first=float(np.float32(-2.0 * math.pi)), increment=float(np.float32(math.radians(1.0)))),
        WHOLE._replace(ranges=np.repeat(ROOM, 2), increment=math.radians(0.5)),
    ],
    ids=["clockwise", "another start", "first is last", "single precision", "twice the beams"],
)
def test_a_room_looks_the_same_whatever_the_order_of_the_beams(same):
    assert Pooling()(same) == Pooling()(WHOLE)


def shares(ranges):
    return np.array(Pooling()(WHOLE._replace(ranges=np.asarray(ranges, np.float32))))


def test_a_sector_of_which_a_scan_says_nothing_is_never_free_unless_what_is_beside_it_is():
    """A few sectors take the shorter range beside them, more of them at most a metre."""
    for width, most in ((1, 3.0), (NARROW, 3.0), (NARROW + 1, NEAR), (35, NEAR)):
        for left, right in ((2.0, 3.0), (3.0, 2.5), (0.4, 3.0)):
            ranges = np.full(360, left, np.float32)
            ranges[: 10 * width + 10] = np.nan
            ranges[5 : 5 + 10 * width] = np.nan
            ranges[10 * width + 5 : 10 * width + 15], ranges[355:], ranges[:5] = left, right, right
            unknown = shares(ranges)[1 : width + 1]
            if width < 35:
                np.testing.assert_allclose(unknown * SIGHT, min(left, right, most), rtol=1e-6)
            else:
                np.testing.assert_allclose(unknown * SIGHT, min(right, most), rtol=1e-6)


@pytest.mark.parametrize("lost", [0.02, 0.1, 0.5, 0.95])
def test_a_missing_beam_shows_no_more_room_than_one_that_returned_nothing(lost):
    rng = np.random.default_rng(1)
    for _ in range(50):
        gone = rng.random(360) < lost
        assert (shares(np.where(gone, np.nan, ROOM)) <= shares(np.where(gone, np.inf, ROOM))).all()


@pytest.mark.parametrize("distance", [0.25, -0.125, math.inf, 0.0])
def test_a_clearance_travels_and_one_that_is_no_number_is_refused(distance):
    way = conversion(Clearance)
    assert way.read(over_the_wire(way.write(Clearance(distance), Header()))) == Clearance(distance)
    with pytest.raises(ValueError, match="not a number"):
        way.read(way.write(Clearance(math.nan), Header()))


def recorded_scans():
    """The scans of a real TurtleBot3, 62.7 s on 549 turns of its LDS-02, with their stamps."""
    with AnyReader([recorded("turtlebot3")], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        scans = reader.messages([connection for connection in reader.connections if connection.topic == "/scan"])
        return [reader.deserialize(data, connection.msgtype) for connection, _, data in scans]


def test_every_scan_of_a_real_turtlebot3_is_used_by_policies_and_monitor():
    scans = recorded_scans()
    pooled, monitor, passed = Pooling(), Arbiter(Parameters(collision_monitor=True), 0.0).monitor, 0
    for at, message in enumerate(scans):
        assert np.isfinite(pooled(WAY.read(message))).all()
        limits = message.range_min, message.range_max
        scan = MonitorScan(message.ranges, message.angle_min, message.angle_increment, *limits, message.header.frame_id)
        monitor.hear(scan, sent=0.11 * at)
        passed += monitor.limit(Command(0.2, 0.0), 0.11 * at) == Command(0.2, 0.0)  # nothing was nearer than 0.5 m
    assert (len(scans), passed) == (549, 549)


@pytest.mark.parametrize("lost", [0.0, 0.02, 0.05, 0.1])
def test_at_least_99_of_100_scans_of_a_driver_that_loses_beams_are_used(lost):
    rng, used = np.random.default_rng(3), 0
    monitor = Arbiter(Parameters(collision_monitor=True), 0.0).monitor
    for at in range(300):
        ranges = rng.uniform(1.0, 4.0, 261).astype(np.float32)
        ranges[rng.random(len(ranges)) < lost] = np.nan
        scan = Scan(ranges, 0.0, 2.0 * math.pi / len(ranges), 0.0, 100.0)
        message = over_the_wire(WAY.write(scan, Header(frame_id="base_scan")))
        assert np.isfinite(Pooling()(WAY.read(message))).all()
        monitor.hear(MonitorScan(message.ranges, scan.first, scan.increment, 0.0, 100.0, "base_scan"), sent=0.11 * at)
        used += monitor.limit(Command(0.2, 0.0), 0.11 * at) == Command(0.2, 0.0)
    assert used >= 297


def test_obstacles_travel_as_markers():
    way = conversion(Obstacles)
    room = Obstacles((1.0, -1.0, 2.5, 2.0), ((0.5, 0.25, 0.3), (-1.0, 0.0, 0.1)), ((0.0, 1.0, 0.4, 1.2, 0.7),))
    message = over_the_wire(way.write(room, Header(frame_id="odom")))
    assert [marker.header.frame_id for marker in message.markers] == ["odom"] * 4
    assert len({(marker.ns, marker.id) for marker in message.markers}) == 4
    back = way.read(message)
    for read, other in zip(back, room, strict=True):
        np.testing.assert_allclose(read, other, rtol=1e-12)
    message.markers.pop(0)
    with pytest.raises(ValueError, match="no walls"):
        way.read(message)


def test_presets_lose_nothing_at_their_limits():
    """The limits of every preset are single-precision numbers that their own ranges respect."""
    for lidar in LIDARS.values():
        least = lidar.range_min or 0.001  # 0 means that nothing returned
        ends = np.array([least, lidar.range_max] * (lidar.beams // 2) + [1.0] * (lidar.beams % 2), np.float32)
        scan = Scan(ends, 0.0, 2.0 * math.pi / lidar.beams, lidar.range_min, lidar.range_max)
        assert WAY.read(over_the_wire(WAY.write(scan, Header()))).ranges.tobytes() == ends.tobytes()


def test_a_scan_is_a_laser_scan():
    assert WAY.message is LaserScan
    assert not WAY.in_world  # it stands in the LiDAR's frame
