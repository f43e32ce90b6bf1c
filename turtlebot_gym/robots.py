"""Robots: kinematic limits of differential-drive robots, as their firmware accepts them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from turtlebot_gym.validation import LEAST, POSITIVE, POSITIVE_OR_INFINITE, Range, typed

SPEED = Range(LEAST, 100.0, kind="positive number")
"""Speeds, m/s, and turning rates, rad/s: more is a mistake of units, and the covariances of a filter would overflow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """Kinematic limits of a differential-drive robot."""

    max_linear: Annotated[float, SPEED]
    """Speed limit along the body x axis, forwards and backwards, m/s."""
    max_angular: Annotated[float, SPEED]
    """Speed limit about the body z axis, rad/s."""
    wheel_separation: Annotated[float, POSITIVE] = 0.16
    """Distance between the wheels' tracks, m."""
    max_wheel: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Limit of each wheel's rim speed, ``|v| + |omega| wheel_separation / 2``, m/s; infinite if none is known."""
    max_linear_acceleration: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Limit of the acceleration, m/s^2; infinite if the base follows at once."""
    max_angular_acceleration: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Limit of the angular acceleration, rad/s^2."""
    reverse: bool = True
    """Whether the robot may drive backwards."""
    radius: Annotated[float, POSITIVE] = 0.09
    """Radius of the footprint, m."""

    def __post_init__(self) -> None:
        typed(self)


ROBOTS = {
    # The firmware clamps at 0.2108 m/s and 2.635 rad/s, below the data sheet's 0.22 and 2.84; a real one ignored a command of
    # 0.22 (ROBOTIS-GIT/turtlebot3 #765). XL430 wheels: 0.2097 m/s at the rim.
    "burger": Robot(max_linear=0.2108, max_angular=2.635, wheel_separation=0.160, max_wheel=0.2097, radius=0.105),
    # TurtleBot3 Waffle: the data sheet's limits, 0.26 m/s and 1.82 rad/s; track 0.287 m.
    "waffle": Robot(max_linear=0.26, max_angular=1.82, wheel_separation=0.287, max_wheel=0.26, radius=0.22),
    # iRobot Create 3 with its safety override off: 0.306 m/s at the wheels, 1.9 rad/s, track 0.233 m.
    "turtlebot4": Robot(max_linear=0.306, max_angular=1.9, wheel_separation=0.233, max_wheel=0.306, radius=0.171),
    # The reference system's robot: a Burger by its data sheet, with no limit per wheel.
    "tutorial": Robot(max_linear=0.22, max_angular=2.84, wheel_separation=0.160, radius=0.105),
}
"""Robot presets by name."""
