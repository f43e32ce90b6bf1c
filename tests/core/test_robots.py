"""The robots' numbers, from their data sheets, and what a robot may be."""

from __future__ import annotations

import math
from dataclasses import asdict

from turtlebot_gym.robots import ROBOTS, Robot

INF = math.inf
FIELDS = (
    "max_linear", "max_angular", "wheel_separation", "max_wheel", "max_linear_acceleration", "max_angular_acceleration",
    "reverse", "radius",
)  # fmt: skip
NUMBERS = {
    "burger": (0.2108, 2.635, 0.16, 0.2097, INF, INF, True, 0.105),
    "waffle": (0.26, 1.82, 0.287, 0.26, INF, INF, True, 0.22),
    "turtlebot4": (0.306, 1.9, 0.233, 0.306, INF, INF, True, 0.171),
    "tutorial": (0.22, 2.84, 0.16, INF, INF, INF, True, 0.105),
}


def test_the_robots_have_their_numbers():
    assert {name: asdict(robot) for name, robot in ROBOTS.items()} == {
        name: dict(zip(FIELDS, row, strict=True)) for name, row in NUMBERS.items()
    }


def test_a_robot_of_two_limits_has_no_other():
    assert asdict(Robot(max_linear=0.5, max_angular=2)) == dict(
        zip(FIELDS, (0.5, 2, 0.16, INF, INF, INF, True, 0.09), strict=True)
    )
