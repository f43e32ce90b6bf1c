"""A bag of ROS 2 or ROS 1 as a drive, without ROS: `rosbags` decodes the messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.drives.clocks import AHEAD, SIMULATED, Stamps, apart, rolled_over, stray_stamps
from turtlebot_gym_lab.drives.frames import Request, asked
from turtlebot_gym_lab.drives.messages import MEASURED, ODOMETRY, POSES, TRANSFORMS, TWISTS, TYPES, DriveListener, stamp_of
from turtlebot_gym_lab.drives.salvage import MCAP, ROS_1, SQLITE, suffix_of
from turtlebot_gym_lab.drives.storage import Bag, Message, opened
from turtlebot_gym_lab.drives.topics import ELSEWHERE, Topics

_TRUTHS = ("ground_truth", "true_state", "truth")
"""Topics that are searched for the truth."""
_SENSORS = ("amcl_pose", "pose", "pose_fix")
"""Usual names of topics with measured poses, the likeliest first."""
_NO_SENSORS = ("/initialpose", *(f"/{name}" for name in _TRUTHS))
_ASKED = ("odom", "true_state", "fix", "twist")
"""Topics whose names `Topics` holds; the others are searched beside that of the odometry, and in the root."""
_CLOCKED = ("true_state", "fix", "twist", "scan", "estimate", "imu", "tracks")
"""Topics that may come from another computer."""
_UNTIMED = ("tf", "map", "obstacles", "diagnostics", "tf_static", "mounts")
"""Topics whose messages have no stamp of their own that counts; transforms are judged one by one."""
_UNREADABLE = (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a folder, or a file of one, judged by its first bytes."""
    return path.is_dir() or path.suffix in (SQLITE, MCAP, ROS_1) or (path.is_file() and suffix_of(path) is not None)


def read_bag(path: Path, *, topics: Topics, label: str, lidar: str, mount: Pose | None) -> Drive:
    """Read a bag; see `reading.read`."""
    truth, frames, fixed = asked(topics.truth)
    with opened(path) as bag:
        named = {topics.odom, truth, topics.fix, topics.twist, topics.scan} - {Topics().odom}
        kinds = {name: kind for name, kind in bag.kinds.items() if name in named or name not in bag.silent}
        roles = _roles(path, kinds, replace(topics, truth=truth))
        if fixed and kinds.get(fixed) in TRANSFORMS:
            roles[fixed] = "tf_static"
        listener, remarks = _heard(path, bag, roles, partial(DriveListener, lidar=find_lidar(lidar), mount=mount))
        remarks = [*bag.remarks, *remarks]
    scans = [name for name, kind in kinds.items() if kind in TYPES["scan"]]
    if scans and "scan" not in roles.values():
        remarks.append(f"{path}: scans are on a topic that is not read: {ELSEWHERE} {' or '.join(scans)}")
    tree = next((name for name, role in roles.items() if role == "tf"), "")
    if tree:
        remarks += [f"{path}: {remark}" for remark in _chained(listener, tree, frames, path)]
        roles[tree] = "true_state"
    rows = "odom" if "odom" in roles.values() else "true_state"
    if rows == "true_state":
        truth, twist = (next(name for name, each in roles.items() if each == role) for role in (rows, "twist"))
        remarks.append(
            f"{path}: there is no odometry: the truth on {truth!r} gives the rows, the commands on {twist!r} the twist"
        )
    remarks += [f"{path}: {remark}" for remark in _unset(listener, roles)]
    for name, topic in roles.items():
        stream = listener[topic]
        if not stream and topic in _ASKED:
            raise ValueError(f"{path}: topic {name!r} has no messages.")
        if stream.late and topic not in _UNTIMED:
            late = f"{path}: topic {name!r}: {len(stream.late)} of {stream.count} messages, first number {stream.late[0]}"
            remarks.append(f"{late}, have a time that does not increase: left out")
    remarks += [f"{path}: {remark}" for remark in (*_by_one_clock(listener, roles, rows), *_mounted(path, listener, mount))]
    time = np.array(listener[rows].times)
    if len(time) < 2:
        raise ValueError(
            f"{path}: a drive needs two messages on {rows}, got {len(time)}; there are {', '.join(sorted(kinds))}."
        )
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


def sensors_of(path: Path, truth: str) -> list[str]:
    """Return the topics of a bag that state measured poses; see `reading.pose_sensors`."""
    with opened(path) as bag:
        found = [name for name, kind in bag.kinds.items() if kind == MEASURED and name not in (truth, *bag.silent)]
    found = [name for name in found if not name.endswith(_NO_SENSORS)]
    return next(([name] for end in _SENSORS for name in found if name.endswith(f"/{end}")), sorted(found))


def _mounted(path: Path, listener: DriveListener, mount: Pose | None) -> list[str]:
    """Return the remarks on where the sensors are."""
    if mount is not None and not listener["scan"]:
        raise ValueError(f"{path}: mount says where a LiDAR is, and the bag holds no scans: leave it out.")
    remarks = [listener.mount().remark] if listener["scan"] else []
    remarks += [listener.gyro_mount()[1]] if listener["imu"] else []
    return [remark for remark in remarks if remark]


