"""An observer of a running graph: what was said on its topics, as a trajectory."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import String

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.trajectory import Trajectory
from turtlebot_gym.values import Command, Covariance, Pose, State
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.qos import LATCHED, SENSOR, STREAM

TOPICS: dict[str, type] = {
    "true_state": State,
    "odom": State,
    "estimate": Estimate,
    "reference": Pose,
    "cmd_vel": Command,
}
"""What it hears, and as which values."""
_UPPER = np.triu_indices(5)


class Recorder:
    """A node that hears all topics of the loop, the diagnostics and the controller's state.

    Args:
        context: The rclpy context.
        stamped: Whether velocities travel as TwistStamped.
        name: The node's name.
    """

    def __init__(self, context: Context, *, stamped: bool = True, name: str = "bringup") -> None:
        self.node = Node(name, context=context)
        self._lock = Lock()
        self.latest: dict[str, Any] = {}
        """The last value of each topic that was heard."""
        self.reports: dict[str, tuple[int, str]] = {}
        """Level and message of each node's last diagnostics."""
        self.state = "silent"
        """The controller's state."""
        self._rows: dict[int, dict[str, Any]] = {}
        self._first = 0
        self._waits_for_rest = False
        for topic, kind in TOPICS.items():
            way = conversion(kind, stamped=stamped)
            self.node.create_subscription(way.message, topic, self._hear(topic, way.read), SENSOR)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear_report, STREAM)
        self.node.create_subscription(String, "velocity_controller/state", self._hear_state, LATCHED)

    def _hear(self, topic: str, read: Callable[[Any], Any]) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            value = read(message)
            with self._lock:
                self.latest[topic] = value
                if topic not in ("true_state", "odom", "estimate"):
                    return
                stamp = Time.from_msg(message.header.stamp).nanoseconds
                if self._waits_for_rest and topic == "true_state" and value.v == value.omega == 0.0:
                    self._rows.clear()
                    self._waits_for_rest, self._first = False, stamp
                if stamp >= self._first and not self._waits_for_rest:
                    self._at(stamp)[topic] = value

        return hear

    def _at(self, stamp: int) -> dict[str, Any]:
        """Return the sample of a stamp; a new one holds the reference and the command of its time."""
        if stamp not in self._rows:
            held = ("reference", "cmd_vel")
            self._rows[stamp] = {topic: self.latest[topic] for topic in held if topic in self.latest}
        return self._rows[stamp]

    def _hear_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.reports[status.name.strip("/")] = (status.level[0], status.message)

    def _hear_state(self, message: String) -> None:
        self.state = message.data

    def restart(self) -> None:
        """Forget the samples so far, and begin with the first one of a plant at rest."""
        with self._lock:
            self._rows.clear()
            self._waits_for_rest = True

    @property
    def has_begun(self) -> bool:
        """Whether there are samples since the start."""
        return bool(self._rows)

    @property
    def time(self) -> float:
        """Time between the first and the last sample, by their stamps, s."""
        with self._lock:
            return (max(self._rows) - min(self._rows)) / 1e9 if self._rows else 0.0

    def trajectory(self) -> Trajectory:
        """Return what was heard so far; NaN where nothing was."""
        with self._lock:
            rows = [(stamp, dict(self._rows[stamp])) for stamp in sorted(self._rows)]
        nothing = {"true_state": 5, "odom": 5, "estimate": 5, "reference": 3, "cmd_vel": 2}

        def column(topic: str, pick: Callable[[Any], Any] = tuple) -> Any:
            gap = (np.nan,) * nothing[topic]
            return np.array([pick(row[topic]) if topic in row else gap for _, row in rows], float).reshape(len(rows), -1)

        covariance = np.full((len(rows), 5, 5), np.nan)
        for k, (_, row) in enumerate(rows):
            if "estimate" in row:
                upper = np.zeros((5, 5))
                upper[_UPPER] = Covariance(*row["estimate"].belief.covariance)
                covariance[k] = upper + np.triu(upper, 1).T
        return Trajectory(
            time=np.array([(stamp - rows[0][0]) / 1e9 for stamp, _ in rows]),
            true_state=column("true_state"),
            odometry=column("odom")[:, :3],
            estimate=column("estimate", lambda estimate: estimate.belief.mean),
            covariance=covariance,
            reference=column("reference"),
            command=column("cmd_vel"),
        )

    def close(self) -> None:
        """Destroy the node."""
        self.node.destroy_node()
