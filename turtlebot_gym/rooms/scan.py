"""A room's data outside of the step: LiDAR scans, clearance and obstacles."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import Beams, beams_of
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.mounts import yaw_of_rotation
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.values import ORIGIN, Pose, State

_CUBE, _CYLINDER, _LINE_STRIP = 1, 3, 4
"""Types of ``visualization_msgs/Marker`` in a room."""


class Scan(NamedTuple):
    """The ranges of a revolution, or of the part of it that a LiDAR sees."""

    ranges: NDArray[np.float32]
    """Ranges, shape (B,), m; infinite where nothing was returned, NaN where a beam is missing."""
    first: float
    """Direction of the first beam in the LiDAR's frame, rad."""
    increment: float
    """Angle from one beam to the next, rad; negative if clockwise."""
    range_min: float
    """Shorter ranges are not returned, m."""
    range_max: float
    """Longer ranges are not returned, m."""
    beam_period: float = 0.0
    """Time between two beams, s; 0 if unknown."""
    period: float = 0.0
    """Time between two scans, s; 0 if unknown."""


def scan_of(message: Any) -> Scan:
    """Return a ``sensor_msgs/LaserScan`` as it was sent, unread."""
    angles, limits = (message.angle_min, message.angle_increment), (message.range_min, message.range_max)
    return Scan(np.asarray(message.ranges, np.float32), *angles, *limits, message.time_increment, message.scan_time)


def beams_in(scan: Scan) -> Beams:
    """Return the beams of a scan as sent; a ``ValueError`` of one line if it cannot be read."""
    limits = {"range_min": scan.range_min, "range_max": scan.range_max}
    return beams_of(scan.ranges, first=scan.first, increment=scan.increment, **limits)


def read_scan(scan: Scan) -> Scan:
    """Return a scan as sent with its ranges as `beams_in` reads them."""
    return scan._replace(ranges=beams_in(scan).ranges)


class Clearance(NamedTuple):
    """Clearance of a robot in a room."""

    distance: float
    """Distance from the footprint to the nearest surface, m; negative on contact."""


class Obstacles(NamedTuple):
    """Walls and obstacles, seen from above."""

    walls: tuple[float, float, float, float]
    """x, y, half length and half width of the room, m."""
    circles: tuple[tuple[float, float, float], ...]
    """x, y and radius of each, m."""
    boxes: tuple[tuple[float, float, float, float, float], ...]
    """x, y, length, width and heading of each; m, rad."""


def mounted(state: State, lidar: Lidar) -> Pose:
    """Return the pose of a LiDAR's frame on a robot."""
    return increment(Pose(*state[:3]), ORIGIN, Pose(lidar.x, lidar.y, lidar.yaw), sincos(state.theta))


def obstacles_of(scene: Scene) -> Obstacles:
    """Return the walls and obstacles of a scene, with walkers at their current positions."""
    room, (n_circles, n_boxes) = scene.room, scene.room.counts
    boxes = [(x, y, 2.0 * a, 2.0 * b, math.atan2(sine, cosine)) for x, y, a, b, cosine, sine in room.boxes[:n_boxes].tolist()]
    return Obstacles(tuple(room.walls.tolist()), tuple(map(tuple, room.circles[:n_circles, :3].tolist())), tuple(boxes))


def room_of(message: Any) -> Obstacles | None:
    """Return a room from its ``visualization_msgs/MarkerArray``: walls as a line, cylinders and cubes; None without walls."""
    walls, circles, boxes = None, [], []
    for marker in message.markers:
        at, q, size = marker.pose.position, marker.pose.orientation, marker.scale
        if marker.type == _CYLINDER:
            circles.append((at.x, at.y, 0.5 * size.x))
        elif marker.type == _CUBE:
            boxes.append((at.x, at.y, size.x, size.y, yaw_of_rotation(q.w, q.x, q.y, q.z)))
        elif marker.type == _LINE_STRIP and len(marker.points) == 5:
            a, b = marker.points[0], marker.points[2]
            walls = 0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (b.x - a.x), 0.5 * (b.y - a.y)
    return None if walls is None else Obstacles(walls, tuple(circles), tuple(boxes))
