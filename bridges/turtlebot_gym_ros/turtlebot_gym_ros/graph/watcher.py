"""An observer that turns the topics of a running graph into a growing drive for the viewer.

It only listens, to a simulated graph or a robot's, in real time or in lock-step. A row is a message on ``odom`` with all values
of the same stamp. A leap of the stamps, forwards or backwards, a reset of the plant and another room each begin another drive.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from threading import Event
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from std_msgs.msg import Empty

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan, mounted
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym.trajectory import Trajectory
from turtlebot_gym.values import Odometry, Pose, State
from turtlebot_gym_agents.watch import Growing, Seen, Surroundings, Track, of_trajectory
from turtlebot_gym_ros.base.qos import LATCHED, STREAM
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import conversion

HEARD: dict[str, type] = {
    "odom": Odometry,
    "true_state": State,
    "estimate": Estimate,
    "reference": Pose,
    "nis": Nis,
    "clearance": Clearance,
    "scan": Scan,
    "obstacles": Obstacles,
}
"""Topics to record, with their value types."""
STEP = ("true_state", "estimate", "nis")
"""Topics whose values belong to the odometry of the same stamp."""
GUARD = "cmd_vel_guard"
"""Name of the guard's node."""
LEAP = 5.0
"""Longest gap between two stamps, s; a longer one begins another drive."""
LONGEST = 18_000
"""Rows after which another drive begins, so that browsers keep up: half an hour at 10 Hz."""
LAG = 5
"""Number of later rows after which it stops waiting for a row's values."""
WAITING = 100
"""Number of stamps whose values are kept until their odometry arrives."""
_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort, which matches publishers of either reliability."""
_UNKNOWN = (math.nan,) * 5


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
        self._lidar, self._begun = find_lidar(lidar), Event()
        self._guard = f"{self.node.get_namespace().rstrip('/')}/{GUARD}"
        self._latest: dict[str, Any] = {}
        self._steps: dict[int, dict[str, Any]] = {}
        self._heard: set[str] = set()
        self._pending: deque[tuple[int, dict[str, Any]]] = deque()
        self._stamp = self._last = -1
        self._first, self._rows = 0, 0
        self._report = math.nan, ""
        self._scan: Scan | None = None
        self._grid: GridMap | None = None
        self._room: Obstacles | None = None
        for topic, kind in HEARD.items():
            way = conversion(kind)
            self.node.create_subscription(way.message, topic, self._hear(topic, way.read), _QOS)
        way = conversion(GridMap)
        self.node.create_subscription(way.message, "map", self._hear("map", way.read), LATCHED)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear_report, STREAM)
        self.node.create_subscription(Empty, "reset", self._hear_reset, STREAM)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the first row, and return whether it has arrived.

        Args:
            timeout: Longest wait, s; None waits indefinitely.
        """
        return self._begun.wait(timeout)

    def close(self) -> None:
        """Destroy the node."""
        self.node.destroy_node()

    def _hear(self, topic: str, read: Callable[[Any], Any]) -> Callable[[Any], None]:
        def hear(message: Any) -> None:
            try:
                value = read(message)
            except ValueError:
                return  # the nodes that need the message report what is wrong with it
            self._latest[topic] = value
            if topic in STEP:
                self._heard.add(topic)
                self._steps.setdefault(_stamp(message), {})[topic] = value
            if topic == "odom":
                self._begin_row(_stamp(message))
            self._finish_rows()

        return hear

    def _hear_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._guard:
                self._report = float(status.level[0]), status.message

    def _hear_reset(self, message: Empty) -> None:
        """Begin another drive with the next row: the plant has placed the robot somewhere else."""
        self._pending.clear()
        self._last = -1

    def _begin_row(self, stamp: int) -> None:
        """Record the current values when a row begins."""
        if stamp == self._stamp:
            return  # lock-step publishes a step again if an answer is missing
        self._stamp = stamp
        self._pending.append((stamp, dict(self._latest)))
        while len(self._steps) > WAITING:
            del self._steps[min(self._steps)]

    def _finish_rows(self) -> None:
        """Add rows that are complete, or that can no longer become complete, since topics overtake each other."""
        while self._pending:
            stamp, latest = self._pending[0]
            step = self._steps.get(stamp, {})
            if len(self._pending) <= LAG and not (self._heard <= step.keys() and len(self._pending) > 1):
                return
            self._pending.popleft()
            self._steps.pop(stamp, None)
            self._add(stamp, latest, step)

    def _add(self, stamp: int, latest: dict[str, Any], step: dict[str, Any]) -> None:
        room, grid = self._latest.get("obstacles"), self._latest.get("map")
        came = self._grid is None and grid is not None
        came |= room is not None and (self._room is None or _still_of(room) != _still_of(self._room))
        if not 0.0 < (stamp - self._last) * 1e-9 <= LEAP or self._rows >= LONGEST or came:
            self._first, self._rows, self._scan = stamp, 0, None
            self._room, self._grid = room, grid
        self._last = stamp
        piece = self._row((stamp - self._first) * 1e-9, latest, step)
        if self._rows == 0:
            self.drive.restart(piece)
            self._begun.set()
        else:
            self.drive.add(piece)
        self._rows += 1

    def _row(self, time: float, latest: dict[str, Any], step: dict[str, Any]) -> Track:
        odometry: Odometry = latest["odom"]
        estimate, truth = step.get("estimate"), step.get("true_state", State(*_UNKNOWN))
        state = estimate.belief.mean if estimate else State(*_UNKNOWN)
        covariance = matrix(estimate.belief.covariance) if estimate else np.full((5, 5), np.nan)
        columns = {
            "time": time,
            "true_state": truth,
            "odometry": odometry.pose if odometry.measured else _UNKNOWN[:3],
            "estimate": state,
            "covariance": covariance,
            "reference": latest.get("reference", _UNKNOWN[:3]),
            "command": odometry.twist,
        }
        room = latest.get("obstacles")
        still = self._room.circles if self._room else ()
        clearance = latest["clearance"].distance if "clearance" in latest else math.nan
        return of_trajectory(
            Trajectory(**{name: np.array([value], np.float64) for name, value in columns.items()}),
            Surroundings("live", room=self._room, grid=self._grid),
            nis=np.array([step["nis"].value if "nis" in step else math.nan]),
            clearance=np.array([clearance]),
            reports=[self._report],
            circles=[np.array(room.circles).reshape(-1, 3)] if room is not None and room.circles != still else None,
            scans=self._new_scan(latest.get("scan"), truth if math.isfinite(truth.x) else state),
        )

    def _new_scan(self, scan: Scan | None, state: State) -> list[Seen]:
        """Return a scan, if it arrived in this row and the robot's pose is known."""
        if scan is None or scan is self._scan or not math.isfinite(state.x):
            return []
        self._scan = scan
        return [Seen(0, mounted(state, self._lidar), scan)]


def _stamp(message: Any) -> int:
    return Time.from_msg(message.header.stamp).nanoseconds


def _still_of(room: Obstacles) -> tuple[Any, ...]:
    """Return the parts of a room that never move; walkers are circles."""
    return room.walls, room.boxes
