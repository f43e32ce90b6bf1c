"""A shell around a small block, with a world that the test moves."""

import math
import time
from dataclasses import dataclass
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from std_msgs.msg import String
from std_srvs.srv import SetBool

from cmd_vel_guard.qos import LATCHED
from turtlebot_gym.values import STOP, Command, State
from turtlebot_gym_ros import Input, On, Output, Shell


def over_the_wire(message):
    """Return a message as it arrives: written to bytes and read again."""
    return deserialize_message(serialize_message(message), type(message))


def odometry(seconds=None, *, x=0.0, theta=0.0, frame="odom", norm=1.0):
    """Return odometry; its stamp is now, or a number of seconds."""
    message = Odometry()
    message.header.frame_id = frame
    message.header.stamp = Time(nanoseconds=time.time_ns() if seconds is None else round(seconds * 1e9)).to_msg()
    message.pose.pose.position.x = x
    message.pose.pose.orientation.z = norm * math.sin(0.5 * theta)
    message.pose.pose.orientation.w = norm * math.cos(0.5 * theta)
    return message


PATIENCE = 30.0
"""Longest wait for a state, s: far above what it takes, so that only a missing state fails."""


def wait_for(what):
    deadline = time.monotonic() + PATIENCE
    while not (value := what()):
        if time.monotonic() > deadline:
            pytest.fail(f"waited {PATIENCE} s in vain")
        time.sleep(0.005)
    return value


@dataclass(frozen=True, kw_only=True)
class NoParameters:
    pass


class Mover:
    """A block that drives ahead on each odometry; the test decides what a step does."""

    inputs = {"odometry": Input(topic="odom", type=State, reliable=False)}
    outputs = {"command": Output(topic="cmd_vel", type=Command, stop=STOP)}
    trigger = On("odometry")

    def __init__(self, params):
        self.intervals = []
        self.resets = 0
        self.go_on()

    def go_on(self):
        self.act = lambda: {"command": Command(0.1, 0.0)}

    def reset(self):
        self.resets += 1

    def step(self, dt, odometry):
        self.intervals.append(dt)
        return self.act()


class Bench:
    """A shell around a mover, whose steady clock the test sets, and a peer that is its world."""

    def __init__(self, runner, peer, *, make=Mover, enabled=True, **overrides):
        self.peer, self.now = peer, SimpleNamespace(at=0.0)
        self.odometry = peer.speak("odom", Odometry)
        self.commands = peer.hear("cmd_vel", TwistStamped)
        self.states = peer.hear("mover/state", String, LATCHED)
        self.reports = peer.hear("/diagnostics", DiagnosticArray)
        overrides = overrides if enabled is None else {"start_enabled": enabled, **overrides}
        self.shell = Shell(
            make, NoParameters, name="mover", context=runner.context, overrides=overrides, now=lambda: self.now.at
        )
        runner.add(self.shell)
        self.block = self.shell.block
        self.stamp = 10.0
        self.wait_for(lambda: self.odometry.get_subscription_count() and self.states)
        self.wait_for(self.shell.inputs.feeds["odometry"]._subscription.get_publisher_count)  # the reader finds it by itself
        self.wait_for(lambda: peer.node.count_publishers("cmd_vel"))

    def wait_for(self, what):
        return wait_for(what)

    def send(self, *, dt=0.1, **fields):
        self.stamp += dt
        self.odometry.publish(odometry(self.stamp, **fields))

    def drive(self):
        steps = self.steps

        def moves():
            self.send()
            time.sleep(0.01)
            return self.steps > steps and self.state == "active" and 0.1 in self.speeds

        self.wait_for(moves)
        self.settle()

    def settle(self):
        self.send()
        received = self.shell.inputs.feeds["odometry"]
        before = -1
        while before != received._received:
            before = received._received
            time.sleep(0.15)

    @property
    def steps(self):
        return len(self.block.intervals)

    @property
    def state(self):
        return self.states[-1].data if self.states else ""

    @property
    def speeds(self):
        return [message.twist.linear.x for message in self.commands]

    def stops(self, state):
        """Wait until it has stopped, and check that motion was followed by zeros only, then silence."""
        self.wait_for(lambda: 0.0 in self.speeds)
        self.wait_for(lambda: self.advance(0.02) and self.state == f"silent: {state}")
        first = self.speeds.index(0.0)
        assert set(self.speeds[:first]) == {0.1}
        assert set(self.speeds[first:]) == {0.0}
        self.peer.ask("mover/get_parameters", GetParameters, GetParameters.Request())  # a round trip that changes nothing
        sent = len(self.commands)
        for _ in range(10):
            self.advance(0.1)
        assert len(self.commands) == sent

    def advance(self, seconds):
        self.now.at += seconds
        time.sleep(0.01)
        return True

    def report(self, text):
        def find():
            self.advance(0.05)
            statuses = [message.status[0] for message in self.reports if message.status[0].name == "/mover"]
            return next((status for status in statuses if text in status.message), None)

        return self.wait_for(find)

    def enable(self, on=True):
        return self.peer.ask("mover/enable", SetBool, SetBool.Request(data=on))