def _heard(
    path: Path, bag: Bag, roles: dict[str, str], listening: Callable[[], DriveListener]
) -> tuple[DriveListener, list[str]]:
    """Return what a bag's messages say, and remarks on those that were left out."""
    remarks, numbers = [], {name: at for at, name in enumerate(roles)}
    said: list[tuple[float, float, int]] = []

    def hear(messages: Iterable[Message]) -> tuple[DriveListener, int]:
        listener, unread = listening(), 0
        listener.transforms.repeats_fixed = bag.is_ros_1
        for message in messages:
            unread += 1
            with suppress(*_UNREADABLE):
                listener.hear(roles[message.topic], message.value, message.received * 1e-9)
                unread -= 1
        return listener, unread

    def noted() -> Iterator[Message]:
        for message in bag.messages(roles):
            stamp = np.nan
            with suppress(*_UNREADABLE):
                stamp = np.nan if (stated := stamp_of(message.value)) is None else stated
            said.append((message.received * 1e-9, stamp, numbers[message.topic]))
            yield message

    listener, unread = hear(noted())
    received, stamps, topics = np.array(said).reshape(-1, 3).T
    timed = [
        np.flatnonzero((topics == at) & np.isfinite(stamps)) for at, role in enumerate(roles.values()) if role not in _UNTIMED
    ]
    is_stray = np.zeros(len(said), np.bool_)
    for rows in timed:
        is_stray[rows] = stray_stamps(stamps[rows], is_in_order=False)
    usual = np.where(stamps == 0.0, np.nan, stamps)[~is_stray]
    times = rolled_over(received[~is_stray], usual, topics[~is_stray])
    for rows in timed if times is None else ():
        is_stray[rows] = stray_stamps(stamps[rows])
    for at, name in enumerate(roles):
        if bad := int((is_stray & (topics == at)).sum()):
            whole = f"{bad} of {int((topics == at).sum())} messages"
            remarks.append(f"{path}: topic {name!r}: {whole} have a stamp that is 0, or far from those around: left out")
    kept = (message for message, bad in zip(bag.messages(roles), is_stray, strict=True) if not bad)
    if times is not None:
        messages = [
            message._replace(received=round(time * 1e9)) for message, time in zip(kept, times, strict=True) if np.isfinite(time)
        ]
        listener, unread = hear(sorted(messages, key=lambda message: message.received))
        wrong, lost = received[~is_stray] != times, int(np.isnan(times).sum())
        left_out = f", {lost} messages without a stamp are left out" if lost else ""
        remarks.append(f"{path}: the recorder's clock is wrong in {wrong.sum()} messages: their stamps count{left_out}")
    elif is_stray.any():
        listener, unread = hear(kept)
    if unread:
        remarks.append(f"{path}: {unread} of {len(said)} messages are not what their topics hold: left out")
    return listener, remarks


def _chained(listener: DriveListener, tree: str, frames: str, path: Path) -> list[str]:
    """Take the poses of a chain of transforms for the truth, and return remarks."""
    transforms, remarks = listener.transforms, []
    for (parent, child), number in transforms.settle().items():
        remarks.append(
            f"{tree}:{parent}.{child}: {number} transforms have a stamp that is 0, or far from those around: left out"
        )
    odometry = listener.frames["odom"] if listener["odom"] else ("odom", "")
    try:
        chain = Request(transforms, tree, odometry).chain(frames)
    except ValueError as error:
        raise ValueError(f"{path}: {error}.") from error
    for edge in dict.fromkeys(edge for edge, _ in chain):
        clock, stream = transforms.clocks.get(edge), transforms.edges[edge]
        name = f"{tree}:{edge[0]}.{edge[1]}"
        if edge in transforms.bad:
            remarks.append(f"{name}: {transforms.bad[edge]} transforms are not finite, or no rotation: left out")
        if clock is None or transforms.stands(edge) or odometry[0].lstrip("/") in edge or not listener["odom"]:
            continue  # a correction of odometry is stamped ahead, so that it can be used at once
        remarks += _moved(stream.times, clock.lead(listener.clocks["odom"]), name)
    for time, pose in zip(*transforms.poses(chain), strict=True):
        listener["true_state"].add(float(time), [*pose.tolist(), np.nan, np.nan])
    if not listener["true_state"]:
        raise ValueError(f"{path}: {tree}:{frames} is nowhere known: its transforms are too far apart in time.")
    return remarks


def _unset(listener: DriveListener, roles: dict[str, str]) -> list[str]:
    """Forget the headings of topics whose quaternions were never set, and return remarks."""
    remarks = []
    for name, topic in roles.items():
        said = listener.rotations.get(topic)
        if said is None or not said.bad:
            continue
        why = "are no rotation: their length is not 1"
        if said.are_unset:
            listener[topic].values[:] = [[*value[:2], np.nan, *value[3:]] for value in listener[topic].values]
            why += ", so none of this topic counts"
        if not said.has_w:
            why += "; w is always 0: was it never set?"
        remarks.append(f"topic {name!r}: the quaternions of {said.bad} of {said.count} messages {why}")
    return remarks


