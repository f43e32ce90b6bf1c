"""The guard's collision monitor: which scan counts, where the robot is in it, and what it lets through. Knows no ROS.

**Where the robot is.** A scan is old when it comes, and grows older until the next one. Between the moment at which a beam was
measured and the present, the robot moved as it was told, with a delay: the monitor adds up what the guard has told the wheels.
When exactly a beam was measured is not known: a revolution takes ``period``, drivers turn and stamp it either way, and wheels
and driver take up to ``reaction``. So each scan is laid out as if it had been measured at each of `LAYERS` moments between
``period + reaction`` before it was sent, and the moment at which it was sent; all of these points count, and thus the worst. At
rest they are the same points.

**Which scan counts.** The newest, while it is younger than ``age`` since it was sent (see `sent`; of a header's stamp the
``period`` is taken off, as some drivers stamp the first beam). One that cannot be read, see `collision.points_of`, takes the
place of the one before. Without a scan nothing moves, turning included.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from turtlebot_gym.values import STOP, Command
from turtlebot_gym_ros.robot.collision import Body, Limits, Scan, gaps, into, limited, moved, out_of, points_of

LAYERS = 5
"""How often a scan is laid out: every 0.1 s where ``period`` and ``reaction`` are 0.2 s each."""
MEMORY = 2.0
"""How long it is remembered what the wheels were told, s: longer than any scan is old that counts."""


class Timing(NamedTuple):
    """When scans are measured, and how long they count."""

    age: float
    """Age since it was sent from which a scan no longer counts, s."""
    period: float
    """Time of one revolution, s."""
    reaction: float
    """Time until the wheels do what they were told, and until the driver sends what it measured, s at most."""


class Monitor:
    """Limit commands by the newest scan.

    ``now`` is a steady time, s.

    Args:
        body: Footprint and mount.
        limits: How near it may come.
        timing: How old scans are.
        speed: The robot's greatest speed, m/s ...
        turning: ... and turning rate, rad/s.
        now: The present.
    """

    def __init__(self, body: Body, limits: Limits, timing: Timing, *, speed: float, turning: float, now: float) -> None:
        self._body, self._limits, self._timing = body, limits, timing
        # Farther than it moves within the time to contact after all the time for which a scan is used.
        used = limits.time + timing.age + timing.period + timing.reaction
        self._reach = (speed + turning * abs(body.center_x)) * used
        self._points, self._sent, self._bad = np.empty((3, 0)), -math.inf, "no scan has come"
        self._times, self._poses, self._told = [now], [(0.0, 0.0, 0.0)], [STOP]
        self.state = ""

    def hear(self, scan: Scan, *, sent: float) -> None:
        """Take a scan that was sent at a steady time; an older one than the last does not count."""
        if sent < self._sent:
            return
        self._sent, self._bad = sent, ""
        try:
            points = points_of(scan, self._body, self._limits, self._reach)
        except ValueError as error:
            self._bad = f"a scan was refused: {error}"
            return
        span = self._timing.period + self._timing.reaction
        layers = [out_of(self._pose(sent - span * layer / (LAYERS - 1)), points) for layer in range(LAYERS)]
        self._points = np.concatenate(layers, axis=1)

    def told(self, command: Command, now: float) -> None:
        """Note what the wheels are told from now on."""
        pose = self._pose(now)
        old = bisect_right(self._times, now - MEMORY) - 1
        if old > 0:
            del self._times[:old], self._poses[:old], self._told[:old]
        self._times.append(now)
        self._poses.append(pose)
        self._told.append(command)

    def trouble(self, now: float) -> str:
        """Return why nothing may move, or nothing."""
        if self._bad:
            return self._bad
        return f"the last scan is older than {self._timing.age:g} s" if now - self._sent > self._timing.age else ""

    def limit(self, command: Command, now: float) -> Command:
        """Return as much of a command as is safe, the same arc more slowly; sets the state."""
        self.state = self.trouble(now)
        if self.state:
            return STOP
        points, center_x = into(self._pose(now), self._points), self._body.center_x
        allowed = limited(points, command, center_x, self._limits)
        if allowed != command:
            near = "in the stop zone" if gaps(points, center_x).min() <= 0.0 else "ahead"
            self.state = f"{'stopped' if allowed == STOP else 'slowed down'}: an obstacle is {near}"
        return allowed

    def _pose(self, at: float) -> tuple[float, float, float]:
        """Return where the robot has been told to be at a time."""
        k = max(bisect_right(self._times, at) - 1, 0)
        return moved(self._poses[k], self._told[k], max(at - self._times[k], 0.0))
