"""Record the graph: every message of all topics in a rosbag2 bag.

It subscribes to every topic as it appears, without configuration. In a namespace it records the topics below it and those of
the root, such as ``/tf``, which robots share; topics of other robots are left to their own recorders. A ``kill -9`` loses at
most the last second, see `bag`. Read bags with `rosbags.highlevel.AnyReader` or ``ros2 bag``. If the disk is full, the bag
ends, is complete, and ``/diagnostics`` (1 Hz) has an error.

Parameters: see `Parameters`.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rosbags.interfaces import Connection

from cmd_vel_guard.declare import declare
from cmd_vel_guard.executor import PolledGroup, waiting
from cmd_vel_guard.process import run
from cmd_vel_guard.reports import ERROR, OK, report
from turtlebot_gym_ros.base.names import message_type
from turtlebot_gym_ros.recording.bag import Bag

COLLECT_PERIOD = 0.02
"""Time between two checks for new messages, s."""
IN_FLIGHT = 0.2
"""Time to wait at the end for messages in transit, s."""
DEPTH = 1000
"""Number of messages that a subscription keeps until it is asked."""
REMEMBERED = 2 * DEPTH
"""Number of messages of a topic among which one that another subscription has heard is recognized."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of ``data_logger``."""

    output: str = ""
    """New folder for the bag; by default ``bags/`` and the time. The namespace stands before the time."""
    enable_stamped_cmd_vel: bool = True
    """Type to record if a topic has both: TwistStamped (true) or Twist (false)."""


class _LoggedTopic(NamedTuple):
    """A recorded topic, with a subscription for each quality of service that its publishers have had.

    No subscription is given up for another, since what is sent between the two would be lost.
    """

    kind: str
    write: Callable[..., None]
    subscriptions: dict[tuple[bool, bool], Subscription]
    """By whether they are reliable and whether they get what was said before."""

    def collect(self) -> None:
        """Record the messages that have arrived, at most as many as are kept, so that a flood does not hold up other topics."""
        for subscription in self.subscriptions.values():
            for message, info in waiting(subscription, DEPTH):
                self.write(message, info)


