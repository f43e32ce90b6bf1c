"""What a deployment believes of a LiDAR: scans that may not be driven by are refused, and unknown ground is not driven on."""

from __future__ import annotations

import math

from turtlebot_gym.beams import TURN, narrow_gap
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.scan import Scan, beams_in
from turtlebot_gym.rooms.sectors import Pooling
from turtlebot_gym.scan_watch import ScanWatch
from turtlebot_gym.values import Command, Pose
from turtlebot_gym_agents.policies.seen_space import LIDAR_X, LOOK, SeenSpace

MARGIN, AHEAD = 0.05, 1.0
"""Clearance, m, and time, s, at which a robot brakes at the latest: it must not pass between two beams unseen from there."""
LAG = 0.4
"""Longest time from a motion to its effect in a scan, s: one revolution, and the driver."""
UNSURE = "the robot turns: a part of its LiDAR seems to be covered or frozen"
AT_PLACE = 0.05
"""Distance up to which a LiDAR's place is taken for that with which policies are trained, m: there it varies by as much."""


class NotBelievedError(ValueError):
    """A scan that the robot must not drive by: it cannot be read, or the LiDAR is frozen, covered or mounted otherwise."""


class Scans:
    """Reads the scans of one LiDAR, see `turtlebot_gym.scan_watch`, and keeps the robot where its beams have passed.

    A scan has ``beams`` beams, or any number if 0, at least a share ``returns`` of which must return something. The LiDAR is
    turned by ``yaw``, rad, and the control period is in s.
    """

    def __init__(self, robot: Robot, period: float, *, yaw: float, beams: int, returns: float) -> None:
        self._robot, self._returns, self._pool = robot, returns, Pooling(yaw=yaw, beams=beams)
        self._usual = Pose(LIDAR_X, 0.0, yaw)
        self.seen_space = SeenSpace(robot, period)
        """Keeps the robot where beams have passed; its ``notice`` says when it does."""
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self.seen_space.reset()
        narrow = narrow_gap(self._robot.radius, MARGIN + self._robot.max_linear * AHEAD)
        self._watch, self._measured = ScanWatch(lag=LAG, returns=self._returns, narrow=narrow, now=0.0), -math.inf
        self._turned, self._looked = 0.0, 0.0  # while the LiDAR seems to be covered or frozen: angle, rad, and time, s

    def look(self, scan: Scan, twist: Command, age: float, now: float, mount: Pose | None = None) -> list[float]:
        """Return the sectors of the newest scan, in which beams that say nothing are unknown.

        ``age`` is that of the scan and ``now`` the current time, s; ``mount`` is the pose of its frame in the robot's, None for
        the usual place. Raises `NotBelievedError` with one line; a robot whose LiDAR seems to be covered or frozen in part
        turns once around first: the edges of a cover turn with it, and somebody who walked beside it does not.
        """
        self._watch.track.add(twist, now)
        if now - age > self._measured + 1e-6:  # between two scans, each step has the last one again
            self._measured, self._bad = now - age, ""
            try:
                beams = self._watch.hear(beams_in(scan), self._measured, mount=mount or self._usual, range_max=scan.range_max)
                self._scan = scan._replace(ranges=beams.ranges)
            except ValueError as why:
                self._bad = str(why)
        why = self._bad or self._watch.trouble()
        if why and (self._bad or not self._watch.frozen):
            raise NotBelievedError(why)
        silent = self._watch.covered
        self._turned = self._turned + abs(twist.omega) * (now - self._looked) if silent or self._watch.frozen else 0.0
        self._looked = now
        if self._turned > TURN:
            raise NotBelievedError(
                why or f"{math.degrees(silent):.0f} degrees of the LiDAR return nothing, however the robot turns: it is covered"
            )
        return self._pool(self._scan, None if mount is None else _from_usual(mount))

    def limit(self, wish: Command, twist: Command, age: float, now: float) -> Command:
        """Return a command, limited to where beams have passed; a robot that is unsure of its LiDAR turns."""
        if self._pool.seen is None:
            return wish
        if self._watch.covered or self._watch.frozen:
            self.seen_space.notice = UNSURE
            return Command(0.0, min(LOOK, self._robot.max_angular))
        return self.seen_space.limit(wish, twist, self._pool.seen, age, now)


def _from_usual(mount: Pose) -> Pose:
    """Return a LiDAR's mount as seen from the place from which policies see; at that place if it is near."""
    x, y = mount.x - LIDAR_X, mount.y
    return Pose(*((x, y) if math.hypot(x, y) > AT_PLACE else (0.0, 0.0)), mount.theta)
