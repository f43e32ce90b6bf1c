"""The ROS side of the faults' robot: its publishers, clients and ears, on rclpy alone, independent of the package's code."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from faults_radio import Radio

PATIENCE = 0.05
"""Time for which the thread waits for a message, s."""
WARN = 1
"""Level of a report from which it is a complaint."""


class Report(NamedTuple):
    """What a node reports in ``/diagnostics``."""

    at: float
    """When it was heard, s."""
    name: str
    level: int
    text: str
    values: dict[str, str]


class Ros:
    """A node in a thread of its own.

    Args:
        domain: Its ROS domain.
        radio: Whether one publisher, of the second button, is behind a radio that can be cut.
    """

    def __init__(self, domain: int, *, radio: bool) -> None:
        import rclpy.node
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        self.context = Context()
        self.context.init([], domain_id=domain)
        self.node: Any = rclpy.node.Node("faults", context=self.context)
        self.kinds = _kinds()
        self.reports: list[Report] = []
        """What was heard on ``/diagnostics``, oldest first."""
        self._reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._every = {
            reliable: QoSProfile(depth=5000, reliability=policy)
            for reliable, policy in ((True, ReliabilityPolicy.RELIABLE), (False, ReliabilityPolicy.BEST_EFFORT))
        }
        self._speakers: dict[tuple[str, int], Any] = {}
        self._clients: dict[str, Any] = {}
        self.radio = Radio(domain) if radio else None
        if self.radio:  # it keeps no message to send it again
            self._speakers["emergency_stop", 1] = self.radio.node.create_publisher(self.kinds["Bool"], "emergency_stop", 1)
        self.node.create_subscription(self.kinds["DiagnosticArray"], "/diagnostics", self._read_reports, 10)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._over, self._patience, self._idle = threading.Event(), PATIENCE, 0.0
        self._thread = threading.Thread(target=self._spin, daemon=True)

    def start(self) -> None:
        """Begin to hear."""
        self._thread.start()

    def _spin(self) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        while not self._over.is_set():
            begun, patience = time.monotonic(), self._patience
            with contextlib.suppress(rclpy_implementation.InvalidHandle):  # of what a fault has just destroyed
                self._executor.spin_once(timeout_sec=patience)
            if time.monotonic() - begun >= patience:
                self._idle = begun

    def hear(self, topic: str, kind: str, take: Callable[..., None], *, reliable: bool = False) -> Any:
        """Subscribe to every message of a topic; ``take`` may want a message's info too."""
        return self.node.create_subscription(self.kinds[kind], topic, take, self._every[reliable])

    def catch_up(self, patience: float = 5.0) -> bool:
        """Wait until nothing waits that has arrived, and return whether it came to that in time, s."""
        begun, self._patience = time.monotonic(), 0.004  # shorter than between two messages
        while self._idle < begun and time.monotonic() < begun + patience:
            time.sleep(0.005)
        self._patience = PATIENCE
        return self._idle >= begun and self._thread.is_alive()

    def speaker(self, topic: str, kind: str, which: int = 0) -> Any:
        """Return a publisher; those above 1 end with the fault."""
        key = (topic, which)
        if key not in self._speakers:
            from rclpy.event_handler import PublisherEventCallbacks

            events = PublisherEventCallbacks(use_default_callbacks=False)  # an executor that waits for events keeps them alive
            speaker = self.node.create_publisher(self.kinds[kind], topic, self._reliable, event_callbacks=events)
            self._speakers[key] = speaker
            until = time.monotonic() + (1.0 if which > 1 else 0.0)
            while not speaker.get_subscription_count() and time.monotonic() < until:
                time.sleep(0.01)
        return self._speakers[key]

    def silence(self, topic: str, which: int) -> None:
        """End a publisher."""
        self.node.destroy_publisher(self._speakers.pop((topic, which)))

    def silence_strangers(self) -> None:
        """End all publishers that a fault has made."""
        for topic, which in [key for key in self._speakers if key[1] > 1]:
            self.silence(topic, which)

    def stamped(self, kind: str, frame: str, at: float) -> Any:
        """Return an empty message with a stamp, s."""
        message = self.kinds[kind]()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = int(at), int(at % 1.0 * 1e9)
        return message

    def flood(self, topic: str, message: Any, duration: float) -> None:
        """Publish a message as often as a process can for a time, s."""
        speaker, until = self.speaker(topic, type(message).__name__, 9), time.monotonic() + duration
        while time.monotonic() < until:
            speaker.publish(message)

    def ask(self, service: str, patience: float = 3.0, **request: Any) -> bool:
        """Call a service, and return whether it agreed in time."""
        kind = self.kinds["SetBool" if request else "Trigger"]
        if service not in self._clients:  # kept, since a new one is not discovered at once
            self._clients[service] = self.node.create_client(kind, service)
        client = self._clients[service]
        until = time.monotonic() + patience
        while not client.service_is_ready() and time.monotonic() < until:
            time.sleep(0.01)
        future = client.call_async(kind.Request(**request))
        while not future.done() and time.monotonic() < until:
            time.sleep(0.005)
        return bool(future.done() and future.result().success)

    def complaints(self, since: float) -> list[str]:
        """Return what nodes have complained about since a time, each once."""
        return [*dict.fromkeys(f"{each.name}: {each.text}" for each in self.reports if each.at > since and each.level >= WARN)]

    def _read_reports(self, message: Any) -> None:
        del self.reports[:-1000]
        for status in message.status:
            level = int.from_bytes(status.level, "little") if isinstance(status.level, bytes) else status.level
            values = {value.key: value.value for value in status.values}
            self.reports.append(Report(time.time(), status.name, level, status.message, values))

    def close(self) -> None:
        """End the node."""
        self._over.set()
        self._thread.join()
        if self.radio:
            self.radio.close()
        self.node.destroy_node()
        self.context.shutdown()


def _kinds() -> dict[str, Any]:
    """Return the types of messages and services by name."""
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import LaserScan
    from std_msgs.msg import Bool, Empty
    from std_srvs.srv import SetBool, Trigger

    kinds = (
        DiagnosticArray,
        PoseStamped,
        PoseWithCovarianceStamped,
        TwistStamped,
        Odometry,
        LaserScan,
        Bool,
        Empty,
        SetBool,
        Trigger,
    )
    return {kind.__name__: kind for kind in kinds}
