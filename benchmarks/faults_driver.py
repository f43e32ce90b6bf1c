"""A stand-in for a robot's driver: it drives by the last command for ever, as a TurtleBot3, and says how; without ROS.

It lives, and may lie: what it says goes through a lie of `faults_lies`, with fresh stamps. `Seen` tells when a lie could first
be seen, by comparing what is said with what a robot that obeys would say.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from faults_world import World, advance

WINDOW = 0.5
"""Time over which motion that is said is compared with motion that was commanded, s."""
SEEN = (0.03, 0.05, 0.05, 0.1)
"""Differences that can be seen: way, m, and turn, rad, within the window; speed, m/s; turning rate, rad/s."""


class Said(NamedTuple):
    """What a message of odometry says."""

    x: float
    y: float
    theta: float
    v: float
    omega: float
    across: float = 0.0
    """Speed to the left, m/s."""
    frame: str = "odom"
    child: str = "base_footprint"


Lie = Callable[[Said, float], Said]
"""Returns what is said instead, at a time, s."""
Wheels = Callable[[float, float], tuple[float, float]]
"""Returns the v, m/s, and omega, rad/s, with which something moves, for those of the command."""


def honest(said: Said, now: float) -> Said:
    """Say what is true."""
    return said


def obeying(v: float, omega: float) -> tuple[float, float]:
    """Move as commanded."""
    return v, omega


class Driver:
    """The driver of a robot in a world.

    Args:
        world: Where the robot is in truth.
        start: Pose that its odometry states at first; m, m, rad.
    """

    def __init__(self, world: World, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.world = world
        self.lie: Lie = honest
        self.turns: Wheels = obeying
        """How the wheels turn."""
        self.grips: Wheels = obeying
        """How a robot moves whose wheels turn so."""
        self.seen = Seen()
        self.unexplained = 0.0
        """Sum of the ways that it said besides those that were commanded, m."""
        self._measured = self._obedient = start
        self._speeds, self._said_at = (0.0, 0.0), 0.0

    def move(self, v: float, omega: float, dt: float) -> None:
        """Obey a command for a time, s."""
        self._obedient = advance(self._obedient, v, omega, dt)
        turned = self.turns(v, omega)
        self._measured, self._speeds = advance(self._measured, *turned, dt), (v, omega)
        self.world.move(*self.grips(*turned), dt)

    def says(self, now: float) -> Said:
        """Return what it says at a time, s."""
        said = self.lie(Said(*self._measured, *self.turns(*self._speeds)), now)
        self.unexplained += abs(said.v - self._speeds[0]) * min(max(now - self._said_at, 0.0), 0.2)
        self._said_at = now
        self.seen.compare(said, Said(*self._obedient, *self._speeds), now)
        return said


class Seen:
    """When it could first be seen that a robot does not move as it says, or as commanded.

    Args:
        window: Time over which motions are compared, s.
        least: Differences that can be seen, see `SEEN`.
    """

    def __init__(self, window: float = WINDOW, least: tuple[float, ...] = SEEN) -> None:
        self._lasts, self._least = window, least
        self.at: float | None = None
        """Time of the first message that shows it, s."""
        self._window: deque[tuple[float, Said, Said]] = deque()

    def compare(self, said: Said, obedient: Said, now: float) -> None:
        """Take what is said, and what a robot that obeys would say."""
        self._window.append((now, said, obedient))
        while self._window[0][0] < now - self._lasts:
            self._window.popleft()
        differs = (found > least for found, least in zip(self._differences(said, obedient), self._least, strict=True))
        if self.at is None and (said.frame != obedient.frame or any(differs)):
            self.at = now

    def _differences(self, said: Said, obedient: Said) -> tuple[float, float, float, float]:
        _, before, obeyed = self._window[0]
        (dx, dy, turn), (to_x, to_y, to_turn) = _motion(before, said), _motion(obeyed, obedient)
        return (
            math.hypot(dx - to_x, dy - to_y),
            abs(math.remainder(turn - to_turn, 2.0 * math.pi)),
            math.hypot(said.v - obedient.v, said.across),
            abs(said.omega - obedient.omega),
        )


def _motion(before: Said, after: Said) -> tuple[float, float, float]:
    """Return the motion between two messages in the frame of the first; m, m, rad."""
    dx, dy = after.x - before.x, after.y - before.y
    cosine, sine = math.cos(before.theta), math.sin(before.theta)
    return cosine * dx + sine * dy, cosine * dy - sine * dx, after.theta - before.theta
