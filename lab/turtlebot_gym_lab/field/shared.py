"""What the steps of a field test share: the person, the settings, and what was measured on the way."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.calibration import Leg
from turtlebot_gym_lab.field.session import TopicListener
from turtlebot_gym_ros.node.geometry import read_pose

QUIET = ("--log-level", "error")
"""ROS arguments of the nodes that a field test starts: the person reads its findings, not their logs."""


class Person(Protocol):
    """Whoever is with the robot."""

    def confirm(self, key: str, text: str) -> bool:
        """Return whether the person agrees; nothing moves before that."""
        ...

    def number(self, key: str, text: str) -> float | None:
        """Return a number that the person has measured; None if there is none."""
        ...


@dataclass(kw_only=True)
class Field:
    """What the steps share."""

    listener: TopicListener
    person: Person
    robot: str
    folder: Path
    """Folder of the report; the bag and the noise file are beside it."""
    seconds: float = 5.0
    """Time to listen before anything moves, s."""
    distance: float = 1.0
    """Straight to measure, m."""
    turn: float = 360.0
    """Turn to measure, degrees."""
    side: float = 1.0
    """Side of the square, m; like the other drives, 0 leaves it out."""
    duration: float = 120.0
    """Length of the calibration drive, s."""
    tape: float = 0.005
    """Half of the 95 % interval of a measured distance, m."""
    protractor: float = 2.0
    """Half of the 95 % interval of a measured turn, degrees."""
    stamped: bool = True
    """Whether velocities are stamped, as the robot hears them."""
    measured: list[Leg] = field(default_factory=list)
    """Drives that were measured."""
    paths: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """DriveOptions paths, shape (n, 2), m."""
    scan: NDArray[np.float64] | None = None
    """End points of a scan's beams, shape (n, 2), m."""
    begun: int = 0
    """Number of odometry messages before the last drive."""
    recording: ExitStack = field(default_factory=ExitStack)
    """Closing it finishes the bag."""


def poses_since(at: Field, first: int) -> list[Pose]:
    """Return odometry's poses from a message on."""
    return [read_pose(odometry.message.pose.pose) for odometry in at.listener.heard["odom"][first:]]


def drive_since(at: Field, first: int) -> Drive:
    """Return odometry from a message on."""
    poses = np.array(poses_since(at, first))
    heard = at.listener.heard["odom"][first : first + len(poses)]
    return Drive(time=np.array([odometry.stamp or odometry.arrival for odometry in heard]), odometry=poses)


def turned(poses: Sequence[Pose]) -> float:
    """Return the sum of the turns from pose to pose, rad."""
    return sum(wrap(after.theta - before.theta) for before, after in pairwise(poses))


def relative(poses: Sequence[Pose]) -> NDArray[np.float64]:
    """Return a path in the frame of its first pose."""
    places = np.array([complex(pose.x, pose.y) for pose in poses])
    places = (places - places[0]) * np.exp(-1j * poses[0].theta)
    return np.stack([places.real, places.imag], axis=1)


def ends_of(scan: Scan) -> NDArray[np.float64]:
    """Return where a scan's beams end, in the LiDAR's frame."""
    is_hit = np.isfinite(scan.ranges) & (scan.ranges > 0.0)
    angles = scan.first + scan.increment * np.flatnonzero(is_hit)
    return (scan.ranges[is_hit] * np.stack([np.cos(angles), np.sin(angles)])).T.astype(np.float64)
