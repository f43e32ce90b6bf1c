"""An observer that records the topics of a running graph as a drive.

A row is a step, as in the infos of the environment: the true, measured and estimated state at a stamp, and the command in force
in the interval before it, as stated by ``/odom``. The command that answers a step is in the next row; that of the first row is
zero. In lock-step, the reference is the step's own; otherwise it is the one in force when the row began.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from threading import Lock
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.time import Time
from std_msgs.msg import String

from cmd_vel_guard.qos import LATCHED, LOCK_STEP, SENSOR, STREAM
from turtlebot_gym.drive import Drive
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Clearance, Obstacles
from turtlebot_gym.values import Command, Odometry, Pose, State
from turtlebot_gym_ros.base.executor import FastGroup
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.lockstep import EPISODE_GAP
from turtlebot_gym_ros.node.triggers import SECOND

TOPICS: dict[str, type] = {"true_state": State, "odom": Odometry, "estimate": Estimate, "reference": Pose, "cmd_vel": Command}
"""Topics to record, with their value types."""
STEP = ("true_state", "odom", "estimate", "reference")
"""Topics of a row; in real time the reference is not tied to a step."""
ROOM_TOPICS: dict[str, type] = {"clearance": Clearance, "obstacles": Obstacles}
"""Additional topics of a simulator in a room; on a map also ``map``, once."""


class GraphRecorder:
    """A node that subscribes to all topics of the loop, the diagnostics and the controller's state.

    In lock-step rows are complete, and a leap of the stamps begins another episode; in a room they include the clearance.
    Diagnostics of nodes outside the namespace are ignored; in the root all nodes count.
    """

    def __init__(
        self,
        context: Context,
        *,
        stamped: bool = True,
        lock_step: bool = False,
        room: bool = False,
        namespace: str | None = None,
    ) -> None:
        self.node = Node("bringup", context=context, namespace=namespace)
        self._space = f"{self.node.get_namespace().rstrip('/')}/"
        self._lock = Lock()
        self.latest: dict[str, Any] = {}
        """Last received value of each topic."""
        self.reports: dict[str, tuple[int, str]] = {}
        """Level and message of each node's last diagnostics, by the name in the graph's namespace."""
        self.state = "silent"
        """The controller's state."""
        self._lock_step = lock_step
        self._step = (*STEP, "clearance") if room else STEP
        self._sampled = self._step if lock_step else tuple(topic for topic in self._step if topic not in STEP[3:])
        self._rows: dict[int, dict[str, Any]] = {}
        self._last: int | None = None
        self._span = -1
        self._first = 0
        self._heard: list[Subscription] = []
        for topic, kind in {**TOPICS, **(ROOM_TOPICS if room else {})}.items():
            way = conversion(kind, stamped=stamped)
            qos, group = (LOCK_STEP, FastGroup(self.node)) if lock_step else (SENSOR, None)
            hear = self._hear(topic, way.read)
            self._heard.append(self.node.create_subscription(way.message, topic, hear, qos, callback_group=group))
        if room:
            way = conversion(GridMap)
            self.node.create_subscription(way.message, "map", self._hear("map", way.read), LATCHED)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear_report, STREAM)
        self.node.create_subscription(String, "velocity_controller/state", self._hear_state, LATCHED)

    def _hear(self, topic: str, read: Callable[[Any], Any]) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            value = read(message)
            with self._lock:
                self.latest[topic] = value
                if topic not in self._sampled:
                    return
                stamp = Time.from_msg(message.header.stamp).nanoseconds
                if self._lock_step:
                    self._add(stamp, topic, value)
                    return
                begun = {name: self.latest[name] for name in STEP[3:] if name in self.latest}  # in force when it begins
                self._rows.setdefault(stamp, begun)[topic] = value

        return hear

    def _add(self, stamp: int, topic: str, value: Any) -> None:
        """Store a value of a step; a leap in the true state's stamps begins an episode."""
        if topic == "true_state":
            last = self._last
            if last is None or stamp < last or stamp - last == EPISODE_GAP * SECOND:
                # Keep what other topics have already delivered for the first step of the new episode.
                self._rows = {at: row for at, row in self._rows.items() if at >= stamp > (last or 0)}
                self._first, self._span = stamp, -1
            self._last = stamp
        row = self._rows.setdefault(stamp, {})
        row[topic] = value
        if len(row) == len(self._step):
            self._span = max(self._span, stamp - self._first)

    def _hear_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(self._space):
                self.reports[status.name.removeprefix(self._space)] = (status.level[0], status.message)

    def _hear_state(self, message: String) -> None:
        self.state = message.data

    def restart(self) -> None:
        """Drop the samples so far."""
        with self._lock:
            self._rows.clear()

    @property
    def has_begun(self) -> bool:
        """Whether there are samples since the start; in lock-step, whether the first step is complete."""
        with self._lock:
            return self._span >= 0 if self._lock_step else bool(self._rows)

    @property
    def is_connected(self) -> bool:
        """Whether every topic has a publisher."""
        return all(subscription.get_publisher_count() for subscription in self._heard)

    @property
    def time(self) -> float:
        """Time between the first and the last sample by their stamps, s."""
        with self._lock:
            if self._lock_step:
                return max(self._span, 0) / 1e9
            return (max(self._rows) - min(self._rows)) / 1e9 if self._rows else 0.0

    def trajectory(self) -> Drive:
        """Return the drive so far, with NaN for missing values; in lock-step until the last complete step.

        Raises `RuntimeError` if a step of lock-step before that one was not heard as a whole.
        """
        with self._lock:
            first, end = (self._first, self._first + self._span) if self._lock_step else (-math.inf, math.inf)
            rows = [(stamp, dict(self._rows[stamp])) for stamp in sorted(self._rows) if first <= stamp <= end]
        if self._lock_step:
            _require_whole(rows, len(self._step))
        return Drive.stack((_columns(row) for _, row in rows), time=self._time_of([stamp for stamp, _ in rows]))

    def _time_of(self, stamps: list[int]) -> Any:
        """Return the time of rows since the first one, s; in lock-step counted in steps, as in the environment."""
        if self._lock_step and len(stamps) > 1:
            return np.arange(len(stamps), dtype=np.float64) * ((stamps[1] - stamps[0]) / 1e9)
        return np.array([(stamp - stamps[0]) / 1e9 for stamp in stamps])


def _columns(row: dict[str, Any]) -> dict[str, Any]:
    columns: dict[str, Any] = {name: row[name] for name in ("true_state", "reference") if name in row}
    if "odom" in row:
        columns |= {"odometry": row["odom"].pose, "command": row["odom"].twist, "twist": row["odom"].twist}
    if "estimate" in row:
        mean, covariance = row["estimate"].belief
        columns |= {"estimate": mean, "covariance": matrix(covariance)}
    if "clearance" in row:
        columns["clearance"] = row["clearance"].distance
    return columns


def _require_whole(rows: list[tuple[int, dict[str, Any]]], topics: int) -> None:
    stamps = [stamp for stamp, _ in rows]
    gaps = {after - before for before, after in pairwise(stamps)}
    if len(gaps) > 1 or any(len(row) < topics for _, row in rows):
        raise RuntimeError(f"the recorder lost some of {len(rows)} steps: the machine was too busy for it.")
