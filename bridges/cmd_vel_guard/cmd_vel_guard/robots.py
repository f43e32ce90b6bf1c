"""Robots by name. Does not depend on ROS."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_BURGER = {"radius": 0.105, "footprint_x": -0.024, "scan_frame": "base_scan", "scan_x": -0.032, "scan_y": 0.0, "scan_yaw": 0.0}
_WAFFLE = {"radius": 0.22, "footprint_x": -0.064, "scan_frame": "base_scan", "scan_x": -0.064, "scan_y": 0.0, "scan_yaw": 0.0}
_CREATE = {
    "radius": 0.171,
    "footprint_x": 0.0,
    "scan_frame": "rplidar_link",
    "scan_x": -0.04,
    "scan_y": 0.0,
    "scan_yaw": 0.5 * math.pi,
}
ROBOTS: dict[str, Mapping[str, Any]] = {
    "burger": {"max_linear": 0.2108, "max_angular": 2.635, "max_wheel": 0.2097, "wheel_separation": 0.160, **_BURGER},
    "waffle": {"max_linear": 0.26, "max_angular": 1.82, "max_wheel": 0.26, "wheel_separation": 0.287, **_WAFFLE},
    "turtlebot4": {"max_linear": 0.306, "max_angular": 1.9, "max_wheel": 0.306, "wheel_separation": 0.233, **_CREATE},
}
"""The numbers of each robot, by the names of the guard's parameters: those of ``turtlebot_gym.robots.ROBOTS``, whose sources
stand there."""


def numbers_of(name: str) -> Mapping[str, Any]:
    """Return the numbers of a robot.

    Raises:
        ValueError: If the robot is unknown.
    """
    if name not in ROBOTS:
        raise ValueError(
            f"robot must be one of {', '.join(ROBOTS)}, got {name!r}: leave robot empty, and set max_linear, max_angular, "
            f"wheel_separation and radius."
        )
    return ROBOTS[name]