def _moved(times: list[float], lead: float, name: str, base: str = "odometry") -> list[str]:
    """Move times to the clock of the odometry, or what else gives the rows, in place, and return the remark on that."""
    if not lead:
        return []
    times[:] = [time - lead for time in times]
    how = "ahead of" if lead > 0.0 else "behind"
    return [f"{name}: its clock is {abs(lead):.3f} s {how} that of the {base}: its times are moved"]


def _by_one_clock(listener: DriveListener, roles: dict[str, str], rows: str) -> list[str]:
    """Move the times of all topics to the clock of the odometry, or the rows', in place, and return remarks on the clocks."""
    remarks, odom, base = [], listener.clocks.get(rows, Stamps()), "odometry" if rows == "odom" else "truth"
    if AHEAD < odom.ahead < SIMULATED:
        remarks.append(f"the clock of the {base} is {odom.ahead:.3f} s ahead of the recorder's")
    for name, topic in roles.items():
        clock = listener.clocks.get(topic, odom)
        if clock.resets:
            remarks.append(
                f"topic {name!r}: the clock was set {'back' if clock.resets[0] > 0.0 else 'ahead'} {len(clock.resets)} times, "
                f"first by {abs(clock.resets[0]):.3f} s"
            )
        if topic in _CLOCKED:
            remarks += _moved(listener[topic].times, clock.lead(odom), f"topic {name!r}", base)
            if text := apart(listener[topic].times, listener[rows].times, base):
                remarks.append(f"topic {name!r}: {text}")
    return remarks


def _roles(path: Path, kinds: dict[str, str], wanted: Topics) -> dict[str, str]:
    """Return the topics to read, each with its name in `messages.TYPES`; a truth in transforms is ``tf``."""
    if not kinds:
        raise ValueError(f"{path}: the bag is empty: it has no topics.")
    odom, twist = _only(kinds, wanted.odom, (ODOMETRY,)), wanted.twist
    if odom not in kinds and odom == Topics().odom:
        odom, twist = "", _commands(path, kinds, wanted)
    roles: dict[str, str] = {}
    for name, role, allowed in (
        (odom, "odom", (ODOMETRY,)),
        (wanted.truth, "true_state", POSES),
        (wanted.fix, "fix", POSES),
        (twist, "twist", TWISTS),
        (wanted.scan, "scan", TYPES["scan"]),
    ):
        if name and name not in kinds:
            raise ValueError(f"{path}: there is no topic {name!r}; there are {', '.join(sorted(kinds))}.")
        if name and kinds[name] not in allowed:
            raise ValueError(f"{path}: topic {name!r} has the type {kinds[name]}; it must be {' or '.join(allowed)}.")
        if name in roles:
            raise ValueError(f"{path}: topic {name!r} is named for two quantities.")
        if name:
            roles[name] = role
    space = odom.rpartition("/")[0]
    searched = [(name, "true_state") for name in _TRUTHS if not wanted.truth] + [
        (name, name) for name in TYPES if name not in (*_ASKED, "tf")
    ]
    for name, role in searched:
        present = next((topic for topic in (f"{space}/{name}", f"/{name}") if kinds.get(topic) in TYPES[role]), None)
        if present and present not in roles and role not in roles.values():
            roles[present] = role
    tree = next((topic for topic in (f"{space}/tf", "/tf") if kinds.get(topic) in TRANSFORMS), None)
    if tree and tree not in roles and {"scan", "imu"} & set(roles.values()):
        roles[tree] = "mounts"
    return {name: "tf" if role == "true_state" and kinds[name] in TRANSFORMS else role for name, role in roles.items()}


def _only(kinds: dict[str, str], name: str, allowed: tuple[str, ...]) -> str:
    """Return a topic's name, or that of the only one which has it in a namespace."""
    namespaced = [each for each, kind in kinds.items() if each.endswith(name) and kind in allowed]
    return namespaced[0] if name not in kinds and len(namespaced) == 1 else name


def _commands(path: Path, kinds: dict[str, str], wanted: Topics) -> str:
    """Return the topic of the commands, which stand for odometry where there is a truth; otherwise refuse the bag."""
    twist = wanted.twist or _only(kinds, "/cmd_vel", TWISTS)
    if twist in kinds and (wanted.truth or any(kinds.get(f"/{name}") in POSES for name in _TRUTHS)):
        return twist
    others = [f"--topics.odom {name}" for name, kind in kinds.items() if kind == ODOMETRY]
    poses = [f"--truth {name}" for name, kind in kinds.items() if kind in POSES and kind != ODOMETRY and kind not in TRANSFORMS]
    lacks = (
        f"commands (there is no {twist!r}; name them by --topics.twist)"
        if twist not in kinds
        else "a truth to compare them with"
    )
    instead = f": did you mean {' or '.join(others + (poses if twist in kinds else []))}?" if others or poses else ""
    raise ValueError(
        f"{path}: nothing was recorded on {Topics().odom!r}, and without odometry a drive needs the commands and the truth; "
        f"it lacks {lacks}{instead or '; there are ' + ', '.join(sorted(kinds)) + '.'}"
    )
