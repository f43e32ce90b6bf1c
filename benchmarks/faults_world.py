"""The room in which the faults' robot drives, how it moves, and what its LiDAR measures; without ROS.

It shares no code with the simulator of turtlebot_gym: a unicycle and a caster of rays of their own, so that an error in one is
not repeated in the other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

HALL = (3.0, 1.5, 1.0)
"""Walls ahead of the start, to the left and right, and behind, m."""
DEAD_END = (1.3, 1.5, 1.0)
"""The same with a wall ahead that the robot reaches within seconds."""
OPEN = (3.2, 3.2, 3.2)
"""Walls so far away that a robot which leaves a fence of 2 m has not met one."""
BEAMS, FARTHEST = 180, 3.5
"""Number of beams of the LiDAR, and its range, m."""
ANGLES = 2.0 * math.pi / BEAMS * np.arange(BEAMS)
"""Directions of the beams in the robot's frame, rad."""
ROUGHNESS = 0.005
"""Standard deviation of a range, m."""
LIDAR_X = -0.032
"""Position of a Burger's LiDAR ahead of its axle, m."""
RADIUS, CENTER_X = 0.105, -0.032
"""Radius of its footprint, and its centre ahead of the axle, m."""


def advance(pose: tuple[float, float, float], v: float, omega: float, dt: float) -> tuple[float, float, float]:
    """Move a unicycle for a time, s, along its exact arc."""
    x, y, theta = pose
    half = 0.5 * omega * dt
    chord = v * dt * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + omega * dt


class World:
    """A robot at the start of a rectangular hall, with round posts."""

    def __init__(self) -> None:
        self.pose = (0.0, 0.0, 0.0)
        """x, y, m, and heading, rad."""
        self.walls = HALL
        self.posts: list[tuple[float, float, float]] = []
        """x, y and radius of each post, m."""
        self._noise = np.random.default_rng()

    def move(self, v: float, omega: float, dt: float) -> None:
        """Move for a time, s."""
        self.pose = advance(self.pose, v, omega, dt)

    def clearance(self) -> float:
        """Return the distance between the footprint and the nearest wall or post, m; negative in contact."""
        x, y, theta = self.pose
        x, y = x + CENTER_X * math.cos(theta), y + CENTER_X * math.sin(theta)
        ahead, aside, behind = self.walls
        to_posts = [math.hypot(x - px, y - py) - radius for px, py, radius in self.posts]
        return min(ahead - x, x + behind, aside - abs(y), *to_posts) - RADIUS

    def ranges(self) -> NDArray[np.float64]:
        """Return what the LiDAR measures, with noise, m; infinite beyond its range."""
        x, y, theta = self.pose
        x, y = x + LIDAR_X * math.cos(theta), y + LIDAR_X * math.sin(theta)
        dx, dy = np.cos(theta + ANGLES), np.sin(theta + ANGLES)
        ahead, aside, behind = self.walls
        with np.errstate(divide="ignore"):
            to_x = np.where(dx == 0.0, np.inf, (np.where(dx > 0.0, ahead, -behind) - x) / dx)
            to_y = np.where(dy == 0.0, np.inf, (np.copysign(aside, dy) - y) / dy)
        ranges = np.minimum(to_x, to_y)
        for px, py, radius in self.posts:
            along, across = (px - x) * dx + (py - y) * dy, (px - x) * dy - (py - y) * dx
            hit = (np.abs(across) < radius) & (along > 0.0)
            ranges = np.minimum(ranges, np.where(hit, along - np.sqrt(np.maximum(radius**2 - across**2, 0.0)), np.inf))
        ranges += self._noise.normal(0.0, ROUGHNESS, BEAMS)
        return np.where(ranges <= FARTHEST, ranges, np.inf)
