"""Where a sensor is on its robot, by the transforms of ``/tf_static``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.values import Pose

FAR, MOST = 1e5, 1000  # distance beyond which nothing is mounted on a robot, m, and most frames that are known
TILT = 0.05  # greatest tilt of a LiDAR's plane, rad: 0.05 m at 1 m
SAME_PLACE, SAME_WAY = 0.02, 0.05  # difference up to which two poses of a frame are the same, m and rad


class StaticFrames:
    """The frames that are fixed on a robot, as ``/tf_static`` states them."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, NDArray[np.float64]]] = {}
        self._rivals: set[str] = set()

    def hear(self, message: Any) -> None:
        """Take a message: its ``transforms`` are each a TransformStamped."""
        for transform in message.transforms:
            child = transform.child_frame_id.lstrip("/")
            if len(self._above) >= MOST and child not in self._above:
                raise ValueError(f"/tf_static states more than {MOST} frames")
            above = transform.header.frame_id.lstrip("/"), _matrix(transform.transform)
            before = self._above.setdefault(child, above)
            if before[0] != above[0] or not np.allclose(before[1], above[1], atol=1e-6):
                self._rivals.add(child)

    def mount(self, body: str, frame: str) -> Pose | None:
        """Return the pose of a sensor's frame in the robot's frame; None if nothing connects the two.

        A ``ValueError`` refuses a frame on the way that is stated twice, differently, and a tilted sensor.
        """
        of_body, of_sensor = self._up(body), self._up(frame)
        shared = next((name for name in of_sensor if name in of_body), None)
        if shared is None:
            return None
        passed = {name for way in (of_body, of_sensor) for name in list(way)[: list(way).index(shared)]}
        if rivals := sorted(passed & self._rivals):
            raise ValueError(f"/tf_static states two different poses of {rivals[0]!r}")
        matrix = np.linalg.inv(of_body[shared]) @ of_sensor[shared]
        if not math.cos(TILT) <= matrix[2, 2]:
            tilt = math.degrees(math.acos(max(min(matrix[2, 2], 1.0), -1.0)))
            raise ValueError(f"/tf_static says that {frame!r} is tilted by {tilt:.0f} degrees, and a scan must be level")
        return Pose(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))

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
    away, turn = math.hypot(pose.x - other.x, pose.y - other.y), math.remainder(pose.theta - other.theta, 2.0 * math.pi)
    return away > SAME_PLACE or abs(turn) > SAME_WAY


def _matrix(transform: Any) -> NDArray[np.float64]:
    """Return a transform as a homogeneous matrix, shape (4, 4), m; a quaternion may have any length, and one of 0 is none."""
    q, at = transform.rotation, transform.translation
    numbers = np.array((q.x, q.y, q.z, q.w, at.x, at.y, at.z), np.float64)
    if not (np.abs(numbers) < FAR).all():  # also refuses NaN
        raise ValueError(f"/tf_static states a rotation or a place that is not finite, or beyond {FAR:g} m")
    x, y, z, w = numbers[:4] / (math.hypot(*numbers[:4]) or 1.0)
    matrix = np.eye(4)
    matrix[:3, 3] = numbers[4:]
    matrix[0, :3] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    matrix[1, :3] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    matrix[2, :3] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return matrix


def yaw_of_rotation(w: float, x: float, y: float, z: float) -> float:
    """Return the heading of a rotation given as a unit quaternion, rad, in [-pi, pi)."""
    half = math.atan2(z, w) if w >= 0.0 else math.atan2(-z, -w)  # q and -q are the same rotation
    yaw = 2.0 * half if x == y == 0.0 else math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return -math.pi if yaw >= math.pi else yaw
