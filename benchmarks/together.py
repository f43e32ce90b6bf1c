"""Time from odometry to the command that rests on it, with filter and controller in a process each and in one process.

Odometry comes at 20 Hz; the command has its stamp. The forms take turns, since the machine is never quite quiet.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node

from harness.ros_domain import claimed_domain
from turtlebot_gym.files import write_text
from turtlebot_gym_ros.base.process import Runner

FORMS: Mapping[str, Sequence[Sequence[str]]] = {
    "a process for each node": (("kalman_filter",), ("velocity_controller",)),
    "one process": (("kalman_filter", "velocity_controller"),),
}
"""The nodes of each process, by form."""
PERIOD = 0.05
"""Time between two messages of odometry, s."""
PATIENCE = 30.0
"""Longest wait for the first command, s."""


class Driver:
    """A robot that executes its commands, sends odometry and a reference, and notes when each command comes.

    Args:
        runner: Runs its node.
    """

    def __init__(self, runner: Runner) -> None:
        self.node = Node("robot", context=runner.context)
        self._odometry = self.node.create_publisher(Odometry, "odom", 10)
        self._reference = self.node.create_publisher(PoseStamped, "reference", 10)
        self.node.create_subscription(TwistStamped, "cmd_vel", self._hear, 10)
        self._sent: dict[int, int] = {}
        self._x = self._y = self._theta = self._v = self._omega = 0.0
        self.delays: list[float] = []
        """Delays of the commands, s."""
        self.moment = 0

    def _hear(self, message: TwistStamped) -> None:
        now, stamp = time.perf_counter_ns(), message.header.stamp
        self._v, self._omega = message.twist.linear.x, message.twist.angular.z
        if sent := self._sent.pop(stamp.sec * 10**9 + stamp.nanosec, None):
            self.delays.append(1e-9 * (now - sent))

    def send(self) -> None:
        """Send the next odometry and, with every second one, the reference."""
        self.moment += 1
        v, omega, message = self._v, self._omega, Odometry()
        self._x += v * math.cos(self._theta) * PERIOD
        self._y += v * math.sin(self._theta) * PERIOD
        self._theta += omega * PERIOD
        message.header.frame_id, message.header.stamp = "odom", self.node.get_clock().now().to_msg()
        message.pose.pose.position.x, message.pose.pose.position.y = self._x, self._y
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(self._theta / 2), math.cos(self._theta / 2)
        message.twist.twist.linear.x, message.twist.twist.angular.z = v, omega
        if self.moment % 2:
            goal = PoseStamped(header=message.header)
            goal.pose.position.x, goal.pose.orientation.w = 50.0, 1.0
            self._reference.publish(goal)
        self._sent[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec] = time.perf_counter_ns()
        self._odometry.publish(message)


@contextmanager
def started(processes: Sequence[Sequence[str]], domain: int, policy: str) -> Iterator[None]:
    """Run nodes, and end them."""
    running = []
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    parameters = {
        "velocity_controller": {"policy": policy, "start_enabled": "true", "period": str(PERIOD), "goal_tolerance": "0.0"}
    }
    try:
        for nodes in processes:
            given = [f"{node}:{name}:={value}" for node in nodes for name, value in parameters.get(node, {}).items()]
            words = ["--ros-args", *(word for each in given for word in ("-p", each))] if given else []
            running.append(subprocess.Popen([sys.executable, "-m", "turtlebot_gym_ros", *nodes, *words], env=environment))
        yield
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait()


def delays_of(processes: Sequence[Sequence[str]], *, policy: str, messages: int) -> tuple[list[float], int]:
    """Return the delays of commands, s, and the number of messages of odometry.

    Raises:
        TimeoutError: If no command comes.
    """
    with claimed_domain() as domain, started(processes, domain, policy):
        runner = Runner(domain=domain)
        driver = Driver(runner)
        runner.add(driver)
        runner.start()
        try:
            deadline = time.monotonic() + PATIENCE
            while len(driver.delays) < 20:
                if time.monotonic() > deadline:
                    raise TimeoutError("no command came.")
                driver.send()
                time.sleep(PERIOD)
            driver.delays.clear()
            begin = time.monotonic()
            for at in range(messages):
                time.sleep(max(0.0, begin + at * PERIOD - time.monotonic()))
                driver.send()
            time.sleep(PERIOD)
            return list(driver.delays), messages
        finally:
            runner.close()


def main(argv: Sequence[str] | None = None) -> None:
    """Measure both forms in turns, and print medians and 95th percentiles."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--policy", default="bearing", help="policy of the controller (default: bearing)")
    parser.add_argument("--messages", type=int, default=300, help="messages of odometry in a turn (default: 300)")
    parser.add_argument("--turns", type=int, default=3, help="turns of each form (default: 3)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args(argv)
    found: dict[str, list[float]] = {form: [] for form in FORMS}
    sent = dict.fromkeys(FORMS, 0)
    for _ in range(options.turns):
        for form, processes in FORMS.items():
            delays, number = delays_of(processes, policy=options.policy, messages=options.messages)
            found[form] += delays
            sent[form] += number
    rows = {}
    for form, delays in found.items():
        median, most = 1e3 * np.percentile(delays, [50, 95])
        rows[form] = {"median_ms": round(median, 2), "p95_ms": round(most, 2), "commands": len(delays), "odometry": sent[form]}
        print(f"{form:<24} median {median:5.2f} ms, 95 % within {most:5.2f} ms, {len(delays)} of {sent[form]} answered")
    if options.json:
        write_text(options.json, json.dumps({"policy": options.policy, "forms": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
