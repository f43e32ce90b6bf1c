"""How a robot has moved by its commands, on exact arcs. Does not depend on ROS and takes steady times as arguments."""

from __future__ import annotations

import math
from bisect import bisect_right
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.values import STOP, Command

MEMORY = 3.0  # time for which commands to the wheels are stored, s: longer than the age of any valid scan


class Motion(NamedTuple):
    """Motion since the start: the pose, m and rad, the path driven either way, m, and the sum of all turns, rad."""

    pose: tuple[float, float, float]
    way: float
    turned: float


class Track:
    """The commands of the wheels, and the motion to which they have led, from the steady time ``now`` on, s."""

    def __init__(self, now: float) -> None:
        self._log = [(now, Motion((0.0, 0.0, 0.0), 0.0, 0.0), STOP)]

    @property
    def command(self) -> Command:
        """The command in force."""
        return self._log[-1][2]

    def add(self, command: Command, now: float) -> None:
        """Record the command of the wheels from now on."""
        self._log = [*self._log[self._index(now - MEMORY) :], (now, self.at(now), command)]

    def at(self, time: float) -> Motion:
        """Return the motion up to a time."""
        since, motion, command = self._log[self._index(time)]
        dt = max(time - since, 0.0)
        way, turned = motion.way + abs(command.v) * dt, motion.turned + abs(command.omega) * dt
        return Motion(moved(motion.pose, command, dt), way, turned)

    def _index(self, time: float) -> int:
        return max(bisect_right(self._log, time, key=itemgetter(0)) - 1, 0)


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
