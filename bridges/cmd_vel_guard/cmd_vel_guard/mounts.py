"""Where a sensor is on its robot, by the transforms of ``/tf_static``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmd_vel_guard.values import Pose

FAR = 1e5
"""Distance beyond which nothing is mounted on a robot, m."""
TILT = 0.05
"""Greatest tilt of a LiDAR's plane, rad: 0.05 m at 1 m."""
SAME_PLACE, SAME_WAY = 0.02, 0.05
"""Difference up to which two poses of a frame are the same, m and rad."""


MOST = 1000
"""Most frames that are known at a time: no robot has more."""


class StaticFrames:
    """The frames that are fixed on a robot.

    Args:
        topic: Topic that states them, for messages.
    """

    def __init__(self, topic: str = "/tf_static") -> None:
        self._topic = topic
        self._above: dict[str, tuple[str, NDArray[np.float64]]] = {}
        self._rivals: set[str] = set()

    def hear(self, message: Any) -> None:
        """Take a message of the topic: its ``transforms`` are each a TransformStamped."""
        for transform in message.transforms:
            matrix, child = _matrix(transform.transform), transform.child_frame_id.lstrip("/")
            if len(self._above) >= MOST and child not in self._above:
                raise ValueError(f"{self._topic} states more than {MOST} frames")
            above = transform.header.frame_id.lstrip("/"), matrix
            before = self._above.setdefault(child, above)
            if before[0] != above[0] or not np.allclose(before[1], matrix, atol=1e-6):
                self._rivals.add(child)

    def mount(self, body: str, frame: str) -> Pose | None:
        """Return the pose of a sensor's frame in the robot's frame; None if nothing connects the two.

        Raises:
            ValueError: With one line, if a frame on the way is stated twice, differently, or the sensor is tilted.
        """
        matrix = self.between(body, frame)
        if matrix is None:
            return None
        if not math.cos(TILT) <= matrix[2, 2]:
            tilt = math.degrees(math.acos(max(min(matrix[2, 2], 1.0), -1.0)))
            raise ValueError(f"{self._topic} says that {frame!r} is tilted by {tilt:.0f} degrees, and a scan must be level")
        return Pose(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))

    def between(self, body: str, frame: str) -> NDArray[np.float64] | None:
        """Return a frame in another one as a homogeneous matrix, shape (4, 4), m; None if nothing connects the two.

        Raises:
            ValueError: With one line, if a frame on the way is stated twice, differently.
        """
        ways = [self._up(name) for name in (body, frame)]
        shared = next((name for name in ways[1] if name in ways[0]), None)
        if shared is None:
            return None
        passed = {name for way in ways for name in list(way)[: list(way).index(shared)]}
        if rivals := sorted(passed & self._rivals):
            raise ValueError(f"{self._topic} states two different poses of {rivals[0]!r}")
        return np.linalg.inv(ways[0][shared]) @ ways[1][shared]

    def _up(self, name: str) -> dict[str, NDArray[np.float64]]:
        """Return the frames from one upwards, each with the pose of that one in it."""
        name = name.lstrip("/")
        way = {name: np.eye(4)}
        while name in self._above and self._above[name][0] not in way:  # a loop ends
            below = way[name]
            name, matrix = self._above[name]
            way[name] = matrix @ below
        return way


def differ(pose: Pose, other: Pose) -> bool:
    """Return whether two poses of a sensor are different."""
    turn = pose.theta - other.theta
    away = math.hypot(pose.x - other.x, pose.y - other.y)
    return away > SAME_PLACE or abs(math.atan2(math.sin(turn), math.cos(turn))) > SAME_WAY


def _matrix(transform: Any) -> NDArray[np.float64]:
    """Return a transform as a homogeneous matrix, shape (4, 4)."""
    q, at = transform.rotation, transform.translation
    if not all(abs(number) < FAR for number in (q.w, q.x, q.y, q.z, at.x, at.y, at.z)):  # also refuses NaN
        raise ValueError(f"/tf_static states a rotation or a place that is not finite, or beyond {FAR:g} m")
    return from_quaternion((at.x, at.y, at.z), (q.x, q.y, q.z, q.w))


def from_quaternion(place: Sequence[float], xyzw: Sequence[float]) -> NDArray[np.float64]:
    """Return a homogeneous matrix by its place, m, and a quaternion of any length; that of length 0 is no rotation."""
    x, y, z, w = np.array(xyzw) / (math.hypot(*xyzw) or 1.0)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y), place[0]],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x), place[1]],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y), place[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
