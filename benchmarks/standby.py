"""Kill the guard while it drives, and measure how long the robot keeps its speed until the standby's zero.

Guard and standby are processes on real DDS, beside busy ones. An independent listener on ``/cmd_vel`` takes DDS's source times:
from the last motion before the signal to the first zero, and how far a robot at full speed drives until that zero arrives. Each
zero while the guard drives is a false alarm. A killed guard is started again each time, while commands go on; then its first
message must be a zero. A suspended one is continued.
"""

from __future__ import annotations

import os
import random
import signal
import statistics
import tempfile
import time
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

from harness.machine import busy
from harness.study import Study, run
from ros_nodes import Nodes
from turtlebot_gym.presets import make_robot

SPEED = make_robot("burger").max_wheel


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Kill or suspend the guard while it drives."""

    times: int = 50
    """Number of times."""
    suspend: bool = False
    """Suspend the guard for 1 s instead of killing it."""
    busy: int = 2
    """Number of busy processes that run beside it."""
    seed: int = 0
    """Seed of the moments."""
    domain: int = 140
    """ROS domain."""


class Wheels:
    """The listener on ``/cmd_vel``, and the source of commands."""

    def __init__(self, domain: int) -> None:
        import rclpy.node
        from geometry_msgs.msg import TwistStamped
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.context, self.heard, self.over = Context(), [], False
        self.context.init([], domain_id=domain)
        self.node = rclpy.node.Node("wheels", context=self.context)
        hear: Any = lambda message, info: self.heard.append(  # noqa: E731
            (info["source_timestamp"] * 1e-9, time.time(), message.twist.linear.x)
        )
        self.node.create_subscription(TwistStamped, "cmd_vel", hear, 1000)
        program = self.node.create_publisher(TwistStamped, "cmd_vel_in", 1)
        command = TwistStamped()
        command.twist.linear.x = SPEED
        self.node.create_timer(0.1, lambda: program.publish(command))
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)

        def spin() -> None:
            while not self.over:
                executor.spin_once(timeout_sec=0.05)

        self.thread = Thread(target=spin, daemon=True)
        self.thread.start()

    def drives(self, since: int) -> int:
        """Wait until the robot is at full speed, and return the place of that message among those heard."""
        until = time.monotonic() + 60.0
        while time.monotonic() < until:
            time.sleep(0.02)
            place = next((k for k in range(since, len(self.heard)) if abs(self.heard[k][2] - SPEED) < 1e-3), None)
            if place is not None:
                return place
        raise RuntimeError("the robot does not drive")

    def close(self) -> None:
        """Listen no more."""
        self.over = True
        self.thread.join()


def killed(config: Config) -> dict[str, Any]:
    """Kill or suspend the guard so many times, and return the times."""
    from turtlebot_gym_ros.base.discovery import prepare

    prepare(local=False)  # as on a robot
    rng, where = random.Random(config.seed), {"ROS_DOMAIN_ID": str(config.domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    gaps, distances, false_alarms, late_zeros, driven = [], [], 0, 0, 0.0
    with ExitStack() as stack:
        folder, wheels = stack.enter_context(tempfile.TemporaryDirectory()), stack.enter_context(closing(Wheels(config.domain)))
        nodes = stack.enter_context(closing(Nodes(Path(folder), {}, "--log-level", "fatal", **where)))
        nodes.start("cmd_vel_guard", require_standby="true")
        nodes.start("cmd_vel_standby")
        for _ in range(config.times):
            place = wheels.drives(len(wheels.heard))
            duration = rng.uniform(0.8, 1.2)
            time.sleep(duration)
            driven += duration
            false_alarms += sum(v == 0.0 for _, _, v in wheels.heard[place:])
            nodes.signal("cmd_vel_guard", signal.SIGSTOP if config.suspend else signal.SIGKILL)
            before = len(wheels.heard)
            time.sleep(1.0)
            heard = wheels.heard[place:]
            zero = next((k for k, (_, _, v) in enumerate(heard) if v == 0.0 and k + place >= before - 1), None)
            sent, came = (heard[zero][0], heard[zero][1]) if zero is not None else (time.time(), time.time())
            last = max(at for at, _, v in heard if v != 0.0 and at < sent)
            gaps.append(sent - last)
            distances.append((came - last) * SPEED)
            mark = len(wheels.heard)
            if config.suspend:
                nodes.signal("cmd_vel_guard", signal.SIGCONT)
            else:
                time.sleep(0.6)  # the rest of the standby's zeros
                mark = len(wheels.heard)
                nodes.start("cmd_vel_guard")
            wheels.drives(mark)
            late_zeros += wheels.heard[mark][2] != 0.0
    return {
        "times": len(gaps),
        "within_0.3_s": sum(gap <= 0.3 for gap in gaps),
        "median_s": round(statistics.median(gaps), 3),
        "longest_s": round(max(gaps), 3),
        "median_m": round(statistics.median(distances), 3),
        "longest_m": round(max(distances), 3),
        "first_message_not_zero": late_zeros,
        "false_alarms": false_alarms,
        "driven_s": round(driven, 1),
    }


def measure(config: Config) -> tuple[dict[str, Any], list[Any]]:
    """Return the figures, and print them."""
    with busy(config.busy):
        results = killed(config)
    for name, value in results.items():
        print(f"{name:24} {value}")
    return {**results, "load": os.getloadavg()}, []


if __name__ == "__main__":
    _, results = run(Config, measure)
    raise SystemExit(results["within_0.3_s"] < results["times"] or results["first_message_not_zero"] > 0)
