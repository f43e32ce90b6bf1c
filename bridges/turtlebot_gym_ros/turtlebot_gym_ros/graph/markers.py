"""What viewers draw of a running loop in addition to the poses: a block that collects waypoints and paths, and their markers.

The estimate's ellipse, true state and odometry are not included: viewers draw them from ``/estimate``, ``/true_state`` and
``/odom`` (``rviz/turtlebot.rviz``). Markers expire after `LIFETIME`, so that nothing stays on the screen when the filter or
this node is gone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, NamedTuple

from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.plotting import BLACK, GREEN, VERMILLION
from turtlebot_gym.validation import POSITIVE, check_fields
from turtlebot_gym.values import Pose, State
from turtlebot_gym_ros.node.block import Input, On, Output
from turtlebot_gym_ros.node.convert import register
from turtlebot_gym_ros.node.geometry import quaternion_of, unread
from turtlebot_gym_ros.node.rooms import marker

LIFETIME = 1.0
"""Time after which a viewer removes a marker without an update, s, by the viewer's clock."""
LINE = 0.02
"""Width of a path, m."""
HEIGHT = 0.01
"""Height of a waypoint's disc, and of paths above it, m."""


class MarkerScene(NamedTuple):
    """Waypoints and paths, all in the world frame."""

    reference: Pose | None
    """The waypoint to reach; None if there is none."""
    following: Pose | None
    """The waypoint after it; None after the last one."""
    radius: float
    """Distance within which a waypoint counts as reached, m."""
    believed: Sequence[tuple[float, float]]
    """Path of the estimate, x and y, m."""
    true: Sequence[tuple[float, float]]
    """True path, x and y, m; empty on a robot, where it is unknown."""


class Visualization:
    """Collect waypoints and paths for viewers. No node depends on it; without estimates it publishes nothing.

    Inputs: ``estimate`` (`Estimate`, on ``estimate``), ``reference`` (`Pose`, on ``reference``; optional), ``following``
    (`Pose`, on ``next_reference``; optional), ``truth`` (`State`, on ``true_state``; optional). All in the world frame.
    Outputs: ``scene`` (`MarkerScene`, on ``markers``), in the world frame.
    Parameters: those of `Params`. A reset forgets the paths.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the visualization."""

        period: Annotated[float, POSITIVE.of("s")] = 0.2
        """Least time between two pictures, and between two points of a path, s."""
        trail: Annotated[float, POSITIVE.of("s")] = 120.0
        """Time span of a path, s."""
        radius: Annotated[float, POSITIVE.of("m")] = 0.3
        """Distance within which a waypoint counts as reached, m, as in ``waypoint_generator``."""

        def __post_init__(self) -> None:
            check_fields(self, "")
            if not self.period <= self.trail <= 1e4 * self.period:
                rule = "must satisfy period <= trail <= 10000 period"
                raise ValueError(f"period and trail {rule}, got {self.period!r} and {self.trail!r}.")

    inputs = {
        "estimate": Input(topic="estimate", type=Estimate, reliable=False),
        "reference": Input(topic="reference", type=Pose, required=False),
        "following": Input(topic="next_reference", type=Pose, required=False),
        "truth": Input(topic="true_state", type=State, required=False, reliable=False),
    }
    outputs = {"scene": Output(topic="markers", type=MarkerScene)}
    trigger = On("estimate", period=0.2)

    def __init__(self, params: Params) -> None:
        self.trigger = replace(self.trigger, period=params.period)
        self._radius = params.radius
        self._points = round(params.trail / params.period)
        self.reset()

    def reset(self) -> None:
        """Forget the paths."""
        self._believed: deque[tuple[float, float]] = deque(maxlen=self._points)
        self._true: deque[tuple[float, float]] = deque(maxlen=self._points)

    def step(
        self, dt: float, estimate: Estimate, reference: Pose | None, following: Pose | None, truth: State | None
    ) -> dict[str, MarkerScene]:
        """Return the scene with the current poses at the ends of the paths."""
        self._believed.append((estimate.belief.mean.x, estimate.belief.mean.y))
        if truth is not None:
            self._true.append((truth.x, truth.y))
        ahead = None if following == reference else following
        return {"scene": MarkerScene(reference, ahead, self._radius, tuple(self._believed), tuple(self._true))}


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


def _scene_to_message(scene: MarkerScene, header: Header) -> MarkerArray:
    markers = _path(header, "believed_path", scene.believed, VERMILLION) + _path(header, "true_path", scene.true, BLACK)
    if scene.reference is not None:
        markers += _waypoint(header, "waypoint", scene.reference, scene.radius, 1.0)
    if scene.following is not None:
        markers += _waypoint(header, "next_waypoint", scene.following, scene.radius, 0.4)
    return MarkerArray(markers=markers)


register(MarkerScene, MarkerArray, unread, _scene_to_message, in_world=True)
