"""The pose of one frame in another by a chain of transforms, as recorded on ``/tf`` and ``/tf_static``.

A truth in transforms is asked for as evo does: ``/tf:PARENT.CHILD``. Odometry publishes a transform, too, from its own frame:
that is no truth, whatever stands still above it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from turtlebot_gym.drive import GAP
from turtlebot_gym.mounts import MOST
from turtlebot_gym_lab.drives.alignment import FRESH, SAME, Stream
from turtlebot_gym_lab.drives.clocks import Stamps, stray_stamps
from turtlebot_gym_lab.drives.rotations import is_unit

Edge = tuple[str, str]
"""A parent frame and its child."""


class Transforms:
    """Transforms between frames over time."""

    def __init__(self) -> None:
        self.edges: dict[Edge, Stream] = {}
        """Translation and quaternion (x, y, z, w) of each child in its parent; m."""
        self.clocks: dict[Edge, Stamps] = {}
        self.bad: dict[Edge, int] = {}
        """Number of transforms that were left out: without a rotation, or not finite."""
        self.repeats_fixed = False
        """Whether fixed transforms are repeated, as ROS 1 does on ``/tf``."""
        self._fixed: set[Edge] = set()
        self._heard: dict[Edge, list[tuple[float, float, tuple[float, ...]]]] = {}

    def hear(self, message: Any, received: float, *, is_static: bool) -> None:
        """Take a message with ``transforms``, received at a time in s."""
        for transform in message.transforms:
            edge = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
            at, q = transform.transform.translation, transform.transform.rotation
            values = (at.x, at.y, at.z, q.x, q.y, q.z, q.w)
            if not all(map(math.isfinite, values)) or not is_unit(q):
                self.bad[edge] = self.bad.get(edge, 0) + 1
                continue
            if edge not in self._heard and len(self._heard) >= MOST:
                raise ValueError(f"there are more than {MOST} frames")
            stamp = transform.header.stamp.sec + transform.header.stamp.nanosec * 1e-9
            if is_static:
                self._fixed.add(edge)
            self._heard.setdefault(edge, []).append((received if is_static else stamp, received, values))

    def settle(self) -> dict[Edge, int]:
        """Take all that was heard into `edges`, and return how many transforms have a stray stamp: those are left out."""
        left_out: dict[Edge, int] = {}
        for edge, heard in self._heard.items():
            is_stray = stray_stamps(np.array([stamp for stamp, _, _ in heard]))
            stream, clock = self.edges.setdefault(edge, Stream()), self.clocks.setdefault(edge, Stamps())
            for (stamp, received, values), bad in zip(heard, is_stray.tolist(), strict=True):
                if not bad:
                    stream.add(clock.read(stamp or received, received), values)
            left_out |= {edge: int(is_stray.sum())} if is_stray.any() else {}
        self._heard.clear()
        return left_out

    def stands(self, edge: Edge) -> bool:
        """Return whether a transform is a fixed one: of ``/tf_static``, sent once, or repeated by ROS 1."""
        values = self.edges[edge].values
        return edge in self._fixed or len(values) < 2 or (self.repeats_fixed and all(each == values[0] for each in values))

    def chain(self, parent: str, child: str) -> list[tuple[Edge, bool]]:
        """Return the transforms from one frame to another, each with whether it is passed from child to parent.

        Raises:
            ValueError: If none connect them, or two equally short chains do.
        """
        near: dict[str, list[tuple[str, Edge, bool]]] = {}
        for edge in self.edges:
            near.setdefault(edge[0], []).append((edge[1], edge, False))
            near.setdefault(edge[1], []).append((edge[0], edge, True))
        ways: dict[str, list[list[tuple[Edge, bool]]]] = {parent: [[]]}
        front = {parent}
        while front and child not in ways:
            found: dict[str, list[list[tuple[Edge, bool]]]] = {}
            for frame in front:
                for other, edge, is_up in near.get(frame, ()):
                    if other not in ways:
                        found.setdefault(other, []).extend([*way, (edge, is_up)] for way in ways[frame][:2])
            ways |= found
            front = set(found)
        if child not in ways:
            raise ValueError(f"no transforms lead from {parent!r} to {child!r}")
        if len(ways[child]) > 1:
            raise ValueError(f"several chains of transforms lead from {parent!r} to {child!r}")
        return ways[child][0]

    def roots(self, child: str) -> set[str]:
        """Return the frames above one that have no parent themselves."""
        above, front = {child}, {child}
        while front:
            front = {parent for parent, below in self.edges if below in front} - above
            above |= front
        children = {below for _, below in self.edges}
        return {frame for frame in above if frame not in children} - {child}

    def poses(self, chain: list[tuple[Edge, bool]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the pose of a chain's last frame in its first one: times (n,), s, and poses (n, 3); m, m, rad.

        The times are those of the moving transform that is nearest to the last frame.
        """
        moving = [edge for edge, _ in chain if not self.stands(edge)]
        time = np.array(self.edges[moving[-1]].times)
        place, turn = np.zeros((len(time), 3)), Rotation.identity(len(time))
        for edge, is_up in chain:
            moved, turned = self._at(edge, time)
            if is_up:
                turned = turned.inv()
                moved = -turned.apply(moved)
            place, turn = place + turn.apply(moved), turn * turned
        ahead = turn.apply([1.0, 0.0, 0.0])
        poses = np.column_stack([place[:, :2], np.arctan2(ahead[:, 1], ahead[:, 0])])
        there = np.isfinite(poses).all(axis=1)
        return time[there], poses[there]

    def _at(self, edge: Edge, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], Rotation]:
        """Return a transform at some times; its translation is NaN where it is unknown."""
        times, values = np.array(self.edges[edge].times), np.array(self.edges[edge].values, np.float64)
        if self.stands(edge):
            return np.tile(values[-1, :3], (len(time), 1)), Rotation.from_quat(np.tile(values[-1, 3:], (len(time), 1)))
        within = np.clip(time, times[0], times[-1])
        moved = np.stack([np.interp(within, times, values[:, k]) for k in range(3)], axis=1)
        after = np.clip(np.searchsorted(times, within), 1, len(times) - 1)
        apart = times[after] - times[after - 1]
        unknown = (apart > max(FRESH, GAP * float(np.median(np.diff(times))))) & (np.abs(within - times[after - 1]) > SAME)
        moved[(np.abs(within - time) > SAME) | (unknown & (np.abs(times[after] - within) > SAME))] = np.nan
        return moved, Slerp(times, Rotation.from_quat(values[:, 3:]))(within)


