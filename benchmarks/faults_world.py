"""The room in which the faults' robot drives, and what its LiDAR measures; without ROS."""

from __future__ import annotations

import math
import random

HALL = (3.0, 1.5, 1.0)
"""Walls ahead of the start, to the left and right, and behind, m."""
DEAD_END = (1.3, 1.5, 1.0)
"""The same with a wall ahead that the robot reaches within seconds."""
BEAMS, FARTHEST = 180, 3.5
"""Number of beams of the LiDAR, and its range, m."""
LIDAR_X = -0.032
"""Position of a Burger's LiDAR ahead of its axle, m."""
RADIUS, CENTER_X = 0.105, -0.032
"""Radius of its footprint, and its centre ahead of the axle, m."""


class World:
    """A robot at the start of a hall."""

    def __init__(self) -> None:
        self.pose = (0.0, 0.0, 0.0)
        """x, y, m, and heading, rad."""
        self.walls = HALL

    def move(self, v: float, omega: float, dt: float) -> float | None:
        """Move for a time, s, and return the gap to the wall ahead, m, if the robot moves towards it."""
        x, y, theta = self.pose
        middle = theta + 0.5 * omega * dt
        self.pose = x + v * dt * math.cos(middle), y + v * dt * math.sin(middle), theta + omega * dt
        gap = self.walls[0] - (x + CENTER_X * math.cos(theta)) - RADIUS
        return gap if v > 0.0 and math.cos(theta) > 0.5 else None

    def ranges(self) -> list[float]:
        """Return what the LiDAR measures, with noise, m; infinite beyond its range."""
        x, y, theta = self.pose
        x, y = x + LIDAR_X * math.cos(theta), y + LIDAR_X * math.sin(theta)
        step = 2.0 * math.pi / BEAMS
        ranges = [_ray(x, y, theta + k * step, self.walls) + random.gauss(0.0, 0.005) for k in range(BEAMS)]
        return [distance if distance <= FARTHEST else math.inf for distance in ranges]


def _ray(x: float, y: float, angle: float, walls: tuple[float, float, float]) -> float:
    """Return the distance from a point to the walls of a rectangular room, m."""
    dx, dy = math.cos(angle), math.sin(angle)
    ahead, aside, behind = walls
    to_x = ((ahead if dx > 0.0 else -behind) - x) / dx if dx else math.inf
    to_y = (math.copysign(aside, dy) - y) / dy if dy else math.inf
    return min(to_x, to_y)
