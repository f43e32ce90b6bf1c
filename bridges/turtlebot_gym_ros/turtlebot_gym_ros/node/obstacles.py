"""A room's walls and obstacles as visualization markers, which RViz draws and `Recorder` reads back."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geometry_msgs.msg import Point, Pose, Vector3
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from turtlebot_gym.rooms.scan import Obstacles

HEIGHT = 0.3
"""Height at which obstacles are drawn, m."""
LINE = 0.05
"""Width of the line that represents the walls, m."""
LIFETIME = Duration(seconds=3.0)
"""Time after which a viewer removes a marker without an update, by the viewer's clock."""
_GREY = ColorRGBA(r=0.35, g=0.35, b=0.35, a=1.0)


def _marker(header: Header, number: int, kind: int, at: tuple[float, float, float], scale: Sequence[float]) -> Marker:
    x, y, heading = at
    place = Pose(position=Point(x=x, y=y, z=0.5 * HEIGHT))
    place.orientation.z, place.orientation.w = math.sin(0.5 * heading), math.cos(0.5 * heading)
    length, width, height = scale
    return Marker(
        header=header, ns="obstacles", id=number, type=kind, action=Marker.ADD, pose=place, color=_GREY,
        scale=Vector3(x=length, y=width, z=height), lifetime=LIFETIME.to_msg(),
    )  # fmt: skip


def write_obstacles(room: Obstacles, header: Header) -> MarkerArray:
    """Return the markers of a room: the walls as a line, circles as cylinders, boxes as cubes."""
    x, y, a, b = room.walls
    walls = _marker(header, 0, Marker.LINE_STRIP, (0.0, 0.0, 0.0), (LINE, 0.0, 0.0))
    corners = ((-a, -b), (a, -b), (a, b), (-a, b), (-a, -b))
    walls.points = [Point(x=x + u, y=y + v, z=0.0) for u, v in corners]
    markers = [walls]
    for cx, cy, radius in room.circles:
        size = (2.0 * radius, 2.0 * radius, HEIGHT)
        markers.append(_marker(header, len(markers), Marker.CYLINDER, (cx, cy, 0.0), size))
    for bx, by, length, width, heading in room.boxes:
        markers.append(_marker(header, len(markers), Marker.CUBE, (bx, by, heading), (length, width, HEIGHT)))
    return MarkerArray(markers=markers)


def read_obstacles(message: MarkerArray) -> Obstacles:
    """Return the room from markers made by `write_obstacles`.

    Raises:
        ValueError: If the markers hold no walls.
    """
    circles, boxes, walls = [], [], None
    for each in message.markers:
        place = each.pose
        at = place.position.x, place.position.y
        if each.type == Marker.CYLINDER:
            circles.append((*at, 0.5 * each.scale.x))
        elif each.type == Marker.CUBE:
            boxes.append((*at, each.scale.x, each.scale.y, 2.0 * math.atan2(place.orientation.z, place.orientation.w)))
        elif each.type == Marker.LINE_STRIP and len(each.points) == 5:
            low, high = each.points[0], each.points[2]
            walls = 0.5 * (low.x + high.x), 0.5 * (low.y + high.y), 0.5 * (high.x - low.x), 0.5 * (high.y - low.y)
    if walls is None:
        raise ValueError("the markers show no walls")
    return Obstacles(walls, tuple(circles), tuple(boxes))
