"""The processes of the live graph, and a probe that stands in for the robot, on rclpy only.

A command has arrived when DDS has received it (``received_timestamp``): a Python callback sees it later, and much later while
the probe's own publisher waits for a stopped process.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import cos, sin
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from ros_nodes import Nodes
from turtlebot_gym.values import Pose

PERIOD = 0.05
"""Period of the probe's odometry, s."""
PATIENCE = 60.0
"""Longest wait for a state, s."""
FAR = Pose(1000.0, 0.0, 0.0)
"""A waypoint that is never reached."""
GUARDED = {"velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"]}
"""Remappings that put the guard between controller and robot."""


class Heard(NamedTuple):
    """A command that the probe received."""

    time: float  # s, steady clock, in the callback
    arrival: float  # s, steady clock, at DDS
    v: float  # m/s
    omega: float  # rad/s
    stamp: float  # s, by the sender

    @property
    def is_zero(self) -> bool:
        """Whether the command stops the robot."""
        return self.v == 0.0 and self.omega == 0.0


class Probe:
    """A stand-in for the robot: it publishes odometry and an emergency stop, and receives commands, all in one thread.

    Args:
        speaks: Whether the probe publishes odometry; if not, a plant does.
    """

    def __init__(self, *, speaks: bool) -> None:
        self.node = Node("probe")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.heard: list[Heard] = []
        self.ticks: list[float] = []
        """Arrivals of the plant's true state, s."""
        self.sent: list[float] = []
        """Times at which odometry was published, s."""
        self.headings: list[float] = []
        self.stamp = time.time_ns()
        """Stamp of the next odometry, ns."""
        self.silent = False
        """Whether the odometry has stopped."""
        self.pressed: bool | None = False
        """State of the emergency stop; None if it is silent."""
        self._draws = np.random.default_rng(0)
        self.node.create_subscription(TwistStamped, "cmd_vel", self._hear, 100)
        self.node.create_subscription(Odometry, "true_state", lambda message: self.ticks.append(time.monotonic()), 100)
        if speaks:
            self._odometry = self.node.create_publisher(Odometry, "odom", 10)
            self._emergency = self.node.create_publisher(Bool, "emergency_stop", 10)
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.node.create_timer(PERIOD, self._send, clock=steady)
            self.node.create_timer(0.1, self.tell_emergency, clock=steady)

    def _hear(self, message: TwistStamped, info: dict[str, int]) -> None:
        now, age = time.monotonic(), 1e-9 * (time.time_ns() - info["received_timestamp"])
        twist, stamp = message.twist, 1e-9 * Time.from_msg(message.header.stamp).nanoseconds
        self.heard.append(Heard(now, now - age, twist.linear.x, twist.angular.z, stamp))

    def _send(self) -> None:
        """Publish odometry of a robot that stands with changing headings, so that each message leads to a distinct command."""
        behind = time.time_ns() - self.stamp  # the nodes refuse odometry that is old by its stamp
        self.stamp += behind if behind > 4e9 * PERIOD else 0
        message = Odometry()
        message.header.frame_id = "odom"
        message.header.stamp = Time(nanoseconds=self.stamp).to_msg()
        self.stamp += round(PERIOD * 1e9)
        heading = self._draws.uniform(-0.1, 0.1)  # what a robot can have turned: the filter refuses jumps
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = sin(0.5 * heading), cos(0.5 * heading)
        if not self.silent:
            self.headings.append(heading)
            self.sent.append(time.monotonic())
            self._odometry.publish(message)

    def tell_emergency(self) -> None:
        """Publish the state of the emergency stop."""
        if self.pressed is not None:
            self._emergency.publish(Bool(data=self.pressed))

    def spin(self, seconds: float) -> None:
        """Spin for some time, s."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def until(self, condition: Callable[[], Any], *, patience: float = PATIENCE) -> None:
        """Spin until a condition holds; patience in s.

        Raises:
            TimeoutError: If it does not hold in time.
        """
        deadline = time.monotonic() + patience
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"waited {patience} s in vain.")
            self._executor.spin_once(timeout_sec=0.01)

    def enable(self, name: str) -> None:
        """Call a node's ``~/enable`` until it agrees."""
        client = self.node.create_client(SetBool, f"{name}/enable")

        def agrees() -> bool:
            future = client.call_async(SetBool.Request(data=True))
            self._executor.spin_until_future_complete(future, timeout_sec=1.0)
            answer = future.result() if future.done() else None
            return answer is not None and answer.success

        self.until(client.service_is_ready)
        self.until(agrees)  # a request to a killed server whose loss is not detected yet gets no answer: repeat it
        self.node.destroy_client(client)

    def drive(self, *names: str) -> None:
        """Enable nodes, and wait until the robot moves."""
        for name in names:
            self.enable(name)
        begin = len(self.heard)
        self.until(lambda: any(not command.is_zero for command in self.heard[begin:]))
        self.spin(0.5)


@contextmanager
def graph(*, speaks: bool, remappings: dict[str, list[str]]) -> Iterator[tuple[Probe, Nodes]]:
    """Yield a probe, and processes to start, which end with the block; if it fails, print their output."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "far.csv").write_text(f"{FAR.x},{FAR.y},{FAR.theta}\n")
        nodes = Nodes(Path(folder), remappings)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        probe = Probe(speaks=speaks)
        try:
            yield probe, nodes
        except Exception:
            for log in Path(folder).glob("*.log"):
                print(f"--- {log.stem}\n{log.read_text()[-2000:]}", file=sys.stderr)
            raise
        finally:
            nodes.close()
            probe.node.destroy_node()  # the next graph's filter refuses odometry of two publishers
            rclpy.shutdown()
