"""Record the graph: every message of all topics in a rosbag2 bag.

It subscribes to every topic as it appears, without configuration. In a namespace it records the topics below it and those of
the root, such as ``/tf``, which robots share; topics of other robots are left to their own recorders. The bag is sqlite3, so a
``kill -9`` loses at most the last second, and ``metadata.yaml``, which ``ros2 bag reindex`` makes; so does a full disk, which
ends the node. Read bags with `rosbags.highlevel.AnyReader` or ``ros2 bag``.

Parameters: see `Parameters`.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ament_index_python import get_package_share_directory
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rosbags.interfaces import Connection, Nodetype, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cmd_vel_guard.declare import declare
from cmd_vel_guard.executor import PolledGroup, waiting
from cmd_vel_guard.process import run
from cmd_vel_guard.reports import OK, report
from turtlebot_gym_ros.base.names import message_type

COLLECT_PERIOD = 0.02
"""Time between two checks for new messages, s."""
IN_FLIGHT = 0.2
"""Time to wait at the end for messages in transit, s."""
DEPTH = 1000
"""Number of messages that a subscription keeps until it is asked."""
_FOREVER = QosTime(2147483647, 4294967295)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    avoid_ros_namespace_conventions=False,
)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of ``data_logger``."""

    output: str = ""
    """New folder for the bag; by default ``bags/`` and the time. The namespace stands before the time."""
    enable_stamped_cmd_vel: bool = True
    """Type to record if a topic has both: TwistStamped (true) or Twist (false)."""


class _LoggedTopic(NamedTuple):
    kind: str
    quality: tuple[bool, bool]
    """Whether it is reliable, and whether it gets what was said before."""
    connection: Connection
    subscription: Subscription


class DataLogger(Node):
    """The recorder as a node."""

    def __init__(self, context: Context) -> None:
        super().__init__("data_logger", context=context, automatically_declare_parameters_from_overrides=True)
        (self._p,) = declare(self, Parameters)
        space = self.get_namespace().strip("/")
        self._own = f"/{space}/" if space else "/"
        self.folder = Path(self._p.output or Path("bags", space, time.strftime("%Y-%m-%dT%H-%M-%S"))).absolute()
        if self.folder.exists():
            raise ValueError(f"parameter 'output' must name a new folder, but {str(self.folder)!r} exists")
        self._types, self._writer = get_typestore(Stores.ROS2_JAZZY), Writer(self.folder, version=9)
        try:
            self._writer.open()
        except sqlite3.Error as error:
            raise OSError(f"no bag can be written in {self.folder}: {error}") from None
        self._unwanted = f"geometry_msgs/msg/{'Twist' if self._p.enable_stamped_cmd_vel else 'TwistStamped'}"
        self._recorded: dict[str, _LoggedTopic] = {}
        self._opened: dict[tuple[str, str], tuple[type, Connection]] = {}
        self._refused: set[tuple[str, str]] = set()
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._collected = PolledGroup()
        for period, work in ((COLLECT_PERIOD, self._collect), (0.1, self._discover), (1.0, self._commit)):
            self.create_timer(period, work, clock=steady)
        self.create_timer(1.0, self._report, clock=steady)
        self.get_logger().info(f"recording to {self.folder}")

    def _report(self) -> None:
        text, space = f"records {len(self._recorded)} topics", self.get_namespace().strip("/") or "turtlebot_gym_ros"
        self._diagnostics.publish(report(self, OK, text, hardware=space, values={"folder": self.folder}))

    def _discover(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            if topic.startswith(self._own) or topic.count("/") == 1:
                published = {info.topic_type for info in self.get_publishers_info_by_topic(topic)}
                wanted = [kind for kind in kinds if kind in published and kind != self._unwanted] or kinds
                self._record(topic, wanted[0])  # a process can subscribe to only one type

    def _record(self, topic: str, kind: str) -> None:
        """Subscribe with the quality of service that all publishers of a topic offer, as rosbag2 does."""
        infos = [info.qos_profile for info in self.get_publishers_info_by_topic(topic) if info.topic_type == kind]
        reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in infos)
        latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in infos)
        before = self._recorded.get(topic)
        if not infos or (topic, kind) in self._refused or (before and before[:2] == (kind, (reliable, latched))):
            return
        try:
            message, connection = self._open(topic, kind, latched=latched)
        except (ValueError, LookupError, ImportError, AttributeError, OSError) as error:
            self._refused.add((topic, kind))
            self.get_logger().error(f"{topic} is not recorded: its type {kind} is not installed here ({error})")
            return
        if before:
            self._take(before)
            self.destroy_subscription(before.subscription)
        profile = QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        subscription = self.create_subscription(
            message, topic, lambda data: None, profile, raw=True, callback_group=self._collected
        )
        self._recorded[topic] = _LoggedTopic(kind, (reliable, latched), connection, subscription)

    def _open(self, topic: str, kind: str, *, latched: bool) -> tuple[type, Connection]:
        """Return a topic's type, and its place in the bag; raise an error if the type is not installed."""
        if (topic, kind) not in self._opened:
            message, offered = message_type(kind), [_LATCHED] if latched else []
            _teach(self._types, kind)
            connection = self._writer.add_connection(topic, kind, typestore=self._types, offered_qos_profiles=offered)
            self._opened[topic, kind] = message, connection
        return self._opened[topic, kind]

    def _take(self, topic: _LoggedTopic) -> None:
        """Record the messages that have arrived, at most as many as are kept, so that a flood does not hold up other topics."""
        for data, info in waiting(topic.subscription, DEPTH):
            self._writer.write(topic.connection, info["received_timestamp"] or time.time_ns(), data)

    def _collect(self) -> None:
        for topic in self._recorded.values():
            self._take(topic)

    def _commit(self) -> None:
        # rosbags commits only at the end; this attribute is private, hence its upper bound in pyproject.toml.
        self._writer.storage.conn.commit()  # type: ignore[union-attr]

    def close(self) -> None:
        """Record messages in transit, and finish the bag."""
        time.sleep(IN_FLIGHT)
        with suppress(sqlite3.Error, OSError):  # of a full disk, which was reported
            self._collect()
            self._writer.close()
        self.get_logger().info(f"recorded {len(self._recorded)} topics in {self.folder}")


def _teach(types: Typestore, kind: str) -> None:
    """Load a message type unknown to rosbags, and the types it consists of, from the ROS installation."""
    if kind in types.fielddefs:
        return
    package, _, name = kind.split("/")
    text = Path(get_package_share_directory(package), "msg", f"{name}.msg").read_text(encoding="utf-8")
    learned = get_types_from_msg(text, kind)
    for _, field in learned[kind][1]:
        element: Any = field[1][0] if field[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else field
        if element[0] == Nodetype.NAME:
            _teach(types, element[1])
    types.register(learned)


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``data_logger``."""
    return run([DataLogger], argv)
