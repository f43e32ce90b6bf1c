"""Where the sensors of a recording are on the robot: by the transforms that do not move, or assumed, which is said.

ROS 2 states fixed transforms on ``/tf_static``, ROS 1 repeats them on ``/tf``: on either topic, what never changes counts.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.mounts import FAR, MOST, TILT, StaticFrames, differ
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.drives.rotations import is_unit

STILL = 1e-3
"""Difference of two transforms up to which a frame has not moved, m and rad."""
BODIES = ("base_footprint", "base_link")
"""Usual frames of a robot, where odometry does not name a frame that is known."""


class _Stated(NamedTuple):
    """What is stated of a frame in another one."""

    transforms: tuple[Any, ...]
    """The first transform, and of ``/tf_static`` the first that contradicts it."""
    topic: str
    moves: bool = False


class Mount(NamedTuple):
    """Where a LiDAR is on the robot."""

    pose: Pose
    """In the robot's frame."""
    is_inverted: bool
    """Whether it hangs upside down: then its beams turn the other way around."""
    remark: str
    """What a person should know about it, or an empty text."""


class Mounting:
    """The frames on a robot, by its transforms."""

    def __init__(self) -> None:
        self._stated: dict[tuple[str, str], _Stated] = {}

    def hear(self, message: Any, topic: str) -> None:
        """Take a message of ``/tf`` or ``/tf_static``, whose topic is named as in `messages.TYPES`."""
        for transform in message.transforms:
            edge = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
            at, q = transform.transform.translation, transform.transform.rotation
            if not all(abs(number) < FAR for number in (at.x, at.y, at.z, q.x, q.y, q.z, q.w)) or not is_unit(q):
                continue
            if edge not in self._stated and len(self._stated) >= MOST:
                raise ValueError(f"there are more than {MOST} frames")
            before = self._stated.setdefault(edge, _Stated((transform,), f"/{topic}"))
            if (
                len(before.transforms) == 1
                and not before.moves
                and _differ(before.transforms[0].transform, transform.transform)
            ):
                is_fixed = before.topic == "/tf_static"
                self._stated[edge] = before._replace(
                    transforms=(*before.transforms, transform) if is_fixed else before.transforms, moves=not is_fixed
                )

    def between(self, odometry: tuple[str, str], frame: str) -> tuple[NDArray[np.float64] | None, str]:
        """Return a sensor's frame in the robot's frame, shape (4, 4), m, and the topic that states it or why nothing does.

        Args:
            odometry: Frame of odometry and of the robot, by its messages; either may be empty.
            frame: The sensor's frame.

        Raises:
            ValueError: With one line, if a frame on the way is stated twice, differently.
        """
        if not frame:
            return None, "its messages name no frame"
        topics = sorted({stated.topic for stated in self._stated.values() if not stated.moves})
        still, all_ = StaticFrames(" and ".join(topics)), StaticFrames()
        for edge, stated in self._stated.items():
            message = SimpleNamespace(transforms=stated.transforms)
            all_.hear(message)
            if not stated.moves and edge[0] != odometry[0].lstrip("/"):  # a robot that stands is not fixed to its floor
                still.hear(message)
        known = {name for edge in self._stated for name in edge}
        below = [child for parent, child in self._stated if parent == odometry[0].lstrip("/")]
        bodies = dict.fromkeys(name for name in (odometry[1].lstrip("/"), *below, *BODIES) if name)
        for body in bodies:
            if (matrix := still.between(body, frame)) is not None:
                return matrix, "the frame of its messages" if body == frame.lstrip("/") else " and ".join(topics)
        body = next((name for name in bodies if name in known), next(iter(bodies)))
        try:
            is_moving = all_.between(body, frame) is not None
        except ValueError:
            is_moving = True
        if is_moving:
            return None, f"{frame!r} moves against {body!r}"
        return None, f"no transform says where {frame!r} is on {body!r}"

    def lidar(self, odometry: tuple[str, str], frame: str, preset: Lidar, given: Pose | None) -> Mount:
        """Return where the LiDAR is: as given, else as stated, else as the preset has it.

        Args:
            odometry: See `between`.
            frame: The LiDAR's frame.
            preset: The LiDAR.
            given: The pose that a person states; None for none.
        """
        assumed = Pose(preset.x, preset.y, preset.yaw)
        try:
            matrix, said = self.between(odometry, frame)
            pose, is_inverted = (None, False) if matrix is None else _level(matrix, frame)
        except ValueError as error:
            pose, is_inverted, said = None, False, str(error)
        if given is not None:
            other = pose is not None and differ(pose, given)
            return Mount(
                given, is_inverted, f"the LiDAR is {_place(given)}, as given, and not as {said} states" if other else ""
            )
        if pose is None:
            remark = f"{said}: the LiDAR is assumed {_place(assumed)}, as its preset has it; --mount X Y YAW states its pose"
            return Mount(assumed, is_inverted, remark)
        hung = ", upside down" if is_inverted else ""
        is_other = is_inverted or differ(pose, assumed)
        return Mount(
            pose, is_inverted, f"the LiDAR is {_place(pose)}{hung}, by {said} and not by its preset" if is_other else ""
        )

    def gyro(self, odometry: tuple[str, str], frame: str) -> tuple[NDArray[np.float64], str]:
        """Return by what an IMU's turning rates must be multiplied for the robot's, shape (3,), and a remark."""
        try:
            matrix, said = self.between(odometry, frame)
        except ValueError as error:
            matrix, said = None, str(error)
        if matrix is None:
            return np.array([0.0, 0.0, 1.0]), f"{said}: the IMU is assumed level"
        tilt = math.degrees(math.acos(max(min(matrix[2, 2], 1.0), -1.0)))
        about = f"the IMU is tilted by {tilt:.0f} degrees, by {said}: its turning rates are turned into the robot's frame"
        return matrix[2, :3], about if tilt > math.degrees(TILT) else ""


def _level(matrix: NDArray[np.float64], frame: str) -> tuple[Pose, bool]:
    """Return the pose of a level LiDAR, and whether it hangs upside down; a ``ValueError`` refuses one that is tilted."""
    if abs(matrix[2, 2]) < math.cos(TILT):
        tilt = math.degrees(math.acos(matrix[2, 2]))
        raise ValueError(f"{frame!r} is tilted by {tilt:.0f} degrees, and a scan must be level")
    pose = Pose(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))
    return pose, bool(matrix[2, 2] < 0.0)


def _place(pose: Pose) -> str:
    return f"at x {pose.x:.3f} m, y {pose.y:.3f} m, turned by {pose.theta:.3f} rad"


def _differ(first: Any, second: Any) -> bool:
    """Return whether two transforms differ."""
    a, b, p, q = first.translation, second.translation, first.rotation, second.rotation
    alike = abs(p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z)
    return math.hypot(a.x - b.x, a.y - b.y, a.z - b.z) > STILL or alike < math.cos(0.5 * STILL)
