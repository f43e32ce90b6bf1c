"""Whether a LiDAR measures at all, and looks where its mount says. Does not depend on ROS and takes steady times as arguments.

**Frozen.** A scan that repeats another to the bit while the robot has moved is no measurement: noise alone changes some of ten
ranges of 1 mm in each scan. A simulated LiDAR without noise repeats itself at rest, and along a corridor whose ends are out of
its sight. So motion counts, after all delays: a turn by `TURNED`, or `DRIVEN` with a return near the line of travel, which then
must change, or `DRIVEN_BLIND` without one. With a time to contact of 1 s the robot stops before it has driven to where the
frozen scan showed something: it then takes 0.02 m, one scan and the delays, 0.7 s at 0.2 m/s.

**Covered.** A scan with hardly a return for `DARK` s looks like a hall, and like a covered LiDAR. The robot stands.

**Motion.** Points of a scan, moved as the robot has moved since, must lie on the surfaces that the next one shows. If they fit
that scan clearly better with the motion turned by a quarter or half a turn, `VOTES` times in a row, the LiDAR is mounted so. If
they do with left and right exchanged, it is upside down or clockwise, which only turns show; if they do without any motion,
`STILL_VOTES` times, the scans are late or another robot's. A misfit is the distance from a surface, along which motion cannot
be seen: in a corridor whose ends are out of sight all ways of driving along it fit equally well. Walls fit in many ways, so one
comparison alone proves little. Other people move, wheels slip and rooms are symmetrical: all of these make the fits equally
bad, or equally good, and are no vote.

**Parts.** In a part of the LiDAR that stands still while the rest moves, points fit better without the motion. How much better
adds up over the comparisons, until they fit better with it. Somebody who walks beside the robot at its pace looks like that,
too: the part is believed again when the directions change that did not fit with the motion. Somebody who waits beside a robot
that stands changes nothing until the robot turns.

**Late.** Scans that are late by a second and hide it move as the robot has moved a second before. At constant speed nothing
shows that; where the robot starts or stops, two scans fit worse with its measured motion than with an earlier one. The
difference of the misfits adds up for each of several ages, up to `DOUBT`.

Whether beams that return nothing are to be believed, `silence` says.

A frozen or covered LiDAR counts again when its scans change; a wrong mount or late scans not until
`forget`, when a person enables the robot.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import TURN, Beams
from turtlebot_gym.motion import Motion, Track, into
from turtlebot_gym.silence import AT_LIMIT, Silence, place_of
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
MIRRORED, STILL, PART = 4, 8, 9
"""Numbers of the first way of seeing the motion mirrored, of seeing none, and of a part that sees none."""
JOINED = 0.3
"""Distance up to which neighbouring points are of one surface, m, or three times that of their directions, if larger."""
PARTS, LEAST_IN_PART = 16, 8
"""Number of parts of the circle, each two sixteenths wide, and least number of points that say something of one."""
AT_ONCE, AT_REST = 0.04, 0.2
"""Largest gain of a part without the motion that counts at once, m, and sum from which the part stands still."""
CHANGED = 0.4
"""Share of the directions in which such a part did not fit that must change before it is believed again."""
USUAL, LATE = (-0.15, 0.0, 0.15, 0.3), (0.6, 0.9, 1.2, 1.6)
"""Ages of scans, s, beyond half of the allowed delay: usual ones, and those of late scans."""
PAUSE, LEAST_WAY, STRAIGHT = 0.5, 0.02, 0.1
"""Longest time between two scans that are compared for their age, s; least way, m, and greatest turn meanwhile, rad."""
KEPT, DOUBT = 0.9, 0.015
"""Share of a doubt that each scan leaves, and doubt from which scans are late, m."""
FRESH = 0.3
"""Time for which a measured twist is in force, s."""
QUARTERS = {1: "90 degrees to the left", 2: "180 degrees", 3: "90 degrees to the right"}


_Misses = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Directions of points, as shares of a turn, and their distances from the surfaces there, m."""


