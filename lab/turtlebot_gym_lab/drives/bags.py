"""A bag of ROS 2 or ROS 1 as a drive, without ROS: `rosbags` decodes the messages."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym_lab.drives.clocks import AHEAD, SIMULATED, rolled_over
from turtlebot_gym_lab.drives.frames import Request, asked
from turtlebot_gym_lab.drives.messages import ODOMETRY, POSES, TRANSFORMS, TWISTS, TYPES, DriveListener, stamp_of
from turtlebot_gym_lab.drives.salvage import MCAP, ROS_1, SQLITE, suffix_of
from turtlebot_gym_lab.drives.storage import Bag, Message, opened
from turtlebot_gym_lab.drives.topics import Topics

_TRUTHS = ("ground_truth", "true_state", "truth")
"""Topics that are searched for the truth."""
_ASKED = ("odom", "true_state", "fix", "twist")
"""Topics whose names `Topics` holds; the others are searched beside that of the odometry, and in the root."""
_CLOCKED = ("true_state", "fix", "twist", "scan", "estimate", "imu")
"""Topics that may come from another computer."""
_UNREADABLE = (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError)


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag: a folder, or a file of one, judged by its first bytes."""
    return path.is_dir() or path.suffix in (SQLITE, MCAP, ROS_1) or (path.is_file() and suffix_of(path) is not None)


def read_bag(path: Path, *, topics: Topics, label: str, lidar: str) -> Drive:
    """Read a bag; see `reading.read`."""
    truth, frames, fixed = asked(topics.truth)
    with opened(path) as bag:
        kinds = bag.kinds
        roles = _roles(path, kinds, replace(topics, truth=truth))
        if fixed and kinds.get(fixed) in TRANSFORMS:
            roles[fixed] = "tf_static"
        listener, remarks = _heard(path, bag, roles, lidar)
        remarks = [*bag.remarks, *remarks]
    tree = next((name for name, role in roles.items() if role == "tf"), "")
    if tree:
        remarks += [f"{path}: {remark}" for remark in _chained(listener, tree, frames, path)]
        roles[tree] = "true_state"
    remarks += [f"{path}: {remark}" for remark in _unset(listener, roles)]
    for name, topic in roles.items():
        stream = listener[topic]
        if not stream and topic in _ASKED:
            raise ValueError(f"{path}: topic {name!r} has no messages.")
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


def _heard(path: Path, bag: Bag, roles: dict[str, str], lidar: str) -> tuple[DriveListener, list[str]]:
    """Return what a bag's messages say, and remarks on those that were left out."""
    listener, remarks, done, read = DriveListener(lidar=find_lidar(lidar)), [], 0, 0
    listener.transforms.repeats_fixed = bag.is_ros_1
    received, stamps, topics, numbers = [], [], [], {name: at for at, name in enumerate(roles)}

    def hear(messages: Iterable[Message]) -> None:
        nonlocal done, read
        for message in messages:
            done += 1
            received.append(message.received * 1e-9)
            stamps.append(np.nan)
            topics.append(numbers[message.topic])
            with suppress(*_UNREADABLE):
                stamps[-1] = stamp_of(message.value) or np.nan
                listener.hear(roles[message.topic], message.value, received[-1])
                read += 1

    hear(bag.messages(roles))
    times = rolled_over(np.array(received), np.array(stamps), np.array(topics, np.intp))
    if times is not None:
        listener, done, read = DriveListener(lidar=find_lidar(lidar)), 0, 0
        listener.transforms.repeats_fixed = bag.is_ros_1
        messages = [
            message._replace(received=round(time * 1e9))
            for message, time in zip(bag.messages(roles), times, strict=True)
            if np.isfinite(time)
        ]
        hear(sorted(messages, key=lambda message: message.received))
        wrong = np.array(received[: len(times)]) != times
        lost = int(np.isnan(times).sum())
        left_out = f", {lost} messages without a stamp are left out" if lost else ""
        remarks.append(f"{path}: the recorder's clock is wrong in {wrong.sum()} messages: their stamps count{left_out}")
    if read < done:
        remarks.append(f"{path}: {done - read} of {done} messages are not what their topics hold: left out")
    return listener, remarks


def _chained(listener: DriveListener, tree: str, frames: str, path: Path) -> list[str]:
    """Take the poses of a chain of transforms for the truth, and return remarks."""
    transforms, remarks = listener.transforms, []
    try:
        chain = Request(transforms, tree, listener.frames["odom"]).chain(frames)
    except ValueError as error:
        raise ValueError(f"{path}: {error}.") from error
    for edge in dict.fromkeys(edge for edge, _ in chain):
        clock, stream = transforms.clocks.get(edge), transforms.edges[edge]
        name = f"{tree}:{edge[0]}.{edge[1]}"
        if edge in transforms.bad:
            remarks.append(f"{name}: {transforms.bad[edge]} transforms are not finite, or no rotation: left out")
        if clock is None or transforms.stands(edge) or listener.frames["odom"][0].lstrip("/") in edge:
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


def _moved(times: list[float], lead: float, name: str) -> list[str]:
    """Move times to the clock of the odometry, in place, and return the remark on that."""
    if not lead:
        return []
    times[:] = [time - lead for time in times]
    how = "ahead of" if lead > 0.0 else "behind"
    return [f"{name}: its clock is {abs(lead):.3f} s {how} that of the odometry: its times are moved"]


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
        if topic in _CLOCKED:
            remarks += _moved(listener[topic].times, clock.lead(odom), f"topic {name!r}")
    return remarks


def _roles(path: Path, kinds: dict[str, str], wanted: Topics) -> dict[str, str]:
    """Return the topics to read, each with its name in `messages.TYPES`; a truth in transforms is ``tf``."""
    if not kinds:
        raise ValueError(f"{path}: the bag is empty: it has no topics.")
    odom = wanted.odom
    namespaced = [name for name in kinds if name.endswith(odom)]
    if odom not in kinds and len(namespaced) == 1:
        odom = namespaced[0]
    roles: dict[str, str] = {}
    for name, role, allowed in (
        (odom, "odom", (ODOMETRY,)),
        (wanted.truth, "true_state", POSES),
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
    space = odom.rpartition("/")[0]
    searched = [(name, "true_state") for name in _TRUTHS if not wanted.truth] + [
        (name, name) for name in TYPES if name not in (*_ASKED, "tf")
    ]
    for name, role in searched:
        present = next((topic for topic in (f"{space}/{name}", f"/{name}") if kinds.get(topic) in TYPES[role]), None)
        if present and present not in roles and (role != "true_state" or role not in roles.values()):
            roles[present] = role
    return {name: "tf" if role == "true_state" and kinds[name] in TRANSFORMS else role for name, role in roles.items()}
