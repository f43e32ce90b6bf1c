"""The robot that the faults are done to, without ROS: its room, its motion, its LiDAR, and a driver that may lie.

It shares no code with the simulator of turtlebot_gym, so that an error in one is not repeated in the other. The driver moves by
the last command for ever, as a TurtleBot3, and what it says goes through a lie; `Driver.seen_at` is when that could first be
seen, by comparing it with what a robot that obeys would say.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

HALL, DEAD_END = (3.0, 1.5, 1.0), (1.3, 1.5, 1.0)
"""Walls ahead of the start, to the left and right, and behind, m; the robot reaches that of the second within seconds."""
BEAMS, FARTHEST, ROUGHNESS = 180, 3.5, 0.005
"""Number of beams of the LiDAR, its range, m, and the standard deviation of a range, m."""
ANGLES = 2.0 * math.pi / BEAMS * np.arange(BEAMS)
"""Directions of the beams in the robot's frame, rad."""
LIDAR_X, CENTER_X, RADIUS = -0.032, -0.032, 0.105
"""Positions of a Burger's LiDAR and centre ahead of its axle, and its radius, m."""
WINDOW = 0.5  # s, over which motion that is said is compared with motion that was commanded
SEEN = (0.03, 0.05, 0.05, 0.1)
"""Differences that can be seen: way, m, and turn, rad, within the window; speed, m/s; turning rate, rad/s."""
Pose = tuple[float, float, float]
"""x, y, m, and heading, rad."""


def advance(pose: Pose, v: float, omega: float, dt: float) -> Pose:
    """Move a unicycle for a time, s, along its exact arc."""
    x, y, theta = pose
    half = 0.5 * omega * dt
    chord = v * dt * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + omega * dt


def away(angles: NDArray[np.float64], center: float) -> NDArray[np.float64]:
    """Return how far directions are from another, rad."""
    return np.abs(np.remainder(angles - center + math.pi, 2.0 * math.pi) - math.pi)


class World:
    """A robot at the start of a rectangular hall, with round posts: x, y and radius of each, m."""

    def __init__(self) -> None:
        self.pose: Pose = (0.0, 0.0, 0.0)
        self.walls = HALL
        self.posts: list[tuple[float, float, float]] = []
        self._noise = np.random.default_rng()

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


class Said(NamedTuple):
    """What a message of odometry says; m, rad, m/s, rad/s; across is the speed to the left."""

    x: float
    y: float
    theta: float
    v: float
    omega: float
    across: float = 0.0
    variance: float = 0.0
    frame: str = "odom"


Lie = Callable[[list[Said]], Said]
"""Returns what is said instead of the last of what was true since the lie began, at 20 Hz."""
Wheels = Callable[[float, float], tuple[float, float]]
"""Returns the v, m/s, and omega, rad/s, with which something moves, for those of the command."""


def obeying(v: float, omega: float) -> tuple[float, float]:
    """Move as commanded."""
    return v, omega


class Driver:
    """The driver of a robot in a world, whose odometry states a pose at first."""

    def __init__(self, world: World, start: Pose = (0.0, 0.0, 0.0)) -> None:
        self.world = world
        self.turns: Wheels = obeying
        self.grips: Wheels = obeying
        """How the wheels turn, and how a robot moves whose wheels turn so."""
        self.seen_at: float | None = None
        self.unexplained = 0.0
        """Time of the first message that shows a lie, s; sum of the ways that it said besides those that were commanded, m."""
        self._measured = self._obedient = start
        self._speeds, self._said_at = (0.0, 0.0), 0.0
        self._window: deque[tuple[float, Said, Said]] = deque()
        self.tells(None)

    def tells(self, lie: Lie | None) -> None:
        """Tell a lie from now on, or the truth."""
        self._lie, self._true = lie, list[Said]()

    def move(self, v: float, omega: float, dt: float) -> None:
        """Obey a command for a time, s."""
        self._obedient, self._speeds = advance(self._obedient, v, omega, dt), (v, omega)
        turned = self.turns(v, omega)
        self._measured = advance(self._measured, *turned, dt)
        self.world.pose = advance(self.world.pose, *self.grips(*turned), dt)

    def says(self, now: float) -> Said:
        """Return what it says at a time, s."""
        self._true.append(Said(*self._measured, *self.turns(*self._speeds)))
        said = self._lie(self._true) if self._lie else self._true[-1]
        self.unexplained += abs(said.v - self._speeds[0]) * min(max(now - self._said_at, 0.0), 0.2)
        self._said_at = now
        obedient = Said(*self._obedient, *self._speeds)
        self._window.append((now, said, obedient))
        while self._window[0][0] < now - WINDOW:
            self._window.popleft()
        _, before, obeyed = self._window[0]
        (dx, dy, turn), (to_x, to_y, to_turn) = _motion(before, said), _motion(obeyed, obedient)
        differences = (
            math.hypot(dx - to_x, dy - to_y),
            abs(math.remainder(turn - to_turn, 2.0 * math.pi)),
            math.hypot(said.v - obedient.v, said.across),
            abs(said.omega - obedient.omega),
        )
        if self.seen_at is None and (said.frame != "odom" or any(np.greater(differences, SEEN))):
            self.seen_at = now
        return said


def _motion(before: Said, after: Said) -> Pose:
    """Return the motion between two messages in the frame of the first."""
    dx, dy = after.x - before.x, after.y - before.y
    cosine, sine = math.cos(before.theta), math.sin(before.theta)
    return cosine * dx + sine * dy, cosine * dy - sine * dx, after.theta - before.theta
