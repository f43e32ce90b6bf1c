"""The ROS side of a field test: a node that listens, and drives that end with the robot at rest."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from turtlebot_gym_lab.field.findings import End, Topic
from turtlebot_gym_ros.base.process import Runner, go_on
from turtlebot_gym_ros.base.qos import LATCHED, SENSOR
from turtlebot_gym_ros.node.shell import Shell

PATIENCE = 10.0
"""Longest wait for a service, and for one that refuses, s."""
REST = 1.0
"""Time that a robot takes to stand, s."""
LOST = 4.0
"""Time for which a drive may wait for its inputs before it is given up, s: new leads of clocks settle in 1 s, node by node."""


class Heard(NamedTuple):
    """A message and its times, s."""

    arrival: float
    stamp: float
    """Stamp of its header; 0 without one."""
    message: Any


class TopicListener:
    """A node that hears what the robot, the guard and the emergency stop say, and asks for services.

    Args:
        runner: The runner of the node.
    """

    def __init__(self, runner: Runner) -> None:
        self.runner = runner
        self.node = Node("field_test", context=runner.context)
        self.heard: dict[str, list[Heard]] = {}
        for topic, kind in (("odom", Odometry), ("scan", LaserScan), ("emergency_stop", Bool)):
            self.hear(topic, kind)  # best effort, so that publishers of either kind are heard
        self.hear("cmd_vel_guard/enabled", Bool, LATCHED)
        runner.add(self)

    def hear(self, topic: str, kind: type, qos: QoSProfile = SENSOR) -> None:
        """Collect the messages of a topic."""
        heard = self.heard[topic] = []

        def note(message: Any, info: Mapping[str, Any]) -> None:
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            at = 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
            heard.append(Heard(1e-9 * info["received_timestamp"], at, message))

        callback: Any = note  # takes the message's times, too, which rclpy supports but its types do not show
        self.node.create_subscription(kind, topic, callback, qos)

    def topic(self, name: str) -> Topic:
        """Return who is at the ends of a topic, and what was heard on it."""
        full, heard = self.node.resolve_topic_name(name), list(self.heard.get(name, ()))
        ends = self.node.get_publishers_info_by_topic(full), self.node.get_subscriptions_info_by_topic(full)
        publishers, subscribers = (tuple(map(_end, infos)) for infos in ends)
        others = tuple(end for end in subscribers if end.node not in (self.node.get_name(), "data_logger"))
        arrivals, stamps = [message.arrival for message in heard], [message.stamp for message in heard]
        return Topic(full, publishers, others, np.array(arrivals), np.array(stamps))

    def said(self, topic: str, value: bool) -> bool:
        """Return whether the last message on a topic of booleans has a value."""
        return bool(self.heard[topic]) and self.heard[topic][-1].message.data == value

    def enable(self, node: str, enabled: bool) -> str:
        """Enable or disable a node; return why it refuses, or an empty text."""
        client = self.node.create_client(SetBool, f"{node}/enable")
        try:
            if not wait_for(client.service_is_ready):
                return f"{node} does not run"
            future = client.call_async(SetBool.Request(data=enabled))
            if not wait_for(future.done):
                return f"{node} does not answer"
            answer: Any = future.result()
            return "" if answer.success else answer.message
        finally:
            self.node.destroy_client(client)


def _end(info: Any) -> End:
    qos = info.qos_profile
    return End(info.node_name, info.topic_type, qos.reliability == ReliabilityPolicy.RELIABLE)


def wait_for(condition: Callable[[], Any], timeout: float = PATIENCE) -> bool:
    """Wait until a condition holds, at most a time in s, and return whether it does."""
    until = time.monotonic() + timeout
    while not (holds := bool(condition())) and time.monotonic() < until:
        time.sleep(0.02)
    return holds


def enable(listener: TopicListener, node: str) -> str:
    """Enable a node, which may have to hear a button first; return why it still refuses after a while, or an empty text."""
    until = time.monotonic() + PATIENCE
    while (why := listener.enable(node, True)) and time.monotonic() < until:
        time.sleep(0.02)
    return why


class Part(NamedTuple):
    """A node of a drive."""

    block: Any
    name: str
    parameters: Mapping[str, Any]
    remaps: Mapping[str, str] = {}


COMMANDS = {"cmd_vel": "cmd_vel_in"}
"""Drives speak to the guard."""


@contextmanager
def _running(listener: TopicListener, parts: Sequence[Part], *, stamped: bool) -> Iterator[list[Shell]]:
    """Run nodes in a thread of their own, and stop the robot at the end, however it ends."""
    runner = Runner(beside=listener.runner)  # whose context knows the emergency stop already
    try:
        shells = []
        for part in parts:
            remaps = [word for old, new in part.remaps.items() for word in ("-r", f"{old}:={new}")]
            overrides = {"enable_stamped_cmd_vel": stamped, **part.parameters}
            made: Callable[..., Any] = part.block
            shell = Shell(
                made, part.block.Params, name=part.name, context=runner.context, overrides=overrides, arguments=remaps
            )
            runner.add(shell)
            shells.append(shell)
        runner.start()
        yield shells
    finally:
        runner.close()


def drive(listener: TopicListener, parts: Sequence[Part], *, stamped: bool, timeout: float) -> str:
    """Drive with some nodes until the last of them is done; return why it was not, or an empty text.

    Args:
        listener: The listener.
        parts: The nodes; the last one moves the robot.
        stamped: Whether velocities are stamped.
        timeout: Longest time of the drive, s.
    """
    with _running(listener, parts, stamped=stamped) as shells:
        switch, name = shells[-1].switch, parts[-1].name
        assert switch is not None
        try:
            for node in ("cmd_vel_guard", name):
                if why := enable(listener, node):
                    return f"{node} is not enabled: {why}"
            why = _follow(lambda: switch.safety.state, lambda: listener.said("cmd_vel_guard/enabled", True), timeout)
        finally:
            switch.stop("the field test ends the drive", disable=True)
            listener.enable("cmd_vel_guard", False)
    time.sleep(REST)
    return why


def _follow(state: Callable[[], str], passes: Callable[[], bool], timeout: float) -> str:
    """Wait until a drive is done, and return why it was not, or an empty text."""
    until, alive = time.monotonic() + timeout, time.monotonic()
    while (now := time.monotonic()) < until:
        go_on()
        what = state()
        if what in ("silent: done", "stopping: done"):
            return ""
        alive = now if what == "active" and passes() else alive
        if now > alive + LOST:
            return what if what != "active" else "the guard has stopped the robot"
        time.sleep(0.02)
    return f"it took more than {timeout:g} s"


VELOCITIES = {"geometry_msgs/msg/TwistStamped": TwistStamped, "geometry_msgs/msg/Twist": Twist}
"""Types of a velocity, by name."""
