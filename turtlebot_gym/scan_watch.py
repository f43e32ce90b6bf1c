"""Whether a LiDAR measures at all, and looks where its mount says. Does not depend on ROS and takes steady times as arguments.

**Frozen.** A scan that repeats another to the bit while the robot has moved is no measurement: noise alone changes some of ten
ranges of 1 mm in each scan. A simulated LiDAR without noise repeats itself at rest, and along a corridor whose ends are out of
its sight. So motion counts, after all delays: a turn by `TURNED`, or `DRIVEN` with a return near the line of travel, which then
must change, or `DRIVEN_BLIND` without one. With a time to contact of 1 s the robot stops before it has driven to where the
frozen scan showed something: it then takes 0.02 m, one scan and the delays, 0.7 s at 0.2 m/s.

**Covered.** A scan with hardly a return for `DARK` s looks like a hall, and like a covered LiDAR. The robot stands.

**Motion.** Points of a scan, moved as the robot has moved since, must lie where the next one has returns. If they fit that scan
clearly better with the motion turned by a quarter or half a turn, `VOTES` times in a row, the LiDAR is mounted so. If they do
with left and right exchanged, it is upside down or clockwise, which only turns show; if they do without any motion,
`STILL_VOTES` times, the scans are late or another robot's. Walls fit in many ways, so one comparison alone proves little. Other
people move, wheels slip and rooms are symmetrical: all of these make the fits equally bad, or equally good, and are no vote.

**Late.** Scans that are late by a second and hide it move as the robot has moved a second before. At constant speed nothing
shows that; where the robot starts or stops, two scans fit worse with its measured motion than with an earlier one. The
difference of the misfits adds up for each of several ages. In 900 s of driving with slip it stayed below 0.02 m; with late
scans half of all robots reached 0.05 m.

A frozen or covered LiDAR counts again when its scans change; a wrong mount or late scans not until `forget`, when a person
enables the robot.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.motion import Motion, Track, into
from turtlebot_gym.values import Command

LEAST_RETURNS = 10
"""Number of returns from which equal scans mean something: noise leaves ten ranges equal once in 1e10 scans."""
TURNED, DRIVEN, DRIVEN_BLIND = 0.02, 0.02, 0.3
"""Motion after which a scan must have changed, rad and m."""
NEAR_LINE = math.radians(15.0)
"""Angle from the line of travel within which a return must change by nearly the whole way."""
DARK = 0.5
"""Time without enough returns after which a LiDAR counts as covered, s."""
STEP = 0.06
"""Way between two scans that are compared for the mount, m: twice the noise of a range at 1 m."""
WIDE = 1.0
"""Turn between two scans from which they are not compared, rad."""
BINS = 180
"""Most directions in which two scans are compared, however many beams they have."""
CAP = 0.15
"""Largest difference of a range that counts, m: a larger one is an edge, or somebody who walks."""
BETTER = 0.6
"""Share of the mount's own misfit below which another mount fits clearly better."""
COMMON = 15
"""Least number of directions with returns in both scans."""
LEAST_TURN = 0.3
"""Turn between two scans that are compared without a way, rad."""
VOTES, STILL_VOTES = 3, 4
"""Comparisons in a row after which a mount is refused, or scans that do not move: a slow robot starts late."""
MIRRORED, STILL = 4, 8
"""Numbers of the first way of seeing the motion mirrored, and of seeing none."""
USUAL, LATE = (-0.15, 0.0, 0.15, 0.3), (0.6, 0.9, 1.2, 1.6)
"""Ages of scans, s, beyond half of the allowed delay: usual ones, and those of late scans."""
PAUSE, LEAST_WAY, STRAIGHT = 0.5, 0.02, 0.1
"""Longest time between two scans that are compared for their age, s; least way, m, and greatest turn meanwhile, rad."""
KEPT, DOUBT = 0.9, 0.03
"""Share of a doubt that each scan leaves, and doubt from which scans are late, m."""
FRESH = 0.3
"""Time for which a measured twist is in force, s."""
QUARTERS = {1: "90 degrees to the left", 2: "180 degrees", 3: "90 degrees to the right"}


