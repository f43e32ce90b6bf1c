"""The last rule of a deployment: a robot drives only where its LiDAR has looked, whatever its policy wants.

A LiDAR that looks all around changes no command. With one that sees a part of the circle, the footprint must stay where beams
have passed in the last seconds, until the robot can have stopped; it may turn on the spot anywhere. If a policy insists on a
direction that nothing has seen, the robot turns once around, to look.

Points of the plane are complex numbers, m. This module needs only numpy.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SECTORS
from turtlebot_gym.values import Command, State
from turtlebot_gym_agents.policies.sight import arc

LASTS = 6.0
"""Time for which a place that was seen counts as free, s: later, somebody may have stepped there."""
RESERVE = 0.5
"""Time for which the robot must stay in seen space at its command's speed, s, besides the time to brake."""
SLACK = 0.03
"""Clearance to keep from what was not seen, m."""
BLUR = 0.1
"""Time by which a beam may be older or newer than its scan's age says, s: half a revolution."""
PATIENCE = 2.0
"""Time for which a policy may insist on a direction that nothing has seen before the robot looks around, s."""
LOOK = 2.0
"""Turning rate at which it looks around, rad/s."""
SECTOR = 2.0 * math.pi / SECTORS
"""Angle of a sector, rad."""
LIDAR_X = -0.032
"""Place ahead of the axle from which policies see, m."""
SHARES = (1.0, 0.7, 0.4, 0.2)
"""Shares of the commanded speed to try."""
_LOOKS = "the robot turns to look: its policy would drive where no beam has looked"
_SHARP = 0.25
"""Share of a sector by which beams may be off without being counted in the next one."""
_APART = 0.05
"""Least time between two remembered scans, s."""
_RIM = np.exp(1j * np.linspace(-0.5 * np.pi, 0.5 * np.pi, 13))
"""Points on the half of the rim that goes first, for a radius of 1."""
_PARTS = np.array([[1.0], [2.0], [3.0]]) / 3.0
"""Parts of the way after which the rim is checked."""


class SeenSpace:
    """Remember where beams have passed, and keep a robot there.

    Args:
        robot: The robot.
        period: Control period, s.
    """

    def __init__(self, robot: Robot, period: float) -> None:
        self._robot, self._period = robot, period
        self._leap = 0.05 + 2.0 * robot.max_linear * period
        count = math.ceil(LASTS / _APART) + 1
        self._ranges = np.zeros((count, SECTORS))
        self._times, self._places, self._headings = np.empty(count), np.zeros(count, complex), np.ones(count, complex)
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._times[:] = -math.inf
        self._now, self._row, self._at, self._heading = -math.inf, 0, complex(math.nan), 1.0 + 0.0j
        self._insists, self._to_turn = 0.0, 0.0
        self.notice = ""
        """Why the last command was not the policy's; empty if it was."""

    def limit(self, wish: Command, mean: State, seen: NDArray[np.float64], age: float, now: float) -> Command:
        """Return a policy's command, limited to where beams have passed.

        Args:
            wish: The command, within the robot's limits.
            mean: Estimated state.
            seen: Range of the newest scan in each sector, shape (`SECTORS`,), m; 0 where no beam has looked.
            age: Age of that scan, s.
            now: Current time, s, by a clock that begins with the episode or before.
        """
        self._now = now
        self._remember(mean, seen, now - age)
        self.notice = ""
        if seen.all():
            self._insists = self._to_turn = 0.0
            return wish
        if self._to_turn != 0.0:
            rate = math.copysign(min(LOOK, self._robot.max_angular, abs(self._to_turn) / self._period), self._to_turn)
            self._to_turn -= rate * self._period
            self.notice = _LOOKS
            return Command(0.0, rate)
        ahead = np.zeros(0, np.complex128)
        for share in SHARES:
            ahead = self._unseen(share * wish.v, wish.omega, mean)
            if not len(ahead):
                self._insists = 0.0
                return Command(share * wish.v, wish.omega)
        if (_in_sectors(ahead - LIDAR_X, seen) == 0.0).any():  # otherwise an obstacle is there, not the unknown
            self.notice = _LOOKS
            self._insists += self._period
        if self._insists > PATIENCE:
            self._insists, self._to_turn = 0.0, math.copysign(2.0 * math.pi, wish.omega)
        return Command(0.0, wish.omega)

    def _remember(self, mean: State, seen: NDArray[np.float64], measured: float) -> None:
        """Remember a new scan with the pose from which it was measured."""
        place, heading = complex(mean.x, mean.y), cmath.rect(1.0, mean.theta)
        if abs(place - self._at) > self._leap:
            self._times[:] = -math.inf  # places in the old frame mean nothing in the new one
        self._at, self._heading = place, heading
        newest = self._times[self._row]
        if measured <= newest + 1e-6:  # between two scans, each step has the last one again
            return
        if measured > newest + _APART:
            self._row = (self._row + 1) % len(self._times)
        if not seen.all():
            for _ in range(math.ceil(abs(mean.omega) * BLUR / SECTOR - _SHARP)):
                seen = np.minimum(seen, np.minimum(np.roll(seen, 1), np.roll(seen, -1)))
        age = self._now - measured
        bent = cmath.rect(1.0, -0.5 * mean.omega * age)  # on average over the way since
        self._times[self._row], self._ranges[self._row] = measured, seen
        self._places[self._row], self._headings[self._row] = place - heading * bent * mean.v * age, heading * bent * bent

    def _unseen(self, v: float, omega: float, mean: State) -> NDArray[np.complex128]:
        """Return the points, in the robot's frame, that a command leads its rim to and no beam has passed; shape (n,)."""
        if v == 0.0:
            return np.zeros(0, np.complex128)
        time = RESERVE + abs(v) / (2.0 * self._robot.max_linear_acceleration)
        before, bent = arc(mean.v, mean.omega, self._period)  # until the command acts
        steps, turns = arc(v, omega, time * _PARTS)
        rim = (before + bent * (steps + turns * math.copysign(self._robot.radius + SLACK, v) * _RIM)).ravel()
        rows = np.flatnonzero(self._times > self._now - LASTS)
        rows = rows[np.argsort(-self._times[rows])]
        points = (self._at + self._heading * rim - self._places[rows, None]) * np.conj(self._headings[rows, None])
        inside, from_lidar = np.abs(points) <= self._robot.radius, points - LIDAR_X
        ranges = _in_sectors(from_lidar, self._ranges[rows])
        newest = np.argmax(inside | (ranges > 0.0), axis=0)[None]  # that looked there, or had the robot there
        return rim[~np.take_along_axis(inside | (np.abs(from_lidar) < ranges), newest, axis=0)[0]]


def _in_sectors(points: NDArray[np.complex128], ranges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ranges (..., `SECTORS`) in the directions of points (..., n), shape (..., n), m."""
    sectors = np.round(np.angle(points) / SECTOR).astype(np.int64) % SECTORS
    return np.take_along_axis(ranges, sectors, axis=-1)
