"""The last rule of a deployment: a robot drives only where its LiDAR has looked, whatever its policy wants.

With a LiDAR that sees a part of the circle, or is covered at times, the robot stays where beams have passed in the last
seconds. It may turn on the spot anywhere, and if its policy insists on a direction in which nothing has looked, it turns once
around, to look. Points of the plane are complex numbers, m.
"""

from __future__ import annotations

import cmath
import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SECTORS
from turtlebot_gym.values import STOP, Command
from turtlebot_gym_agents.policies.sight import arc

LASTS = 6.0
"""Time for which a place that was seen counts as free, s: later, somebody may have stepped there."""
RESERVE, LAST_RESERVE = 0.5, 0.3
"""Times for which the robot must keep out of what was not seen, and of obstacles, s, besides the time to brake."""
CLEARANCE = 0.04
"""Clearance that it keeps from both, m."""
LONG = 1.05
"""Ratio by which ranges may be too long: that of an LDS-01."""
BLUR = 0.1
"""Time by which a beam may be older or newer than its scan's age says, s: half a revolution."""
PATIENCE, LOOK = 2.0, 2.0
"""Time for which a policy may insist before the robot looks around, s, and the rate at which it turns then, rad/s."""
SECTOR = 2.0 * math.pi / SECTORS
"""Angle of a sector, rad."""
LIDAR_X = -0.032
"""Place ahead of the axle from which policies see, m."""
_GAP = 1.0
"""Time between two calls after which it is unknown how the robot has moved, s."""
_LOOKS = "the robot turns to look: its policy would drive where no beam has looked"
_SHARES = (1.0, 0.7, 0.4, 0.2)
"""Shares of the commanded speed to try."""
_RIM = np.exp(1j * np.linspace(-0.375 * np.pi, 0.375 * np.pi, 11))
"""Points of the rim around the direction in which it moves, for a radius of 1; with the clearance, as wide as the robot."""
_FAR, _NEAR = np.array([[1.0], [2.0], [3.0]]) * RESERVE / 3.0, np.array([[1.0], [2.0]]) * LAST_RESERVE / 2.0
"""Times at which the rim is checked, s."""


class SeenSpace:
    """Remember where beams have passed, and keep a robot there; the control period is in s."""

    def __init__(self, robot: Robot, period: float) -> None:
        self._robot, self._period = robot, period
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self._scans = deque[tuple[float, complex, complex, NDArray[np.float64]]]()  # newest first: time, place, heading, ranges
        self._now, self._at, self._heading, self._twist = -math.inf, 0.0j, 1.0 + 0.0j, STOP
        self._insists, self._steps, self._rate = 0.0, 0, 0.0
        self.notice = ""
        """Why the last command was not the policy's; empty if nothing unknown was in its way."""

    def limit(self, wish: Command, twist: Command, seen: NDArray[np.float64], age: float, now: float) -> Command:
        """Return a policy's command, within the robot's limits, limited to where beams have passed.

        ``twist`` holds until the next call; ``seen`` is the range of the newest scan in each sector, m, 0 where no beam has
        looked; ``age`` is that of the scan, and ``now`` the current time, s.
        """
        self._move(now)
        self._remember(seen, age)
        self._twist = twist
        self.notice = ""
        if all(ranges.all() for *_, ranges in self._scans):  # a policy that was blind may be nearer to things than it knows
            self._insists, self._steps = 0.0, 0
            return wish
        if self._steps > 0:
            self._steps, self.notice = self._steps - 1, _LOOKS
            return Command(0.0, self._rate)
        unseen = False
        for share in _SHARES:
            unseen, is_near = self._judge(share * wish.v, wish.omega)
            if not (unseen or is_near):
                self._insists = 0.0
                return Command(share * wish.v, wish.omega)
        if unseen:
            self._insists, self.notice = self._insists + self._period, _LOOKS
        if self._insists > PATIENCE:
            least = 2.0 * math.pi / (min(LOOK, self._robot.max_angular) * self._period)
            self._insists, self._steps = 0.0, math.ceil(least)
            self._rate = math.copysign(2.0 * math.pi / (self._steps * self._period), wish.omega)
        return Command(0.0, wish.omega)

    def _move(self, now: float) -> None:
        """Move the robot by its twist since the last call: over seconds, that errs less than the poses of a filter."""
        elapsed, self._now = now - self._now, now
        if elapsed > _GAP:  # nobody knows how it moved
            self._scans.clear()
            return
        bent = cmath.rect(1.0, 0.5 * self._twist.omega * elapsed)
        self._at, self._heading = self._at + self._heading * bent * self._twist.v * elapsed, self._heading * bent * bent

    def _remember(self, seen: NDArray[np.float64], age: float) -> None:
        """Remember a new scan with the pose from which it was measured, and forget old ones."""
        measured, (v, omega) = self._now - age, self._twist
        while self._scans and self._scans[-1][0] < self._now - LASTS:
            self._scans.pop()
        if self._scans and measured <= self._scans[0][0] + 1e-6:  # between two scans, each step has the last one again
            return
        for _ in range(0 if seen.all() else round(abs(omega) * BLUR / SECTOR + 0.25)):
            seen = np.minimum(seen, np.minimum(np.roll(seen, 1), np.roll(seen, -1)))
        bent = cmath.rect(1.0, -0.5 * omega * age)
        heading = self._heading * bent
        self._scans.appendleft((measured, self._at - heading * v * age, heading * bent, seen))

    def _judge(self, v: float, omega: float) -> tuple[bool, bool]:
        """Return whether a command leads to where nothing has looked, and whether it leads to an obstacle."""
        if v == 0.0:
            return False, False
        before, bent = arc(*self._twist, self._period)  # until the command acts
        ways = bent * arc(v, omega, np.concatenate([_FAR, _NEAR]) + abs(v) / (2.0 * self._robot.max_linear_acceleration))[0]
        rim = before + ways + ways / np.maximum(np.abs(ways), 1e-9) * (self._robot.radius + CLEARANCE) * _RIM
        _, places, headings, ranges = map(np.array, zip(*self._scans, strict=True))
        points = (self._at + self._heading * rim.ravel() - places[:, None]) * np.conj(headings)[:, None]
        sectors = np.round(np.angle(points - LIDAR_X) / SECTOR).astype(np.int64) % SECTORS
        reach, was_there = np.take_along_axis(ranges, sectors, axis=1), np.abs(points) <= self._robot.radius
        newest = np.argmax(was_there | (reach > 0.0), axis=0)[None]  # that looked there, or had the robot there
        passed = np.take_along_axis(was_there | (LONG * np.abs(points - LIDAR_X) < reach), newest, axis=0).reshape(rim.shape)
        unseen = ~passed & (reach[0] == 0.0).reshape(rim.shape)
        return bool(unseen[: len(_FAR)].any()), not passed[len(_FAR) :].all()