class ScanWatch:
    """Judge a LiDAR by its scans and the robot's motion.

    Args:
        lag: Longest time from a command to its effect in a scan, s: wheels, one revolution, and the driver.
        returns: Least share of a scan's beams that return something; 0 for any.
        now: Current steady time, s.
    """

    def __init__(self, *, lag: float, returns: float, now: float) -> None:
        self._lag, self._returns = lag, returns
        self.track = Track(now)
        """The commands of the wheels, or the robot's twist: whoever watches adds each new one."""
        self._measured, self._measured_at = Track(now), -math.inf
        self._last: NDArray[np.float32] | None = None
        self._since, self._light = now, now
        self._equal = False
        self.forget()

    def forget(self) -> None:
        """Forget what was learned about the mount."""
        self._key: tuple[Motion, NDArray[np.float64]] | None = None
        self._votes: list[int] = []
        self._before: tuple[float, NDArray[np.float64]] | None = None
        self._doubts = np.zeros(len(LATE))
        self._turned_by = 0

    def move(self, twist: Command, now: float) -> None:
        """Take a twist that the robot has measured, in force from now on; without any, late scans are not noticed."""
        if now > self._measured_at and math.isfinite(twist.v + twist.omega):
            self._measured.add(twist, now)
            self._measured_at = now

    def hear(self, ranges: NDArray[np.float32], directions: NDArray[np.float64], sent: float) -> None:
        """Take a scan.

        Args:
            ranges: Shape (B,), m; what is not finite and positive is no return.
            directions: Directions of the beams in the robot's frame, shape (B,), rad.
            sent: Steady time at which it was sent, s.
        """
        returned = np.isfinite(ranges) & (ranges > 0.0)
        count = int(returned.sum())
        if count >= max(self._returns * len(ranges), 1.0):
            self._light = sent
        last, self._last = self._last, ranges
        repeats = last is not None and np.array_equal(last, ranges, equal_nan=True)
        if not repeats or count < LEAST_RETURNS:
            self._since, self._equal, self._at_first = sent, False, self.track.at(sent)
        else:
            before, after = self._at_first, self.track.at(max(sent - self._lag, self._since))
            near = np.abs(np.sin(directions[returned])) < math.sin(NEAR_LINE)
            least = DRIVEN if near.any() else DRIVEN_BLIND
            self._equal = after.turned - before.turned >= TURNED or after.way - before.way >= least
        self._sent = sent
        if count >= COMMON and not repeats and not self._turned_by:
            lengths, angles = ranges[returned].astype(np.float64), directions[returned]
            points = np.stack((lengths * np.cos(angles), lengths * np.sin(angles)))
            at, bins = sent - 0.5 * self._lag, min(len(ranges), BINS)
            self._compare(points, self.track.at(at), bins)
            if sent - self._measured_at < FRESH:
                self._doubt(points, at, bins)

    def trouble(self) -> str:
        """Return why the newest scan must not be used, or an empty text."""
        if self._equal:
            return "the scans have not changed by a bit although the robot moves: the LiDAR is frozen"
        if self._returns > 0.0 and self._last is not None and self._sent - self._light > DARK:
            return f"fewer than {self._returns:.0%} of the beams return anything: the LiDAR is covered, or the hall too large"
        if self._turned_by:
            return f"{_named(self._turned_by)}, and enable the robot again"
        return ""

    def _compare(self, points: NDArray[np.float64], motion: Motion, bins: int) -> None:
        """Vote on the mount by a scan's points, shape (2, n), if the robot has moved far enough since the last vote."""
        key = self._key
        if key is not None and motion.way - key[0].way < STEP and motion.turned - key[0].turned < LEAST_TURN:
            return
        self._key = motion, points
        if key is None or motion.turned - key[0].turned > WIDE or motion.way - key[0].way > 4.0 * STEP:
            return
        now = _binned(points, bins)
        shift, turn = into(key[0].pose, motion.pose)[:2], motion.pose[2] - key[0].pose[2]
        if math.hypot(*shift) < 0.5 * STEP and abs(turn) < 0.5 * LEAST_TURN:
            return
        mirrored = shift * (1.0, -1.0)
        ways = [
            (_turn(way[:, None], -0.5 * math.pi * k), angle)
            for way, angle in ((shift, turn), (mirrored, -turn))
            for k in range(4)
        ]
        ways.append((0.0 * shift[:, None], 0.0))
        fits = [_misfit(_binned(_turn(key[1] - way, -angle), bins), now) for way, angle in ways]
        if max(fits) == math.inf:
            return
        best = min(range(len(fits)), key=fits.__getitem__)
        if best and fits[best] < BETTER * fits[0]:
            self._votes.append(best)
        elif self._votes and fits[0] < fits[self._votes[-1]]:
            self._votes.clear()
        last = self._votes[-(STILL_VOTES if self._votes[-1:] == [STILL] else VOTES) :]
        if len(last) >= VOTES and len(set(last)) == 1 and (last[0] != STILL or len(last) == STILL_VOTES):
            self._turned_by = last[0]

    def _doubt(self, points: NDArray[np.float64], at: float, bins: int) -> None:
        """Add up by how much a scan's points, shape (2, n), fit the scan before better with an earlier motion."""
        before, self._before = self._before, (at, points)
        if before is None or at - before[0] > PAUSE:
            return
        motions = []
        for age in (*USUAL, *LATE):
            first, last = self._measured.at(before[0] - age), self._measured.at(at - age)
            motions.append((into(first.pose, last.pose)[:2], last.pose[2] - first.pose[2]))
        ways, turns = zip(*((math.hypot(*shift), abs(turn)) for shift, turn in motions), strict=True)
        if max(ways) < LEAST_WAY or max(turns) > STRAIGHT:
            return
        now = _binned(points, bins)
        fits = np.array([_misfit(_binned(_turn(before[1] - shift[:, None], -turn), bins), now) for shift, turn in motions])
        if np.isfinite(fits).all():
            usual, late = fits[: len(USUAL)].min(), fits[len(USUAL) :]
            clear = (late < BETTER * usual) | (late > usual)
            self._doubts = np.maximum(KEPT * self._doubts + clear * (usual - late), 0.0)
            if self._doubts.max() > DOUBT:
                self._turned_by = STILL


