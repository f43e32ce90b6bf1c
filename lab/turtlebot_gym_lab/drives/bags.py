"""A bag of ROS 2 or ROS 1 as a drive, without ROS: `rosbags` decodes the messages."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym_lab.drives.clocks import AHEAD, SIMULATED
from turtlebot_gym_lab.drives.messages import ODOMETRY, POSES, TRANSFORMS, TWISTS, TYPES, DriveListener
from turtlebot_gym_lab.drives.topics import Topics

_TRUTHS = ("ground_truth", "true_state", "truth")
"""Topics that are searched for the truth."""
_ASKED = ("odom", "true_state", "fix", "twist")
"""Topics whose names `Topics` holds; the others are searched beside that of the odometry, and in the root."""
_CLOCKED = ("true_state", "fix", "twist", "scan", "estimate", "imu")
"""Topics that may come from another computer."""
_UNREADABLE = (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)
_MAGIC = {b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap", b"#ROSBAG V2.0": ".bag"}


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a folder, or a file of one, judged by its first bytes."""
    return path.is_dir() or path.suffix in _MAGIC.values() or (path.is_file() and _suffix(path) is not None)


def read_bag(path: Path, *, topics: Topics, label: str, lidar: str) -> Drive:
    """Read a bag; see `reading.read`."""
    listener, remarks = DriveListener(lidar=find_lidar(lidar)), []
    with _opened(path) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        roles, child = _roles(path, kinds, topics)
        done = read = 0
        try:
            wanted = [connection for connection in reader.connections if connection.topic in roles]
            for connection, received, data in reader.messages(wanted):
                topic = roles[connection.topic]
                message = reader.deserialize(data, connection.msgtype)
                done += 1
                with suppress(*_UNREADABLE):
                    listener.hear(topic, message, received * 1e-9, child=child if topic == "true_state" else "")
                    read += 1
        except Exception as error:  # decoding raises whatever the storage and the codec raise
            if not done:
                raise ValueError(f"{path}: its messages cannot be read: {_line(error)}") from error
            remarks.append(f"{path}: the bag is cut short after {done} messages; these are used")
    if read < done:
        remarks.append(f"{path}: {done - read} of {done} messages are not what their topics hold: left out")
    for name, topic in roles.items():
        stream = listener[topic]
        if not stream and topic in _ASKED:
            raise ValueError(f"{path}: topic {name!r} has no messages{f' about {child!r}' if child else ''}.")
        if stream.late and topic not in ("map", "obstacles", "diagnostics", "tf_static"):
            late = f"{path}: topic {name!r}: {len(stream.late)} of {stream.count} messages, first number {stream.late[0]}"
            remarks.append(f"{late}, have a time that does not increase: left out")
    mounting = [remark] if listener["scan"] and (remark := listener.mount()[1]) else []
    remarks += [f"{path}: {remark}" for remark in (*_by_one_clock(listener, roles), *mounting)]
    time = np.array(listener["odom"].times)
    if len(time) < 2:
        raise ValueError(f"{path}: a drive needs two messages on odom, got {len(time)}; there are {', '.join(sorted(kinds))}.")
    moves = known(listener.rows(time).twist)
    if not moves.all():
        remarks.append(f"{path}: {(~moves).sum()} of {len(moves)} messages have no finite twist: left out")
    if moves.sum() < 2:
        raise ValueError(f"{path}: a drive needs two messages with a twist, got {moves.sum()}.")
    drive = listener.rows(time[moves], start=time[0])
    return replace(
        drive,
        joined=np.concatenate([[False], moves[:-1]])[moves],
        around=drive.around._replace(label=label),
        remarks=tuple(remarks),
    )


