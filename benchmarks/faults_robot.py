"""A guard's process, its publishers, and the judging listener, on rclpy only and independent of the guard's code.

It records when each command was sent, and by DDS's source time, on the same clock, when the guard published each of its own.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from bisect import bisect_right
from itertools import pairwise
from typing import Any


class Robot:
    """A guard's process, its publishers, and the listener.

    Args:
        domain: Its ROS domain.
        buttons: Whether it has emergency stops. A suspended guard that has heard one also stops because of its silence.
    """

    def __init__(self, domain: int, *, buttons: bool) -> None:
        import rclpy.node
        from geometry_msgs.msg import TwistStamped
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from std_msgs.msg import Bool
        from std_srvs.srv import SetBool

        self.context = Context()
        self.context.init([], domain_id=domain)
        self.node = rclpy.node.Node("faults", context=self.context)
        every = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.heard: list[tuple[float, float, float]] = []
        self.sent: list[float] = []
        self.kinds = TwistStamped, Bool, SetBool
        hear: Any = self._hear
        self.node.create_subscription(TwistStamped, "cmd_vel", hear, every)
        latest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.sources = {name: self.node.create_publisher(TwistStamped, f"cmd_vel_{name}", latest) for name in ("in", "teleop")}
        self.buttons = [self.node.create_publisher(Bool, "emergency_stop", latest) for _ in range(2)]
        self.client = self.node.create_client(SetBool, "cmd_vel_guard/enable")
        self.commands: dict[str, tuple[float, float]] = {}
        self.has_buttons = buttons
        self.pressed: list[bool | None] = [None, None]
        self.lock, self.over = threading.Lock(), threading.Event()
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)

        def spin() -> None:
            while not self.over.is_set():
                executor.spin_once(timeout_sec=0.05)

        self.threads = [threading.Thread(target=target, daemon=True) for target in (spin, self._speak)]
        for thread in self.threads:
            thread.start()
        words = [sys.executable, "-m", "turtlebot_gym_ros", "cmd_vel_guard", "--ros-args", "--log-level", "fatal"]
        self.guard = subprocess.Popen(words, env={**os.environ, "ROS_DOMAIN_ID": str(domain)})

    def _hear(self, message: Any, info: Any) -> None:
        self.heard.append((info["source_timestamp"] * 1e-9, message.twist.linear.x, message.twist.angular.z))

    def _speak(self) -> None:
        """Send commands at 20 Hz and the buttons' states at 10 Hz."""
        turn = 0
        while not self.over.wait(0.05):
            turn += 1
            with self.lock:
                for name, command in self.commands.items():
                    self.command(name, *command)
                for which, pressed in enumerate(self.pressed):
                    if pressed is not None and turn % 2:
                        self.say(which, pressed)

    def command(self, name: str, v: float, omega: float, age: float = 0.0) -> None:
        """Send one command with a stamp of a given age, s."""
        message, now = self.kinds[0](), time.time()
        message.header.stamp.sec, message.header.stamp.nanosec = int(now - age), int((now - age) % 1.0 * 1e9)
        message.twist.linear.x, message.twist.angular.z = v, omega
        if age < 0.4 and (v, omega) != (0.0, 0.0) and math.isfinite(v + omega):
            self.sent.append(now)
        self.sources[name].publish(message)

    def say(self, which: int, pressed: bool) -> None:
        """Publish once whether a button is pressed."""
        self.buttons[which].publish(self.kinds[1](data=pressed))

    def set(self, **commands: tuple[float, float]) -> None:
        """Set the commands to send from now on."""
        with self.lock:
            self.commands = commands

    def enable(self, on: bool, patience: float = 5.0) -> bool:
        """Call the guard's service, and return whether it agreed."""
        future, until = self.client.call_async(self.kinds[2].Request(data=on)), time.monotonic() + patience
        while not future.done() and time.monotonic() < until:
            time.sleep(0.002)
        return bool(future.done() and future.result().success)

    def drive(self, patience: float = 120.0) -> None:
        """Make the robot drive, from any state."""
        until = time.monotonic() + patience
        with self.lock:
            self.pressed = [False, False] if self.has_buttons else [None, None]
        while time.monotonic() < until:
            self.set(**{"in": (0.1, 0.2)})
            since = time.time()
            for _ in range(40):
                time.sleep(0.02)
                if any(v > 0.09 for at, v, _ in self.heard[-5:] if at > since):
                    time.sleep(0.1)
                    return
            self.enable(True, 1.0)
        raise RuntimeError("the robot does not drive")

    def motions(self, since: float) -> list[float]:
        """Return the times at which motions were published."""
        return [at for at, v, omega in list(self.heard) if at > since and (v, omega) != (0.0, 0.0)]

    def lag(self, since: float) -> float:
        """Return the longest time between the newest command and a motion."""
        sent = list(self.sent)
        return max((at - sent[bisect_right(sent, at) - 1] for at in self.motions(since)), default=0.0)

    def hold(self, since: float) -> float:
        """Return the longest time from the newest command to the zero that ends its motion."""
        sent, heard = list(self.sent), [message for message in list(self.heard) if message[0] > since]
        ends = [at for (_, *before), (at, *now) in pairwise(heard) if before != [0.0, 0.0] == now]
        return max((at - sent[bisect_right(sent, at) - 1] for at in ends), default=0.0)

    def close(self) -> None:
        """Shut everything down."""
        self.over.set()
        for thread in self.threads:
            thread.join()
        self.guard.send_signal(signal.SIGCONT)
        self.guard.kill()
        self.guard.wait()
        self.node.destroy_node()
        self.context.shutdown()