class ScanWatch:
    """Judge a LiDAR by its scans and the robot's motion.

    Args:
        lag: Longest time from a command to its effect in a scan, s: wheels, one revolution, and the driver.
        returns: Least share of a scan's beams that return something; with 0, those that return nothing are believed.
        narrow: Angle up to which beams without a return hide nothing as wide as the robot, rad.
        now: Current steady time, s.
    """

    def __init__(self, *, lag: float, returns: float, narrow: float, now: float) -> None:
        self._lag, self._returns = lag, returns
        self._silence = Silence(narrow)
        self.track = Track(now)
        """The commands of the wheels, or the robot's twist: whoever watches adds each new one."""
        self._measured, self._measured_at = Track(now), -math.inf
        self._last: NDArray[np.float32] | None = None
        self._since, self._light = now, now
        self._equal = False
        self.forget()

    def forget(self) -> None:
        """Forget what was learned about the mount, and about beams without a return."""
        self._silence.forget()
        self._key: tuple[Motion, NDArray[np.float64]] | None = None
        self._votes: list[int] = []
        self._still = np.zeros(PARTS)
        self._before: tuple[float, NDArray[np.float64]] | None = None
        self._doubts = np.zeros(len(LATE))
        self._turned_by = 0

    def move(self, twist: Command, now: float) -> None:
        """Take a twist that the robot has measured, in force from now on; without any, late scans are not noticed."""
        if now > self._measured_at and math.isfinite(twist.v + twist.omega):
            self._measured.add(twist, now)
            self._measured_at = now

    def hear(
        self, beams: Beams, sent: float, *, mount: tuple[float, float, float] = (0.0, 0.0, 0.0), range_max: float = math.inf
    ) -> Beams:
        """Take a scan, and return it without the beams that say nothing, see `silence`.

        Args:
            beams: The scan.
            sent: Steady time at which it was sent, s.
            mount: Pose of the LiDAR in the robot's frame; m, m, rad.
            range_max: Its greatest range, m.

        Raises:
            ValueError: With one line, if none of its beams says anything.
        """
        ranges, directions = beams.ranges, beams.directions + mount[2]
        returned = np.isfinite(ranges)
        count = int(returned.sum())
        if int((ranges < AT_LIMIT * range_max).sum()) >= max(self._returns * len(ranges), 1.0):
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
        if count >= COMMON and (self._turned_by == PART or not (repeats or self._turned_by)):
            lengths, angles = ranges[returned].astype(np.float64), directions[returned]
            points = np.stack((lengths * np.cos(angles), lengths * np.sin(angles)))
            at, bins = sent - 0.5 * self._lag, min(len(ranges), BINS)
            if self._turned_by == PART:
                self._thaw(points, bins)
            else:
                self._compare(points, self.track.at(at), bins)
                if sent - self._measured_at < FRESH:
                    self._doubt(points, at, bins)
        if self._returns == 0.0:
            return beams
        latest, earliest = (place_of(self.track.at(time).pose, mount) for time in (sent, sent - self._lag))
        known = self._silence.hear(beams, range_max, (latest, earliest))
        if known is not beams and np.isnan(known.ranges).all():
            raise ValueError("what the scans have shown is gone all around: the LiDAR is covered")
        return known

    @property
    def covered(self) -> float:
        """Angle over which the LiDAR is covered, rad, see `silence`: those beams say nothing."""
        return self._silence.covered

    @property
    def frozen(self) -> float:
        """Angle of a part that does not move as the robot does, rad: the LiDAR is frozen there, or somebody walks beside."""
        return 2.0 * TURN / PARTS if self._turned_by == PART else 0.0

    def trouble(self) -> str:
        """Return why the newest scan must not be used, or an empty text."""
        if self._equal:
            return "the scans have not changed by a bit although the robot moves: the LiDAR is frozen"
        if self._returns > 0.0 and self._last is not None and self._sent - self._light > DARK:
            return f"fewer than {self._returns:.0%} of the beams return anything: the LiDAR is covered, or the hall too large"
        if self._turned_by == PART:
            return "a part of the scans does not move as the robot does: the LiDAR is frozen there"
        return f"{_named(self._turned_by)}, and enable the robot again" if self._turned_by else ""

    def _compare(self, points: NDArray[np.float64], motion: Motion, bins: int) -> None:
        """Vote on the mount by a scan's points, shape (2, n), if the robot has moved far enough since the last vote."""
        key = self._key
        if key is not None and motion.way - key[0].way < STEP and motion.turned - key[0].turned < LEAST_TURN:
            return
        self._key = motion, points
        if key is None or motion.turned - key[0].turned > WIDE or motion.way - key[0].way > 4.0 * STEP:
            return
        now = _surface(points, bins)
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
        misses = [_misses(_turn(key[1] - way, -angle), now) for way, angle in ways]
        if abs(turn) < LEAST_TURN:
            self._watch_parts(misses[0], misses[-1], now)
        fits = [_mean(miss) for miss in misses]
        if max(fits) == math.inf:
            return
        best = min(range(len(fits)), key=fits.__getitem__)
        if best == MIRRORED and abs(turn) < STRAIGHT:
            return  # slip turns the robot by as much
        if best and fits[best] < BETTER * fits[0]:
            self._votes.append(best)
        elif self._votes and fits[0] < fits[self._votes[-1]]:
            self._votes.clear()
        last = self._votes[-(STILL_VOTES if self._votes[-1:] == [STILL] else VOTES) :]
        if len(last) >= VOTES and len(set(last)) == 1 and (last[0] != STILL or len(last) == STILL_VOTES):
            self._turned_by = last[0]

    def _watch_parts(self, moved: _Misses, still: _Misses, now: NDArray[np.float64]) -> None:
        """Add up by how much the points of each part fit better without the motion."""
        (here, there), (few, less) = zip(*(_by_part(miss) for miss in (moved, still)), strict=True)
        both = (np.minimum(few, less) >= LEAST_IN_PART) & (np.maximum(here, there) > 0.0)
        rests = both & (there < BETTER * here)
        self._still = np.where(rests, self._still + np.minimum(here - there, AT_ONCE), self._still)
        self._still[both & (here < there)] = 0.0
        if self._still.max() > AT_REST:
            self._turned_by, part = PART, int(self._still.argmax())
            at, away = moved
            telling = at[(away > 0.5 * here[part]) & np.isin(((at * PARTS).astype(int) - part) % PARTS, (0, 1))]
            bins = now.shape[1]
            self._frozen = np.hypot(now[0], now[1]), np.isin(np.arange(bins), np.round(telling * bins) % bins)

    def _thaw(self, points: NDArray[np.float64], bins: int) -> None:
        """Believe a part again where points, shape (2, n), change: somebody walked beside the robot, or it measures again."""
        then, telling = self._frozen
        if len(then) != bins:
            return
        now = np.hypot(*_surface(points, bins)[:2])[telling]
        changed = ~(np.abs(now - then[telling]) < CAP) & ~(np.isnan(now) & np.isnan(then[telling]))
        if changed.mean() > CHANGED:
            self._turned_by, self._still = 0, np.zeros(PARTS)

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
        now = _surface(points, bins)
        fits = np.array([_mean(_misses(_turn(before[1] - shift[:, None], -turn), now)) for shift, turn in motions])
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


