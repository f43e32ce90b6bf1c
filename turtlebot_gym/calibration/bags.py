"""Reading a recorded drive from a ROS 2 bag, without ROS: `rosbags` decodes the messages.

Odometry comes from a topic of type Odometry; the truth or a fix from Odometry, PoseStamped, PoseWithCovarianceStamped,
TransformStamped or similar; the twist from the odometry, or from a topic of type Twist or TwistStamped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.calibration.log import Log, interpolated, make_log
from turtlebot_gym.models.angles import yaw_of_quaternion
from turtlebot_gym.topics import Topics

SUFFIXES = (".db3", ".mcap")
"""File name endings of bags."""
FEWEST = 20
"""Fewest messages that a topic must have."""
_POSES = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
_TWISTS = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist")
TRUTHS = ("/ground_truth", "/true_state", "/truth")
"""Topics that are searched for the truth."""


def is_bag(path: Path) -> bool:
    """Return whether a path names a bag: a folder, or a file of one."""
    return path.is_dir() or path.suffix in SUFFIXES


def read_bag(path: str | Path, *, topics: Topics | None = None) -> Log:
    """Read a drive from a bag, with one row for each odometry message.

    Args:
        path: The bag's folder, or a ``.mcap`` or ``.db3`` file.
        topics: The topic of each quantity.

    Raises:
        ValueError: If the path is not a bag, the bag is cut short or empty, or a topic is missing; the message names
            bag and topic.
        ImportError: If rosbags is not installed.
    """
    wanted = topics or Topics()
    with opened_bag(Path(path)) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        truth = wanted.truth or next((name for name in TRUTHS if name in kinds), "")
        _require(path, kinds, {wanted.odom: _POSES[:1], truth: _POSES, wanted.fix: _POSES, wanted.twist: _TWISTS})
        names = [name for name in (wanted.odom, truth, wanted.fix, wanted.twist) if name]
        told, remarks = _messages(path, reader, names)
    odom = told[wanted.odom]
    if len(odom) < FEWEST:
        raise ValueError(f"{path}: topic {wanted.odom!r} has {len(odom)} messages with increasing time; {FEWEST} are needed.")
    time, poses, twist = odom[:, 0], odom[:, 1:4], odom[:, 4:6]
    if wanted.twist:
        twist = _held(told[wanted.twist], time)
    if wanted.fix:
        poses = _nearest(told[wanted.fix], time)
    true = interpolated(told[truth][:, 0], told[truth][:, 1:4], time) if truth else None
    good = np.asarray(np.isfinite(twist).all(axis=1))
    if not good.all():
        remarks.append(f"{path}: {(~good).sum()} of {len(good)} messages have no finite twist: left out")
    joined = np.concatenate([[False], good[:-1]])[good]
    origin = time[0]
    return make_log(
        time[good] - origin,
        twist[good],
        poses[good],
        None if true is None else true[good],
        joined=joined,
        remarks=tuple(remarks),
    )


@contextmanager
def opened_bag(path: Path) -> Iterator[Any]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ImportError(f"{path} is a bag, which needs rosbags: pip install 'rosbags>=0.10.9,<0.12'") from error
    if not path.exists():
        raise ValueError(f"{path}: there is no such bag.")
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        reader.open()
    except Exception as error:  # storage plugins raise errors of their own, sqlite3's among them
        raise ValueError(f"{path}: the bag is damaged or incomplete: {_line(error)}") from error
    try:
        yield reader
    finally:
        reader.close()


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _require(path: str | Path, kinds: dict[str, str], wanted: dict[str, tuple[str, ...]]) -> None:
    if not kinds:
        raise ValueError(f"{path}: the bag is empty: it has no topics.")
    for name, allowed in wanted.items():
        if name and name not in kinds:
            raise ValueError(f"{path}: there is no topic {name!r}; there are {', '.join(sorted(kinds))}.")
        if name and kinds[name] not in allowed:
            raise ValueError(f"{path}: topic {name!r} has the type {kinds[name]}; it must be {' or '.join(allowed)}.")


def _messages(path: str | Path, reader: Any, names: list[str]) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """Return time, pose and twist of the messages on some topics, shape (n, 6) each; NaN where a message lacks one."""
    rows: dict[str, list[list[float]]] = {name: [] for name in names}
    remarks: list[str] = []
    connections = [connection for connection in reader.connections if connection.topic in rows]
    try:
        for connection, received, data in reader.messages(connections):
            message = reader.deserialize(data, connection.msgtype)
            rows[connection.topic].append(pose_and_twist(message, received * 1e-9))
    except Exception as error:  # decoding raises whatever the storage and the codec raise
        done = sum(map(len, rows.values()))
        if not done:
            raise ValueError(f"{path}: its messages cannot be read: {_line(error)}") from error
        remarks.append(f"{path}: the bag is cut short after {done} messages; these are used")
    told = {}
    for name, found in rows.items():
        if not found:
            raise ValueError(f"{path}: topic {name!r} has no messages.")
        table = np.array(found, np.float64)
        newest = np.maximum.accumulate(table[:, 0])
        back = np.concatenate([[False], table[1:, 0] <= newest[:-1]])
        if back.any():
            what = (
                f"{path}: topic {name!r}: {back.sum()} of {len(back)} messages, first number {int(np.flatnonzero(back)[0]) + 1}"
            )
            remarks.append(f"{what}, have a time that does not increase: left out")
        told[name] = table[~back]
    return told, remarks


def pose_and_twist(message: Any, received: float) -> list[float]:
    """Return time, x, y, heading, speed and turning rate of a message."""
    header = getattr(message, "header", None)
    stamp = header.stamp.sec + header.stamp.nanosec * 1e-9 if header is not None else 0.0
    outer = getattr(message, "pose", None)
    inner = getattr(outer, "pose", outer)
    if (
        outer is not None and hasattr(outer, "covariance") and outer.covariance[0] < 0.0
    ):  # how this project marks a lost measurement
        inner = None
    twist = getattr(message, "twist", None)
    twist = getattr(twist, "twist", twist) if twist is not None else (message if hasattr(message, "angular") else None)
    pose = [math.nan] * 3
    if inner is not None:
        q = inner.orientation
        pose = [inner.position.x, inner.position.y, yaw_of_quaternion(q.w, q.x, q.y, q.z)]
    speeds = [math.nan] * 2 if twist is None else [twist.linear.x, twist.angular.z]
    return [stamp or received, *pose, *speeds]


def _held(table: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the twist in force before each time: a command holds until the next one."""
    at = np.searchsorted(table[:, 0], time, side="left") - 1
    twist = table[np.maximum(at, 0), 4:6].copy()
    twist[at < 0] = 0.0
    return twist


def _nearest(table: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Assign each pose to the row nearest in time; other rows are NaN."""
    poses = np.full((len(time), 3), np.nan)
    at = np.clip(np.searchsorted(time, table[:, 0]), 1, len(time) - 1)
    at -= (table[:, 0] - time[at - 1]) < (time[at] - table[:, 0])
    near = np.abs(time[at] - table[:, 0]) < np.median(np.diff(time))
    poses[at[near]] = table[near, 1:4]
    return poses