def _by_one_clock(listener: DriveListener, roles: dict[str, str]) -> list[str]:
    """Move the times of all topics to the clock of the odometry, in place, and return remarks on the clocks."""
    remarks, odom = [], listener.clocks["odom"]
    if AHEAD < odom.ahead < SIMULATED:
        remarks.append(f"the clock of the odometry is {odom.ahead:.3f} s ahead of the recorder's")
    for name, topic in roles.items():
        clock = listener.clocks.get(topic, odom)
        if clock.resets:
            remarks.append(
                f"topic {name!r}: the clock was set back {len(clock.resets)} times, first by {clock.resets[0]:.3f} s"
            )
        if topic in _CLOCKED and (lead := clock.lead(odom)):
            listener[topic].times[:] = [time - lead for time in listener[topic].times]
            how = "ahead of" if lead > 0.0 else "behind"
            remarks.append(f"topic {name!r}: its clock is {abs(lead):.3f} s {how} that of the odometry: its times are moved")
    return remarks


def _roles(path: Path, kinds: dict[str, str], wanted: Topics) -> tuple[dict[str, str], str]:
    """Return the topics to read, each with its name in `messages.TYPES`, and the child frame of a truth in transforms."""
    if not kinds:
        raise ValueError(f"{path}: the bag is empty: it has no topics.")
    odom = wanted.odom
    namespaced = [name for name in kinds if name.endswith(odom)]
    if odom not in kinds and len(namespaced) == 1:
        odom = namespaced[0]
    truth, _, child = wanted.truth.partition(":")
    roles: dict[str, str] = {}
    for name, role, allowed in (
        (odom, "odom", (ODOMETRY,)),
        (truth, "true_state", POSES),
        (wanted.fix, "fix", POSES),
        (wanted.twist, "twist", TWISTS),
    ):
        if name and name not in kinds:
            raise ValueError(f"{path}: there is no topic {name!r}; there are {', '.join(sorted(kinds))}.")
        if name and kinds[name] not in allowed:
            raise ValueError(f"{path}: topic {name!r} has the type {kinds[name]}; it must be {' or '.join(allowed)}.")
        if name in roles:
            raise ValueError(f"{path}: topic {name!r} is named for two quantities.")
        if name:
            roles[name] = role
    if truth and kinds[truth] in TRANSFORMS and not child:
        raise ValueError(f"{path}: {truth!r} holds transforms: name the robot's frame, such as {truth}:base_footprint.")
    space = odom.rpartition("/")[0]
    searched = [(name, "true_state") for name in _TRUTHS if not truth] + [(name, name) for name in TYPES if name not in _ASKED]
    for name, role in searched:
        present = next((topic for topic in (f"{space}/{name}", f"/{name}") if kinds.get(topic) in TYPES[role]), None)
        if present and present not in roles and (role != "true_state" or role not in roles.values()):
            roles[present] = role
    return roles, child


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ImportError(f"{path} is a bag, which needs rosbags: pip install 'rosbags>=0.10.9,<0.12'") from error
    if not path.exists():
        raise ValueError(f"{path}: there is no such bag.")
    with TemporaryDirectory() as folder:
        try:
            reader = AnyReader([_by_its_content(path, Path(folder))], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            reader.open()
        except Exception as error:  # storage plugins raise errors of their own, sqlite3's among them
            raise ValueError(f"{path}: the bag is damaged or incomplete: {_line(error)}") from error
        try:
            yield reader
        finally:
            reader.close()


def _suffix(path: Path) -> str | None:
    """Return the file name ending of a bag's file by its first bytes; None if they are another file's."""
    with path.open("rb") as file:
        first = file.read(16)
    return next((suffix for magic, suffix in _MAGIC.items() if first.startswith(magic)), None)


def _by_its_content(path: Path, folder: Path) -> Path:
    """Return a name of a bag by which `rosbags` knows its format: its own, or that of a link in a folder."""
    suffix = _suffix(path) if path.is_file() else None
    if suffix is None or path.suffix == suffix:
        return path
    link = folder / f"bag{suffix}"
    link.symlink_to(path.absolute())
    return link


def _line(error: BaseException) -> str:
    """Return an error's text on one line, shortened: a library's may hold all definitions of a damaged file."""
    return textwrap.shorten(str(error), 300, placeholder=" ...") or type(error).__name__
