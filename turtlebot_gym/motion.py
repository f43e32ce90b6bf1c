"""How a robot has moved by its commands, on exact arcs. Does not depend on ROS and takes steady times as arguments."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.values import STOP, Command

MEMORY = 3.0
"""Time for which commands to the wheels are stored, s: longer than the age of any valid scan."""


class Motion(NamedTuple):
    """Motion since the start."""

    pose: tuple[float, float, float]
    """m, m, rad."""
    way: float
    """Path driven either way, m."""
    turned: float
    """Sum of all turns, rad."""


class Track:
    """The commands of the wheels, and the motion to which they have led.

    Args:
        now: Current steady time, s.
    """

    def __init__(self, now: float) -> None:
        self._times, self._motions, self._commands = [now], [Motion((0.0, 0.0, 0.0), 0.0, 0.0)], [STOP]

    @property
    def command(self) -> Command:
        """The command in force."""
        return self._commands[-1]

    def add(self, command: Command, now: float) -> None:
        """Record the command of the wheels from now on."""
        motion = self.at(now)
        old = bisect_right(self._times, now - MEMORY) - 1
        if old > 0:
            del self._times[:old], self._motions[:old], self._commands[:old]
        self._times.append(now)
        self._motions.append(motion)
        self._commands.append(command)

    def at(self, time: float) -> Motion:
        """Return the motion up to a time."""
        k = max(bisect_right(self._times, time) - 1, 0)
        motion, command, dt = self._motions[k], self._commands[k], max(time - self._times[k], 0.0)
        way, turned = motion.way + abs(command.v) * dt, motion.turned + abs(command.omega) * dt
        return Motion(moved(motion.pose, command, dt), way, turned)


def moved(pose: tuple[float, float, float], command: Command, dt: float) -> tuple[float, float, float]:
    """Return the pose after a command was in force for a time, exactly, also on arcs."""
    x, y, theta = pose
    half = 0.5 * command.omega * dt
    chord = command.v * dt * (math.sin(half) / half if half != 0.0 else 1.0)
    return x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + 2.0 * half


def into(pose: tuple[float, float, float], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform points, shape (3, n), from the world into the frame of a pose."""
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    dx, dy = points[0] - x, points[1] - y
    return np.stack((cosine * dx + sine * dy, cosine * dy - sine * dx, points[2]))


def out_of(pose: tuple[float, float, float], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform points, shape (3, n), from the frame of a pose into the world."""
    x, y, theta = pose
    cosine, sine = math.cos(theta), math.sin(theta)
    return np.stack((x + cosine * points[0] - sine * points[1], y + sine * points[0] + cosine * points[1], points[2]))
