"""An observer that turns the topics of a running graph into a growing drive for the viewer.

It only listens, to a simulated graph or a robot's, in real time or in lock-step. A row is a message on ``odom`` with what the
other topics say at its stamp. A leap of the stamps, forwards or backwards, a reset of the plant and another room each begin
another drive.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from threading import Event
from typing import Any

import numpy as np
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Empty

from turtlebot_gym.drives import Growing, Surroundings
from turtlebot_gym.drives.alignment import LEAP
from turtlebot_gym.drives.messages import GUARD, TYPES, Listener
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym_ros.base.qos import LATCHED, STREAM

STEP = ("true_state", "estimate", "nis")
"""Topics whose values belong to the odometry of the same stamp."""
LONGEST = 18_000
"""Rows after which another drive begins, so that browsers keep up: half an hour at 10 Hz."""
LAG = 5
"""Number of later rows after which it stops waiting for a row's values."""
_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort, which matches publishers of either reliability."""
_OTHER = {"map": LATCHED, "tf_static": LATCHED, "diagnostics": STREAM}
_COMMON = ("diagnostics", "tf_static")
"""Topics that all robots share."""


class Watcher:
    """A node that subscribes to all topics of the loop.

    Args:
        context: The rclpy context.
        namespace: Namespace of the graph.
        lidar: Name in `turtlebot_gym.rooms.lidar.LIDARS`, for the mounting of the LiDAR.
    """

    def __init__(self, context: Context, *, namespace: str | None = None, lidar: str = "lds01") -> None:
        self.node = Node("watch", context=context, namespace=namespace)
        self.drive = Growing()
        """The recorded drive."""
        guard = f"{self.node.get_namespace().rstrip('/')}/{GUARD}"
        self.listener = Listener(lidar=find_lidar(lidar), guard=guard, live=True)
        """What the topics say."""
        self._begun = Event()
        self._pending: deque[float] = deque()
        self._last, self._first, self._rows = math.inf, 0.0, 0
        self._around = Surroundings("live")
        for topic, (kind, *_) in TYPES.items():
            package, folder, name = kind.split("/")
            if topic not in ("fix", "twist", "imu") and find_spec(package):  # PyPI does not have tf2_msgs
                message = getattr(import_module(f"{package}.{folder}"), name)
                named = f"/{topic}" if topic in _COMMON else topic
                self.node.create_subscription(message, named, self._hear(topic), _OTHER.get(topic, _QOS))
        self.node.create_subscription(Empty, "reset", self._hear_reset, STREAM)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the first row, and return whether it has arrived.

        Args:
            timeout: Longest wait, s; None waits indefinitely.
        """
        return self._begun.wait(timeout)

    def _hear(self, topic: str) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            try:
                newer = self.listener.hear(topic, message, time.monotonic())
            except (ValueError, IndexError):
                return  # the nodes that need the message report what is wrong with it
            if topic == "odom" and newer:
                self._pending.append(self.listener["odom"].times[-1])
            self._finish_rows()

        return hear

    def _hear_reset(self, message: Empty) -> None:
        """Begin another drive with the next row: the plant has placed the robot somewhere else."""
        self._pending.clear()
        self._last = math.inf

    def _finish_rows(self) -> None:
        """Add rows that are complete, or that can no longer become complete, since topics overtake each other."""
        heard = [stream.times for topic in STEP if (stream := self.listener[topic])]
        while self._pending:
            stamp = self._pending[0]
            complete = len(self._pending) > 1 and all(stamp in times for times in heard)
            if not complete and len(self._pending) <= LAG:
                return
            self._pending.popleft()
            self._add(stamp)

    def _add(self, stamp: float) -> None:
        rooms, grids = self.listener["obstacles"].values, self.listener["map"].values
        now, old = Surroundings("live", room=rooms[-1] if rooms else None, grid=grids[-1] if grids else None), self._around
        is_new = old.grid is None and now.grid is not None
        is_new |= now.room is not None and (
            old.room is None or (now.room.walls, now.room.boxes) != (old.room.walls, old.room.boxes)
        )
        begins = not 0.0 < stamp - self._last <= LEAP or self._rows >= LONGEST or is_new
        if begins:
            self._first, self._rows, self._last, self._around = stamp, 0, -math.inf, now
        rows = self.listener.rows(np.array([stamp]), after=self._last, held=0.0, around=self._around, start=self._first)
        self._last = stamp
        if begins:
            self.drive.restart(rows)
            self._begun.set()
        else:
            self.drive.add(rows)
        self._rows += 1
