"""Robots: kinematic limits of differential-drive robots, as their firmware accepts them, and where their LiDAR is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

from turtlebot_gym.config import LEAST, POSITIVE, POSITIVE_OR_INFINITE, Range, check_fields, refusal

PLACE = Range(-1.0, 1.0, unit="m")
"""Places on a robot."""
SPEED = Range(LEAST, 100.0)
"""Speeds, m/s, and turning rates, rad/s: more is a mistake of units, and the covariances of a filter would overflow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarMount:
    """Frame of a robot's LiDAR, and its pose in the robot's frame."""

    frame: str = ""
    """Name of the frame, without the prefix of the robot's frames; empty if the mount is not known."""
    x: Annotated[float, PLACE] = 0.0
    """Ahead of the axle, m."""
    y: Annotated[float, PLACE] = 0.0
    """To the left, m."""
    yaw: Annotated[float, Range(-2.0 * math.pi, 2.0 * math.pi, unit="rad")] = 0.0
    """Direction of the scan's angle 0, rad."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not isinstance(self.frame, str):
            raise refusal("LidarMount.frame", "a name", self.frame)


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """Kinematic limits of a differential-drive robot, its footprint, and the mount of its LiDAR."""

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
    footprint_x: Annotated[float, PLACE] = field(default=0.0, metadata={"number": False})
    """Centre of the footprint ahead of the axle, m, for the collision monitor; in simulation it is the axle."""
    lidar: LidarMount = field(default=LidarMount(), metadata={"number": False})
    """Mount of the LiDAR, for the collision monitor, where ``/tf_static`` does not state it."""

    __post_init__ = check_fields


# URDF of each robot. Burger: a body of 0.14 x 0.14 m around x = -0.032 m, and wheels that reach to x = 0.033 m; a radius of
# 0.105 m around -0.024 m encloses both. Waffle: 0.266 x 0.266 m around x = -0.064 m. Create 3: a round body around the axle;
# an RPLIDAR A1 as on the Standard model, whose scans begin at the left.
_BURGER = {"radius": 0.105, "footprint_x": -0.024, "lidar": LidarMount(frame="base_scan", x=-0.032)}
_WAFFLE = {"radius": 0.22, "footprint_x": -0.064, "lidar": LidarMount(frame="base_scan", x=-0.064)}
_CREATE = {"radius": 0.171, "lidar": LidarMount(frame="rplidar_link", x=-0.04, yaw=0.5 * math.pi)}

ROBOTS = {
    # The firmware clamps at 0.2108 m/s and 2.635 rad/s, below the data sheet's 0.22 and 2.84; a real one ignored a command of
    # 0.22 (ROBOTIS-GIT/turtlebot3 #765). XL430 wheels: 0.2097 m/s at the rim.
    "burger": Robot(max_linear=0.2108, max_angular=2.635, wheel_separation=0.160, max_wheel=0.2097, **_BURGER),
    # TurtleBot3 Waffle: the data sheet's limits, 0.26 m/s and 1.82 rad/s; track 0.287 m.
    "waffle": Robot(max_linear=0.26, max_angular=1.82, wheel_separation=0.287, max_wheel=0.26, **_WAFFLE),
    # iRobot Create 3 with its safety override off: 0.306 m/s at the wheels, 1.9 rad/s, track 0.233 m.
    "turtlebot4": Robot(max_linear=0.306, max_angular=1.9, wheel_separation=0.233, max_wheel=0.306, **_CREATE),
    # The reference system's robot: a Burger by its data sheet, with no limit per wheel.
    "tutorial": Robot(max_linear=0.22, max_angular=2.84, wheel_separation=0.160, **_BURGER),
}
"""Robot presets by name."""
