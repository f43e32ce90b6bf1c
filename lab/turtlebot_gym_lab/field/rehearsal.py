"""A simulated robot, and a person who measures it: a field test without a robot."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import Bool

from turtlebot_gym_lab.field.shared import QUIET, turned
from turtlebot_gym_ros.base.process import Runner, run
from turtlebot_gym_ros.base.qos import EVERY, STREAM
from turtlebot_gym_ros.node.geometry import read_pose

PRESS = 1.0
"""Length of a press of the emergency stop, s."""
_POST = (
    "<model name='post{0}'><static>1</static><link name='l'><collision name='c'><pose>{1} {2} 0 0 0 0</pose><geometry>"
    "<cylinder><radius>0.2</radius><length>1</length></cylinder></geometry></collision></link></model>"
)
_PLACES = ((-2.0, -2.0), (3.0, -2.0), (3.0, 3.0), (-2.0, 3.0))
HALL = f"<sdf version='1.6'><world name='hall'>{''.join(_POST.format(n, *at) for n, at in enumerate(_PLACES))}</world></sdf>"
"""A hall with four posts, whose middle is free."""


def guards(robot: str, *, stamped: bool) -> list[tuple[str, dict[str, Any]]]:
    """Return guard and standby as on a robot, see ``config/robot.yaml``; a robot without a LiDAR drives the program, too."""
    types = {"enable_stamped_cmd_vel": stamped}
    required = {"require_emergency_stop": True, "require_standby": True, "start_enabled": False, "collision_monitor": False}
    return [("cmd_vel_guard", {"robot": robot, **required, **types}), ("cmd_vel_standby", types)]


def simulated(robot: str, folder: Path, **parameters: Any) -> list[tuple[str, dict[str, Any]]]:
    """Return the simulated robot, in a hall."""
    world = folder / "hall.sdf"
    world.write_text(HALL)
    values = {"robot": robot, "noise": "wheel", "world": str(world), **parameters}
    return [("turtlebot_simulator", values)]


class Rehearsed:
    """A person who agrees to everything, presses the emergency stop when asked, and measures without error.

    Args:
        runner: The runner of what the person sees.
        hold: Called with whether the button is pressed.
    """

    def __init__(self, runner: Runner, hold: Callable[[bool], None]) -> None:
        self.node = Node("field_person", context=runner.context)
        self._hold = hold
        self._truth: list[Any] = []
        self._mark = 0
        self.node.create_subscription(Odometry, "true_state", self._truth.append, STREAM)
        runner.add(self)

    def confirm(self, key: str, text: str) -> bool:
        """Agree, and mark the robot's place or press the emergency stop."""
        print(f"{text}.")
        if key == "press":
            self._hold(True)
            threading.Timer(PRESS, self._hold, [False]).start()
        self._mark = len(self._truth)
        return True

    def number(self, key: str, text: str) -> float | None:
        """Return the true motion since the mark."""
        print(f"{text}: as it moved.")
        poses = [read_pose(message.pose.pose) for message in self._truth[max(self._mark - 1, 0) :]]
        if not poses:
            return None
        if key == "a_turn":
            return math.degrees(turned(poses))
        return math.dist(poses[0][:2], poses[-1][:2])


class _RehearsedButton(Node):
    """An emergency stop whose state comes line by line from the standard input: 1 for pressed."""

    def __init__(self, context: Context) -> None:
        super().__init__("field_button", context=context)
        self._pressed = False
        self._publisher = self.create_publisher(Bool, "emergency_stop", EVERY)
        self.create_timer(0.05, self._speak, clock=Clock(clock_type=ClockType.STEADY_TIME))
        threading.Thread(target=self._listen, daemon=True).start()

    def _speak(self) -> None:
        self._publisher.publish(Bool(data=self._pressed))

    def _listen(self) -> None:
        for line in sys.stdin:
            self._pressed = line.strip() == "1"


@contextmanager
def button() -> Iterator[Callable[[bool], None]]:
    """Run an emergency stop in a process of its own, which nothing else holds up, and yield what presses it."""
    process = subprocess.Popen([sys.executable, "-m", __name__], stdin=subprocess.PIPE, text=True)
    assert process.stdin

    def hold(pressed: bool) -> None:
        print(int(pressed), file=process.stdin, flush=True)

    try:
        yield hold
    finally:
        process.stdin.close()
        process.terminate()
        process.wait()


if __name__ == "__main__":
    raise SystemExit(run([_RehearsedButton], ["--ros-args", *QUIET]))
