"""The guard's collision monitor: the scan to use, the robot's pose in it, and the speed it allows. Does not depend on ROS.

**Pose of the robot.** A scan is old when it arrives, and ages until the next one. Since a beam was measured, the robot has
moved as commanded, with a delay: the monitor integrates the guard's commands. The exact time of a beam is unknown: a revolution
takes ``period``, drivers rotate and stamp in either direction, and wheels and driver take up to ``reaction``. So each scan is
placed as if it had been measured at each of `LAYERS` times between ``period + reaction`` before it was sent and the time at
which it was sent; all of these points count, and thus the worst. At rest they coincide.

**Valid scan.** The newest one, while it is younger than ``age`` since it was sent (see `sent`; the ``period`` is subtracted
from a header's age, as some drivers stamp the first beam). A scan that cannot be read, see `beams`, replaces the
previous one, and so does one of a LiDAR that does not measure or is mounted otherwise, see `scan_watch`. Without a valid scan
the robot stands and does not turn either.

**Mount.** The pose of the scan's frame by ``/tf_static``, if any, replaces that of the parameters, which may be about all
robots of a kind; a difference is reported. With ``scan_mount`` "given" one of the two is wrong, and scans are refused, as are
those of a LiDAR that ``/tf_static`` states twice, differently, or tilted.

**Unknown space**, see `collision`, is entered slowly, at ``escape_speed`` at most, and only for the way that this makes in the
time to contact: then the robot stops before it. Motion over ground that the scan shows gives the way back, since the robot may
return over what it has left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cmd_vel_guard.collision import Footprint, Limits, RawScan, gaps, limited, read, turns_freely, view_of
from cmd_vel_guard.values import STOP, Command, Mount, Pose
from turtlebot_gym.beams import narrow_gap
from turtlebot_gym.motion import into, out_of
from turtlebot_gym.mounts import differ
from turtlebot_gym.scan_watch import ScanWatch

LAYERS = 5
"""Number of times at which a scan is placed: every 0.1 s if ``period`` and ``reaction`` are 0.2 s each."""


class ScanTiming(NamedTuple):
    """When scans count, s: ``scan_age``, ``scan_period``, ``reaction`` and ``scan_returns`` of the parameters."""

    age: float
    period: float
    reaction: float
    returns: float = 0.0


class Monitor:
    """Limit commands by the newest scan; ``now`` is a steady time, s, ``speed`` and ``turning`` are the robot's greatest ones.

    ``mount_of`` returns a frame's pose by ``/tf_static``, if stated; one other than a mount ``given`` by a person is refused.
    """

    def __init__(
        self,
        body: Footprint,
        limits: Limits,
        timing: ScanTiming,
        *,
        speed: float,
        turning: float,
        now: float,
        given: bool = False,
        mount_of: Callable[[str], Pose | None] = lambda frame: None,
    ) -> None:
        self._given, self._mount_of = given, mount_of
        self._body, self._limits, self._timing = body, limits, timing
        # Farther than the robot can move in the time to contact plus the whole validity of a scan.
        used = limits.time + timing.age + timing.period + timing.reaction
        self._reach = (speed + turning * abs(body.center_x)) * used
        self._narrow = narrow_gap(body.radius, limits.margin + speed * limits.time)
        self._room = limits.escape_speed * limits.time
        self._enters, self._judged = False, now
        self._points, self._unknown = np.empty((3, 0)), np.empty((3, 0))
        self._sent, self._bad = -math.inf, "no scan has arrived"
        self.watch = ScanWatch(lag=timing.period + timing.reaction, returns=timing.returns, narrow=self._narrow, now=now)
        self.track = self.watch.track
        """The commands of the wheels: the arbiter adds each one that it publishes."""
        self.state = ""
        self.remark = ""
        """What is unexpected about the mount, if anything."""

    def hear(self, scan: RawScan, *, sent: float) -> None:
        """Take a scan that was sent at a steady time; one older than the last is ignored."""
        if sent < self._sent:
            return
        self._sent, self._bad = sent, ""
        try:
            body = self._mounted(scan.frame)
            beams = read(scan, body, self._limits)
            beams = self.watch.hear(beams, sent, mount=body.scan[1:], range_max=scan.range_max)
        except ValueError as error:
            self._bad = f"a scan was refused: {error}"
            return
        view = view_of(beams, body, self._limits, reach=self._reach, narrow=self._narrow, room=self._room)
        span = self._timing.period + self._timing.reaction
        layers = [out_of(self.track.at(sent - span * layer / (LAYERS - 1)).pose, view.seen) for layer in range(LAYERS)]
        self._points = np.concatenate(layers, axis=1)
        # A blind sector turns with the robot, so only the last pose counts.
        self._unknown = out_of(self.track.at(sent).pose, view.unknown)

    def _mounted(self, frame: str) -> Footprint:
        """Return the body with the mount of a scan's frame, and set the remark; raise `ValueError` if a person gave another."""
        stated, mount, self.remark = self._mount_of(frame), self._body.scan, ""
        if stated is None or (mount.frame in (frame, frame.rsplit("/", 1)[-1]) and not differ(stated, Pose(*mount[1:]))):
            return self._body
        x, y, yaw = stated
        place = f"/tf_static says that {frame!r} is at x {x:.3f} m, y {y:.3f} m, turned by {yaw:.3f} rad"
        if self._given:
            raise ValueError(f"{place}, and the given mount is another: correct one, or set scan_mount to tf_static")
        self.remark = f"{place}, which is not the parameters' mount, and counts"
        return self._body._replace(scan=Mount(frame, x, y, yaw))

    def trouble(self, now: float) -> str:
        """Return why the robot must stand, or an empty text."""
        if why := self._bad or self.watch.trouble():
            return why
        return f"the last scan is older than {self._timing.age:g} s" if now - self._sent > self._timing.age else ""

    def limit(self, command: Command, now: float) -> Command:
        """Return a command slowed down to be safe, on the same arc; sets the state."""
        self.state = self.trouble(now)
        if self.state:
            return STOP
        self._walk(now)
        pose, center_x = self.track.at(now).pose, self._body.center_x
        points, unknown = into(pose, self._points), into(pose, self._unknown)
        if command.v == 0.0 and all(turns_freely(part, center_x, self._limits.margin) for part in (points, unknown)):
            self._enters = False
            return command
        seen = limited(points, command, center_x, self._limits)
        allowed = limited(unknown, seen, center_x, self._limits)
        self._enters = allowed != seen
        if allowed != command:
            near = "in the stop zone" if gaps(points, center_x).min(initial=math.inf) <= 0.0 else "ahead"
            why = "the scan says nothing about what is ahead" if self._enters else f"an obstacle is {near}"
            self.state = f"{'stopped' if allowed == STOP else 'slowed down'}: {why}"
        return allowed

    def _walk(self, now: float) -> None:
        """Count the way into unknown space, or the way over known ground since the last call."""
        v, omega = self.track.command
        way = math.hypot(v, omega * self._body.center_x) * (now - self._judged)
        room = self._room - way if self._enters else self._room + way
        self._room, self._judged = min(max(room, 0.0), self._limits.escape_speed * self._limits.time), now