def asked(text: str) -> tuple[str, str, str]:
    """Return the topic of a truth, the frames that are asked for, and the topic of the fixed transforms, as evo writes them."""
    topic, _, frames = text.partition(":")
    frames, _, fixed = frames.partition(":")
    return topic, frames, fixed


class Request:
    """What is asked of the transforms on a topic.

    Args:
        transforms: The transforms.
        topic: Their topic, for messages.
        odometry: Frame of odometry, and of the robot, by its messages.
    """

    def __init__(self, transforms: Transforms, topic: str, odometry: Edge) -> None:
        self._transforms, self._topic = transforms, topic
        self._odom, self._body = (frame.lstrip("/") for frame in odometry)
        self._own = topic.rpartition("/")[2] == "tf"  # where odometry publishes; a topic of its own is somebody's truth

    def chain(self, frames: str) -> list[tuple[Edge, bool]]:
        """Return the chain of transforms for ``PARENT.CHILD``, or for ``CHILD`` in the frame above all others.

        Raises:
            ValueError: With one line and the right words, if there is none, or it is odometry itself.
        """
        if not frames:
            raise ValueError(f"{self._topic!r} holds transforms: name the robot's frame and that above it{self._proposal()}")
        parent, child = self._split(frames)
        known = {frame for edge in self._transforms.edges for frame in edge}
        for frame in (parent, child):
            if bad := [each for each in self._transforms.bad if frame == each[1] and each not in self._transforms.edges]:
                raise ValueError(f"{self._topic!r}: the quaternions of {bad[0][0]}.{bad[0][1]} were never set: no length is 1")
            if frame is not None and frame not in known:
                raise ValueError(f"{self._topic!r} has no messages about {frame!r}{self._proposal()}")
        if parent is None:
            roots = self._transforms.roots(child)
            if len(roots) != 1:
                above = ", ".join(map(repr, sorted(roots))) or "none"
                raise ValueError(
                    f"{self._topic}:{frames} does not say in which frame, and above it is {above}{self._proposal()}"
                )
            (parent,) = roots
        if self._own and parent == self._odom:
            raise ValueError(f"{self._topic}:{frames} is the odometry itself{self._proposal()}")
        if parent == child:
            raise ValueError(f"{self._topic}:{frames} names the same frame twice{self._proposal()}")
        try:
            chain = self._transforms.chain(parent, child)
        except ValueError as error:
            raise ValueError(f"{self._topic}:{frames}: {error}{self._proposal()}") from error
        if not any(self._moves(edge) for edge, _ in chain):
            raise ValueError(f"{self._topic}:{frames} does not move: {child!r} is fixed in {parent!r}{self._proposal()}")
        if self._own and not self._is_more(chain):
            fixed = f"{parent!r} is fixed to odometry's frame {self._odom!r}"
            raise ValueError(f"{self._topic}:{frames} is the odometry itself, since {fixed}{self._proposal()}")
        if other := self._other_part(child):
            raise ValueError(f"{self._topic}:{frames} is not the robot: {child!r} moves against {other!r}{self._proposal()}")
        return chain

    def _moves(self, edge: Edge) -> bool:
        return not self._transforms.stands(edge)

    def _is_more(self, chain: list[tuple[Edge, bool]]) -> bool:
        """Return whether anything but odometry, and what is below it, moves in a chain."""
        passed = next((at for at, (edge, is_up) in enumerate(chain) if edge[is_up] == self._odom), len(chain))
        return any(self._moves(edge) for edge, _ in chain[:passed])

    def _other_part(self, child: str) -> str:
        """Return the robot's frame if a frame above or below it moves against it, or an empty text."""
        if not self._body or child == self._body or not any(self._body in edge for edge in self._transforms.edges):
            return ""
        try:
            between = self._transforms.chain(self._body, child)
        except ValueError:
            return ""
        one_way = len({is_up for _, is_up in between}) == 1
        return self._body if one_way and any(self._moves(edge) for edge, _ in between) else ""

    def _split(self, frames: str) -> tuple[str | None, str]:
        """Return parent, if it is named, and child; names of frames may have dots, too."""
        known = {frame for edge in self._transforms.edges for frame in edge}
        parts = frames.split(".")
        splits = [(".".join(parts[:at]).lstrip("/"), ".".join(parts[at:]).lstrip("/")) for at in range(1, len(parts))]
        if not splits or frames.lstrip("/") in known:
            return None, frames.lstrip("/")
        return next((split for split in splits if set(split) <= known), splits[0])

    def _proposal(self) -> str:
        """Return the end of a message: what to say instead, by what the bag has."""
        good = next(self._good(), None)
        if good is not None:
            return f": say {self._topic}:{good[0]}.{good[1]}"
        pairs = ", ".join(f"{parent}.{child}" for parent, child in sorted(self._transforms.edges)[:6]) or "nothing"
        return f": the bag has {pairs}, and no frame that says where the robot truly is; record one, or a topic with its pose"

    def _good(self) -> Iterator[Edge]:
        """Yield pairs of frames that may be a truth: the robot in a frame above it that is not odometry's."""
        bodies = [self._body, *sorted(child for parent, child in self._transforms.edges if parent == self._odom)]
        bodies += [child for (_, child), stream in self._transforms.edges.items() if len(stream) > 1 and child != self._odom]
        for body in dict.fromkeys(bodies):
            for root in sorted(self._transforms.roots(body)):
                if not (self._own and root == self._odom):
                    try:
                        chain = self._transforms.chain(root, body)
                    except ValueError:
                        continue
                    moves = self._is_more(chain) if self._own else any(self._moves(edge) for edge, _ in chain)
                    if moves and not self._other_part(body):
                        yield root, body
