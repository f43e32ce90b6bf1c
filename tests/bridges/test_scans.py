"""Scans as messages: no bit is lost, each beam is judged by itself, and only what cannot be read at all is refused."""

import math

import numpy as np
import pytest
from bench import over_the_wire
from std_msgs.msg import Header

from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan
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


@pytest.mark.parametrize("distance", [0.25, -0.125, math.inf, 0.0])
def test_a_clearance_travels_and_one_that_is_no_number_is_refused(distance):
    way = conversion(Clearance)
    assert way.read(over_the_wire(way.write(Clearance(distance), Header()))) == Clearance(distance)
    with pytest.raises(ValueError, match="not a number"):
        way.read(way.write(Clearance(math.nan), Header()))


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