class DataLogger(Node):
    """The recorder as a node."""

    def __init__(self, context: Context) -> None:
        super().__init__("data_logger", context=context, automatically_declare_parameters_from_overrides=True)
        (p,) = declare(self, Parameters)
        self._p = p
        space = self.get_namespace().strip("/")
        self._own = f"/{space}/" if space else "/"
        folder = Path(p.output or Path("bags", space, time.strftime("%Y-%m-%dT%H-%M-%S"))).absolute()
        if folder.exists():
            raise ValueError(f"parameter 'output' must name a new folder, but {str(folder)!r} exists")
        self._bag = Bag(folder)
        self._recorded: dict[str, _LoggedTopic] = {}
        self._opened: dict[tuple[str, str], tuple[type, Connection]] = {}
        self._refused: set[tuple[str, str]] = set()
        self._ended: str | None = None
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._collected = PolledGroup()
        for period, work in ((COLLECT_PERIOD, self._collect), (0.1, self._discover), (1.0, self._commit)):
            self.create_timer(period, partial(self._unless_full, work), clock=steady)
        self.create_timer(1.0, self._report, clock=steady)
        self.get_logger().info(f"recording to {folder}")

    def _unless_full(self, work: Callable[[], None]) -> None:
        """Do some work of the recording, and end the recording if the disk refuses it."""
        if self._ended:
            return
        try:
            work()
        except Bag.FULL as error:
            self._ended = f"the recording ended, and what was recorded is readable in {self._bag.folder}: {error}"
            self.get_logger().error(self._ended)
            for topic in self._recorded.values():
                for subscription in topic.subscriptions.values():
                    self.destroy_subscription(subscription)
            try:
                self._bag.end_early()
            except Bag.FULL as left:
                self._ended += f"; without metadata.yaml ({left}): ros2 bag reindex makes it"

    def _report(self) -> None:
        level, text = (ERROR, self._ended) if self._ended else (OK, f"records {len(self._recorded)} topics")
        space = self.get_namespace().strip("/") or "turtlebot_gym_ros"
        self._diagnostics.publish(report(self, level, text, hardware=space, values={"folder": self._bag.folder}))

    def _discover(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            if not topic.startswith(self._own) and topic.count("/") > 1:
                continue
            recorded = self._recorded.get(topic)
            kind = kinds[0] if len(kinds) == 1 else self._choose(topic, recorded.kind if recorded else "")
            if recorded is None or recorded.kind != kind:
                self._record(topic, kind)

    def _choose(self, topic: str, known: str) -> str:
        """Return which type of a topic with several to record, since a process can subscribe to only one."""
        kinds = sorted({info.topic_type for info in self.get_publishers_info_by_topic(topic)})
        wanted = f"geometry_msgs/msg/{(TwistStamped if self._p.enable_stamped_cmd_vel else Twist).__name__}"
        kind = next((candidate for candidate in (wanted, known, *kinds) if candidate in kinds), known)
        if len(kinds) > 1 and (topic, "") not in self._refused:
            self._refused.add((topic, ""))
            self.get_logger().error(f"{topic} is published as {' and '.join(kinds)}: only {kind} is recorded")
        return kind

    def _record(self, topic: str, kind: str) -> None:
        """Subscribe with each quality of service that the publishers of a topic have."""
        wanted = {
            (
                info.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
            )
            for info in self.get_publishers_info_by_topic(topic)
            if info.topic_type == kind
        }
        if not wanted or (topic, kind) in self._refused:
            return
        recorded = self._recorded.get(topic)
        if recorded is not None and recorded.kind == kind and wanted <= recorded.subscriptions.keys():
            return
        try:
            if (topic, kind) not in self._opened:
                self._opened[topic, kind] = (
                    message_type(kind),
                    self._bag.add(topic, kind, latched=all(latched for _, latched in wanted)),
                )
        except (ValueError, LookupError, ImportError, AttributeError, OSError) as error:
            self._refused.add((topic, kind))
            self.get_logger().error(f"{topic} is not recorded: its type {kind} is not installed here ({error})")
            return
        message, connection = self._opened[topic, kind]
        if recorded is not None and recorded.kind != kind:
            recorded.collect()
            for subscription in recorded.subscriptions.values():
                self.destroy_subscription(subscription)
            recorded = None
        if recorded is None:
            recorded = self._recorded[topic] = _LoggedTopic(kind, self._writer_of(connection), {})
        for reliable, latched in wanted - recorded.subscriptions.keys():
            profile = QoSProfile(
                depth=DEPTH,
                reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
                durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
            )
            recorded.subscriptions[reliable, latched] = self.create_subscription(
                message,
                topic,
                recorded.write,
                profile,
                raw=True,
                callback_group=self._collected,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),  # another one hears the others
            )

    def _writer_of(self, connection: Connection) -> Callable[..., None]:
        """Return a function that records a message of a topic, but not if another subscription has heard it."""
        heard: set[int] = set()
        order: deque[int] = deque()

        def write(data: bytes, info: dict[str, int]) -> None:
            which = hash((info["source_timestamp"], info["publication_sequence_number"], data))
            if which in heard:
                return
            heard.add(which)
            order.append(which)
            if len(order) > REMEMBERED:
                heard.remove(order.popleft())
            self._bag.write(connection, info["received_timestamp"] or time.time_ns(), data)

        return write

    def _collect(self) -> None:
        for topic in self._recorded.values():
            topic.collect()

    def _commit(self) -> None:
        for topic, recorded in list(self._recorded.items()):
            self._record(topic, recorded.kind)
        self._bag.commit()

    def close(self) -> None:
        """Record messages in transit, and finish the bag."""
        time.sleep(IN_FLIGHT)
        self._unless_full(self._finish)
        self.get_logger().info(f"recorded {len(self._recorded)} topics in {self._bag.folder}")

    def _finish(self) -> None:
        self._collect()
        self._bag.close()


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``data_logger``."""
    return run([DataLogger], argv)


if __name__ == "__main__":
    raise SystemExit(main())
