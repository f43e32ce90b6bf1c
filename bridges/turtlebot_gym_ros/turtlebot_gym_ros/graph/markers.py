"""Conversion of a running loop's scene to visualization markers. Importing it makes the block `Visualization` a node.

The estimate's ellipse, true state and odometry are not included: viewers draw them from ``/estimate``, ``/true_state`` and
``/odom`` (``rviz/turtlebot.rviz``). Markers expire after `LIFETIME`, so that nothing stays on the screen when the filter or
this node is gone.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from turtlebot_gym.plotting import BLACK, GREEN, VERMILLION
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.blocks.visualization import Scene, Visualization
from turtlebot_gym_ros.node.convert import register
from turtlebot_gym_ros.node.geometry import quaternion_of, unread
from turtlebot_gym_ros.node.rooms import marker

__all__ = ["LIFETIME", "Visualization"]

LIFETIME = 1.0
"""Time after which a viewer removes a marker without an update, s, by the viewer's clock."""
LINE = 0.02
"""Width of a path, m."""
HEIGHT = 0.01
"""Height of a waypoint's disc, and of paths above it, m."""


def _color(html: str, opacity: float = 1.0) -> ColorRGBA:
    red, green, blue = (int(html[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)


_marker = partial(marker, lifetime=LIFETIME)


def _place(marker: Marker, pose: Pose) -> Marker:
    marker.pose.position = Point(x=float(pose.x), y=float(pose.y), z=0.0)
    marker.pose.orientation = quaternion_of(pose.theta)
    return marker


def _waypoint(header: Header, name: str, pose: Pose, radius: float, opacity: float) -> list[Marker]:
    """Return the disc within which a waypoint counts as reached, and its heading as an arrow."""
    disc = _marker(header, name, Marker.CYLINDER, (2.0 * radius, 2.0 * radius, HEIGHT), _color(GREEN, 0.4 * opacity))
    arrow = _marker(header, f"{name}_heading", Marker.ARROW, (radius, 0.06, 0.06), _color(GREEN, opacity))
    return [_place(disc, pose), _place(arrow, pose)]


def _path(header: Header, name: str, points: Iterable[tuple[float, float]], html: str) -> list[Marker]:
    """Return a path as a line; nothing if it has fewer than two points."""
    marker = _marker(header, name, Marker.LINE_STRIP, (LINE, 0.0, 0.0), _color(html))
    marker.points = [Point(x=float(x), y=float(y), z=HEIGHT) for x, y in points]
    return [marker] if len(marker.points) > 1 else []


def _scene_to_message(scene: Scene, header: Header) -> MarkerArray:
    markers = _path(header, "believed_path", scene.believed, VERMILLION) + _path(header, "true_path", scene.true, BLACK)
    if scene.reference is not None:
        markers += _waypoint(header, "waypoint", scene.reference, scene.radius, 1.0)
    if scene.following is not None:
        markers += _waypoint(header, "next_waypoint", scene.following, scene.radius, 0.4)
    return MarkerArray(markers=markers)


register(Scene, MarkerArray, unread, _scene_to_message, in_world=True)
