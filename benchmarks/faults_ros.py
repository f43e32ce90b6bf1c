"""The ROS side of the faults' robot: its publishers, clients and ears, on rclpy alone, independent of the package's code."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy.node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool, Empty
from std_srvs.srv import SetBool, Trigger

KINDS: dict[str, Any] = dict.fromkeys(("cmd_vel", "cmd_vel_in", "cmd_vel_teleop"), TwistStamped)
KINDS |= dict.fromkeys(("odom", "estimate"), Odometry)
KINDS |= dict.fromkeys(("reference", "next_reference", "goal_pose"), PoseStamped)
KINDS |= dict.fromkeys(("pose_fix", "initialpose"), PoseWithCovarianceStamped)
KINDS |= dict.fromkeys(("cmd_vel_standby/alive", "reset"), Empty)
KINDS |= {"/diagnostics": DiagnosticArray, "nis": Vector3Stamped, "scan": LaserScan, "emergency_stop": Bool}
"""What topics carry."""
FRAMES: dict[Any, str] = {TwistStamped: "base_footprint", LaserScan: "base_scan"}  # of what is not in the odometry's
PATIENCE, WARN = 0.05, 1
"""Time for which the thread waits for a message, s; level of a report from which it is a complaint."""


class Ros:
    """A node in a thread of its own; with a radio, the publisher of the second button is behind one that can be cut."""

    def __init__(self, domain: int, *, radio: bool) -> None:
        self._context = Context()
        self._context.init([], domain_id=domain)
        self.node: Any = rclpy.node.Node("faults", context=self._context)
        self.reports: list[tuple[float, int, str]] = []  # from /diagnostics: when, s, its level, and the node with its text
        self.radio: Any = Radio(domain) if radio else None
        self._speakers, self._clients = dict[tuple[str, int], Any](), dict[str, Any]()
        self.hear("/diagnostics", self._read_reports, reliable=True)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._over, self._patience, self._idle = threading.Event(), PATIENCE, 0.0
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._over.is_set():
            begun, patience = time.monotonic(), self._patience
            with contextlib.suppress(rclpy_implementation.InvalidHandle):  # of what a fault has just destroyed
                self._executor.spin_once(timeout_sec=patience)
            if time.monotonic() - begun >= patience:
                self._idle = begun

    def hear(self, topic: str, take: Callable[..., None], *, reliable: bool = False) -> Any:
        """Subscribe to every message of a topic; ``take`` may want a message's info too."""
        every = QoSProfile(depth=5000, reliability=getattr(ReliabilityPolicy, "RELIABLE" if reliable else "BEST_EFFORT"))
        return self.node.create_subscription(KINDS[topic], topic, take, every)

    def catch_up(self, patience: float = 5.0) -> bool:
        """Wait until nothing waits that has arrived, and return whether it came to that in time, s."""
        begun, self._patience = time.monotonic(), 0.004  # shorter than between two messages
        while self._idle < begun and time.monotonic() < begun + patience:
            time.sleep(0.005)
        self._patience = PATIENCE
        return self._idle >= begun and self._thread.is_alive()

    def speaker(self, topic: str, which: int = 0) -> Any:
        """Return a publisher; those above 1 end with the fault."""
        if self.radio and (topic, which) == ("emergency_stop", 1):
            return self.radio.speaker
        key = (topic, which)
        if key not in self._speakers:
            reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
            events = PublisherEventCallbacks(use_default_callbacks=False)  # an executor that waits for events keeps them alive
            self._speakers[key] = self.node.create_publisher(KINDS[topic], topic, reliable, event_callbacks=events)
            until = time.monotonic() + (1.0 if which > 1 else 0.0)
            while not self._speakers[key].get_subscription_count() and time.monotonic() < until:
                time.sleep(0.01)
        return self._speakers[key]

    def silence(self, topic: str, which: int) -> None:
        """End a publisher."""
        self.node.destroy_publisher(self._speakers.pop((topic, which)))

    def silence_strangers(self) -> None:
        """End the publishers that only a fault has."""
        for topic, which in [key for key in self._speakers if key[1] > 1]:
            self.silence(topic, which)

    def ask(self, service: str, patience: float = 3.0, **request: Any) -> bool:
        """Call a service, and return whether it agreed in time."""
        kind = SetBool if request else Trigger
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
        return [*dict.fromkeys(text for at, level, text in self.reports if at > since and level >= WARN)]

    def _read_reports(self, message: Any) -> None:
        del self.reports[:-1000]
        for status in message.status:
            level = int.from_bytes(status.level, "little") if isinstance(status.level, bytes) else status.level
            self.reports.append((time.time(), level, f"{status.name}: {status.message}"))

    def close(self) -> None:
        """End the node."""
        self._over.set()
        self._thread.join()
        if self.radio:
            self.radio.close()
        self.node.destroy_node()
        self._context.shutdown()


def stamped(topic: str, at: float) -> Any:
    """Return an empty message of a topic, with a stamp, s, if its kind has one."""
    message = KINDS[topic]()
    if hasattr(message, "header"):
        message.header.frame_id = FRAMES.get(KINDS[topic], "odom")
        message.header.stamp.sec, message.header.stamp.nanosec = int(at), int(at % 1.0 * 1e9)
    return message


class Radio:
    """A button's publisher whose radio can be cut: the sockets of its own DDS participant are replaced by one to nowhere."""

    def __init__(self, domain: int) -> None:
        self._context, before = Context(), _sockets()
        self._context.init([], domain_id=domain)
        self._node: Any = rclpy.node.Node("radio", context=self._context)
        hears = range(7400 + 250 * domain, 7650 + 250 * domain)  # the ports of a domain
        self._senders = [at for at, port in _sockets().items() if at not in before and port not in hears]
        self.speaker = self._node.create_publisher(Bool, "emergency_stop", 1)  # keeps no message to send it again

    @contextmanager
    def cut(self) -> Iterator[None]:
        """Lose what it sends."""
        kept = {at: os.dup(at) for at in self._senders}
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as nowhere:
            for at in kept:
                os.dup2(nowhere.fileno(), at)
        try:
            yield
        finally:
            for at, sender in kept.items():
                os.dup2(sender, at)
                os.close(sender)

    def close(self) -> None:
        """End the node."""
        self._node.destroy_node()
        self._context.shutdown()


def _sockets() -> dict[int, int]:
    """Return the ports of this process's UDP sockets by their file descriptors."""
    sockets = {}
    for path in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(path.name))) as connection:
            if (connection.family, connection.type) == (socket.AF_INET, socket.SOCK_DGRAM):
                sockets[int(path.name)] = connection.getsockname()[1]
    return sockets