def _surface(points: NDArray[np.float64], bins: int) -> NDArray[np.float64]:
    """Return the nearest point in each of some directions, and the normal of the surface there, shape (4, bins), or NaN."""
    at = np.round(np.arctan2(points[1], points[0]) * (bins / (2.0 * math.pi))).astype(int) % bins
    order = np.argsort(-np.hypot(*points))
    nearest = np.full((2, bins), np.nan)
    nearest[:, at[order]] = points[:, order]
    reach = max(round(bins / 90), 1)
    right, left = np.roll(nearest, reach, axis=1), np.roll(nearest, -reach, axis=1)
    along = left - right
    length = np.hypot(*along)
    apart = np.maximum(JOINED, 3.0 * (2.0 * math.pi / bins) * np.hypot(*nearest))
    joined = (np.hypot(*(left - nearest)) < apart) & (np.hypot(*(nearest - right)) < apart)
    normal = np.where(joined, np.stack((-along[1], along[0])) / np.maximum(length, 1e-9), np.nan)
    return np.concatenate((nearest, normal))


def _misses(then: NDArray[np.float64], now: NDArray[np.float64]) -> _Misses:
    """Return how far points, shape (2, n), are from a `_surface`, where there is one."""
    bins = now.shape[1]
    at = np.round(np.arctan2(then[1], then[0]) * (bins / (2.0 * math.pi))).astype(int) % bins
    dx, dy = then - now[:2, at]
    away = np.abs(dx * now[2, at] + dy * now[3, at])
    seen = np.isfinite(away)
    return at[seen] / bins, np.minimum(away[seen], CAP)


def _mean(misses: _Misses) -> float:
    """Return the mean distance, m; infinite with too few points."""
    return float(misses[1].mean()) if len(misses[1]) >= COMMON else math.inf


def _by_part(misses: _Misses) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the mean distance and the number of points in each part, two slices wide."""
    slices = (misses[0] * PARTS).astype(int) % PARTS
    sums, numbers = np.bincount(slices, misses[1], PARTS), np.bincount(slices, minlength=PARTS)
    sums, numbers = sums + np.roll(sums, -1), numbers + np.roll(numbers, -1)
    return sums / np.maximum(numbers, 1), numbers
