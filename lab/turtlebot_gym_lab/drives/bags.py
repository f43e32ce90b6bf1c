"""A bag of ROS 2 or ROS 1 as a drive, without ROS: `rosbags` opens the files and decodes the messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.drives.messages import MEASURED, POSES, TRANSFORMS, TYPES, DriveListener
from turtlebot_gym_lab.drives.topics import ELSEWHERE, Topics

SUFFIXES = (".mcap", ".db3", ".bag")
"""Name endings of the files of bags."""
_TRUTHS = ("ground_truth", "true_state", "truth")
"""Topics that are searched for the truth."""
_SENSORS = ("amcl_pose", "pose", "pose_fix")
"""Usual names of topics with measured poses, the likeliest first."""
_REPAIR = "repair a copy of it, as by `mcap recover` or `ros2 bag reindex`"


def is_bag(path: Path) -> bool:
    """Return whether a path is that of a bag: a folder, or a file of one."""
    return path.is_dir() or path.suffix in SUFFIXES


def read_bag(path: Path, *, topics: Topics, label: str, lidar: str, mount: Pose | None) -> Drive:
    """Read a bag; see `reading.read`."""
    truth, _, frames = topics.truth.partition(":")
    listener, unread, count = DriveListener(lidar=find_lidar(lidar), mount=mount), 0, 0
    with opened(path) as reader:
        kinds = _kinds(reader)
        roles = _roles(path, kinds, replace(topics, truth=truth))
        for connection, received, data in reader.messages([each for each in reader.connections if each.topic in roles]):
            count += 1
            try:
                listener.hear(roles[connection.topic], reader.deserialize(data, connection.msgtype), received * 1e-9)
            except (AttributeError, IndexError, OverflowError, TypeError, ValueError):
                unread += 1
    remarks = [f"{path}: {unread} of {count} messages are not what their topics hold: left out"] if unread else []
    for name, role in roles.items():
        stream = listener[role]
        if stream.late:
            late = f"{len(stream.late)} of {stream.count} messages, first number {stream.late[0]}"
            remarks.append(f"{path}: topic {name!r}: {late}, have a time that does not increase: left out")
    scans = [name for name, kind in kinds.items() if kind in TYPES["scan"]]
    if scans and "scan" not in roles.values():
        remarks.append(f"{path}: scans are on a topic that is not read: {ELSEWHERE} {' or '.join(scans)}")
    time = np.array(listener["odom"].times)
    if len(time) < 2:
        raise ValueError(f"{path}: a drive needs two messages on odom, got {len(time)}; there are {', '.join(sorted(kinds))}.")
    if "tf" in roles.values():
        if not frames:
            raise ValueError(f"{path}: {truth!r} holds transforms: name the robot's frame, as {truth}:map.base_footprint.")
        try:
            listener.take_truth(time, frames)
        except ValueError as error:
            raise ValueError(f"{path}: {truth}: {error}.") from error
    true = listener["true_state"].times
    if true and (true[0] > time[-1] or true[-1] < time[0]):
        ends = [f"{each[0]:.3f} to {each[-1]:.3f} s" for each in (true, time)]
        text = f"the truth's stamps are {ends[0]}, those of the odometry {ends[1]}: wall and simulated time?"
        raise ValueError(f"{path}: {text} Record both with use_sim_time, or both without.")
    if mount is not None and not listener["scan"]:
        raise ValueError(f"{path}: mount says where a LiDAR is, and the bag holds no scans: leave it out.")
    if listener["scan"] and (remark := listener.mount()[1]):
        remarks.append(f"{path}: {remark}")
    moves = known(listener.rows(time).twist)
    if not moves.all():
        remarks.append(f"{path}: {(~moves).sum()} of {len(moves)} messages have no finite twist: left out")
    if moves.sum() < 2:
        raise ValueError(f"{path}: a drive needs two messages with a twist, got {moves.sum()}.")
    drive = listener.rows(time[moves], start=time[0])
    joined = np.concatenate([[False], moves[:-1]])[moves]
    return replace(drive, joined=joined, around=drive.around._replace(label=label), remarks=tuple(remarks))


def sensors_of(path: Path, truth: str) -> list[str]:
    """Return the topics of a bag that state measured poses; see `reading.pose_sensors`."""
    with opened(path) as reader:
        found = [name for name, kind in _kinds(reader).items() if kind == MEASURED and name != truth]
    found = [name for name in found if name.rpartition("/")[2] not in ("initialpose", *_TRUTHS)]
    return next(([name] for end in _SENSORS for name in found if name.endswith(f"/{end}")), sorted(found))


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a bag with rosbags' `AnyReader`.

    Raises:
        ImportError: If rosbags is not installed.
        ValueError: If the bag is missing or damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ImportError(f"{path} is a bag, which needs rosbags: pip install 'rosbags>=0.10.9,<0.12'") from error
    if not path.exists():
        raise ValueError(f"{path}: there is no such bag.")
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            yield reader
    except (ValueError, ImportError, MemoryError):
        raise
    except Exception as error:  # storage plugins raise errors of their own, sqlite3's among them
        why = " ".join(str(error).split())[:300]
        raise ValueError(f"{path}: the bag is damaged or incomplete: {why}: {_REPAIR}.") from error


def _kinds(reader: Any) -> dict[str, str]:
    """Return the types of messages by topic, without topics of which the recorder has heard nothing."""
    heard = [each for each in reader.connections if each.msgcount] or reader.connections
    return {each.topic: each.msgtype for each in heard}


def _roles(path: Path, kinds: dict[str, str], wanted: Topics) -> dict[str, str]:
    """Return the topics to read, each with its name in `messages.TYPES`."""
    odom = _only(kinds, wanted.odom)
    roles: dict[str, str] = {}
    for name, role in (
        (odom, "odom"),
        (wanted.truth, "true_state"),
        (wanted.fix, "fix"),
        (wanted.twist, "twist"),
        (wanted.scan, "scan"),
    ):
        if name and name not in kinds:
            raise ValueError(f"{path}: there is no topic {name!r}; there are {', '.join(sorted(kinds)) or 'none'}.")
        if name and kinds[name] not in TYPES[role]:
            raise ValueError(f"{path}: topic {name!r} has the type {kinds[name]}; it must be {' or '.join(TYPES[role])}.")
        if name in roles:
            raise ValueError(f"{path}: topic {name!r} is named for two quantities.")
        if name:
            roles[name] = role
    space = odom.rpartition("/")[0]
    searched = [] if wanted.truth else [(name, "true_state") for name in _TRUTHS]
    searched += [(name, name) for name in TYPES if name not in ("odom", "true_state", "fix", "twist", "tf")]
    for name, role in searched:
        present = next((topic for topic in (f"{space}/{name}", f"/{name}") if kinds.get(topic) in TYPES[role]), None)
        if present and present not in roles and role not in roles.values():
            roles[present] = role
    return {name: "tf" if role == "true_state" and kinds[name] in TRANSFORMS else role for name, role in roles.items()}


def _only(kinds: dict[str, str], name: str) -> str:
    """Return a topic's name, or that of the only one which has it in a namespace."""
    namespaced = [each for each, kind in kinds.items() if each.endswith(name) and kind in POSES]
    return namespaced[0] if name not in kinds and len(namespaced) == 1 else name
