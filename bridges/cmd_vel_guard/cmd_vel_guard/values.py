"""What a robot is told, where it and its sensors are, and what it can do. Does not depend on ROS."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from turtlebot_gym.values import STOP, Command, Pose

if TYPE_CHECKING:
    from cmd_vel_guard.parameters import Parameters

__all__ = ["STOP", "Command", "Mount", "Pose", "limit"]

ROUNDING = 1e-12
"""Excess over a limit that is left as it is."""


class Mount(NamedTuple):
    """A sensor's frame, empty if it is not known, and its pose in the robot's frame, m and rad."""

    frame: str
    x: float
    y: float
    yaw: float


def limit(command: Command, robot: Parameters) -> Command:
    """Scale a command into a robot's limits on its path; one that must not reverse only turns when commanded backwards."""
    forward = command.v if robot.reverse else max(command.v, 0.0)
    v, omega = abs(forward), abs(command.omega)
    wheel = v + omega * robot.wheel_separation * 0.5
    excess = max(v / robot.max_linear, omega / robot.max_angular, wheel / (robot.max_wheel or math.inf))
    excess = excess if excess > 1.0 + ROUNDING else 1.0
    return Command(forward / excess + 0.0, command.omega / excess + 0.0)  # adding 0 makes no zero negative
