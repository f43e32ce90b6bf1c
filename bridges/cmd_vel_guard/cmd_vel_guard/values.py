"""What a robot is told, where it is, and what it can do. Does not depend on ROS."""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.values import STOP, Command, Pose

__all__ = ["STOP", "Command", "Mount", "Pose", "Robot", "limit", "yaw_of_rotation"]

ROUNDING = 1e-12
"""Excess over a limit that is left as it is."""


class Mount(NamedTuple):
    """A sensor's frame, and its pose in the robot's frame."""

    frame: str
    """Name of the frame; empty if the mount is not known."""
    x: float
    """m"""
    y: float
    """m"""
    yaw: float
    """Direction of its x axis, rad."""


class Robot(NamedTuple):
    """A differential-drive robot's limits, footprint and LiDAR."""

    max_linear: float
    """Highest speed, m/s."""
    max_angular: float
    """Highest turning rate, rad/s."""
    wheel_separation: float
    """Distance between the wheels' tracks, m."""
    max_wheel: float
    """Highest rim speed of a wheel, m/s; infinite if none is known."""
    reverse: bool
    """Whether the robot may drive backwards."""
    radius: float
    """Radius of the footprint, m; 0 if not known."""
    footprint_x: float
    """Centre of the footprint ahead of the axle, m."""
    lidar: Mount
    """Mount of the LiDAR."""


def limit(command: Command, robot: Robot) -> Command:
    """Scale a command into a robot's limits per axis and per wheel, without changing the curvature of its path.

    A robot that must not reverse only turns when it is commanded backwards.
    """
    forward = command.v if robot.reverse else max(command.v, 0.0)
    v, omega = abs(forward), abs(command.omega)
    wheel = v + omega * robot.wheel_separation * 0.5
    excess = max(v / robot.max_linear, omega / robot.max_angular, wheel / robot.max_wheel)
    excess = excess if excess > 1.0 + ROUNDING else 1.0
    return Command(forward / excess + 0.0, command.omega / excess + 0.0)  # adding 0 makes no zero negative


def yaw_of_rotation(w: float, x: float, y: float, z: float) -> float:
    """Return the heading of a rotation given as a quaternion, rad; about the vertical axis of any norm."""
    if x == y == 0.0:
        return 2.0 * (math.atan2(z, w) if w >= 0.0 else math.atan2(-z, -w))  # q and -q are the same rotation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
