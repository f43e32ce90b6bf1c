"""The parts of conversions: planar poses and twists in messages, which raise a ``ValueError`` for other messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import product
from typing import Any, NamedTuple

from geometry_msgs.msg import Quaternion, TransformStamped, Twist
from std_msgs.msg import Header

from turtlebot_gym.mounts import yaw_of_rotation
from turtlebot_gym.values import Command, Pose
from turtlebot_gym_ros.node.block import FARTHEST


class Conversion(NamedTuple):
    """Conversion of a type of value."""

    message: type
    """Message type."""
    read: Callable[[Any], Any]
    """``read(message)`` returns the value."""
    write: Callable[[Any, Header], Any]
    """``write(value, header)`` returns the message."""
    in_world: bool
    """Whether the value is in the world frame, which the header must then name."""


def unread(message: Any) -> Any:
    """Refuse messages that only others read."""
    raise ValueError("no node takes it as an input")


FASTEST = 1e3
"""Speed, m/s, and turning rate, rad/s, beyond which nothing is."""
_NUDGES = sorted(product(range(-4, 5), repeat=2), key=lambda pair: abs(pair[0]) + abs(pair[1]))
_NORMS = tuple(1.0 + k * 2.0**-24 for k in range(33))
"""Norms of a quaternion: near 1/8 rad the tangent has fewer bits than the angle, and none of norm 1 has some headings."""


def finite(what: str, numbers: Iterable[float], *, most: float = math.inf) -> None:
    """Raise a ``ValueError`` that shows the values if numbers are not finite, or larger than a limit."""
    values = tuple(numbers)
    if not all(map(math.isfinite, values)):
        shown = values if len(values) < 10 else [value for value in values if not math.isfinite(value)][:3]
        raise ValueError(f"{what} must be finite, got {', '.join(f'{value:g}' for value in shown)}")
    if (largest := max(values, key=abs)) and abs(largest) > most:
        raise ValueError(f"{what} holds {largest:g}, and nothing is beyond {most:g}: is it in SI units?")


def place(x: float, y: float, theta: float) -> Pose:
    """Return a planar pose, or raise ``ValueError``: every place that arrives or leaves is checked here."""
    pose = Pose(x, y, theta)
    finite("the pose", pose, most=FARTHEST)
    return pose


def _yaw_of(q: Quaternion) -> float:
    """Return the heading of a rotation, rad, in [-pi, pi); raise ``ValueError`` if its norm is not 1 within 1 %."""
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not abs(norm - 1.0) < 0.01:  # also refuses NaN
        raise ValueError(f"the quaternion ({q.x}, {q.y}, {q.z}, {q.w}) has norm {norm:.3g} instead of 1")
    return yaw_of_rotation(q.w, q.x, q.y, q.z)


def half_turn(yaw: float) -> tuple[float, float]:
    """Return the quaternion's z and w of the rotation about the vertical axis by a heading, rad.

    Sine and cosine are rounded; if that would change the heading, both are moved by a few units in the last place, or the norm
    by at most 2e-6, until `_yaw_of` returns the same number. So a heading in [-pi, pi) arrives as the same float at the other
    end of a topic.
    """
    z, w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    if yaw_of_rotation(w, 0.0, 0.0, z) != yaw and -math.pi <= yaw < math.pi:
        scaled = ((norm * z, norm * w) for norm in _NORMS)
        near = ((a + i * math.ulp(a), b + j * math.ulp(b)) for a, b in scaled for i, j in _NUDGES)
        z, w = next(((a, b) for a, b in near if yaw_of_rotation(b, 0.0, 0.0, a) == yaw), (z, w))
    return z, w


def read_pose(message: Any) -> Pose:
    """Return a planar pose, or raise ``ValueError``."""
    return place(message.position.x, message.position.y, _yaw_of(message.orientation))


def write_pose(message: Any, pose: Iterable[float]) -> None:
    """Write a planar pose, or raise ``ValueError``."""
    x, y, theta = place(*pose)
    message.position.x, message.position.y = float(x), float(y)
    message.orientation.z, message.orientation.w = half_turn(theta)


def transform_to(child: str, pose: Pose, header: Header) -> TransformStamped:
    """Return the transform from a header's frame to one that has a pose in it, or raise ``ValueError``."""
    finite("the pose", pose)
    made = TransformStamped(header=header, child_frame_id=child)
    made.transform.translation.x, made.transform.translation.y = pose.x, pose.y
    made.transform.rotation.z, made.transform.rotation.w = half_turn(pose.theta)
    return made


def read_twist(message: Twist) -> Command:
    """Return a planar twist, or raise ``ValueError``."""
    command = Command(message.linear.x, message.angular.z)
    finite("the twist", command, most=FASTEST)
    return command


def write_twist(message: Twist, v: float, omega: float) -> None:
    """Write a planar twist, or raise ``ValueError``."""
    finite("the twist", (v, omega))
    message.linear.x, message.angular.z = float(v), float(omega)