def _named(way: int) -> str:
    """Return what a way of seeing the motion says about the LiDAR."""
    if way == STILL:
        return "the scans do not move as the robot does: they are late, or another robot's: end their source"
    if way >= MIRRORED:
        return "the scans move as if left and right were exchanged: the LiDAR is upside down, or clockwise: correct its mount"
    return f"the scans move as if the LiDAR were mounted turned by {QUARTERS[way]}: correct its mount"


def _turn(points: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array(((cosine, -sine), (sine, cosine))) @ points


def _binned(points: NDArray[np.float64], bins: int) -> NDArray[np.float64]:
    """Return the shortest range of points in each of some directions, m; infinite where there is none."""
    nearest = np.full(bins, np.inf)
    at = np.round(np.arctan2(points[1], points[0]) * (bins / (2.0 * math.pi))).astype(int) % bins
    np.minimum.at(nearest, at, np.hypot(*points))
    return nearest


def _misfit(then: NDArray[np.float64], now: NDArray[np.float64]) -> float:
    """Return the mean difference of ranges, m; infinite with too few directions in common."""
    both = np.isfinite(then) & np.isfinite(now)
    if both.sum() < COMMON:
        return math.inf
    return float(np.minimum(np.abs(then[both] - now[both]), CAP).mean())
