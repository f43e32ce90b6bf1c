"""Whether a LiDAR measures at all, and looks where its mount says. Does not depend on ROS and takes steady times as arguments.

**Frozen.** A scan that repeats another to the bit while the robot has moved is no measurement: noise alone changes some of ten
ranges of 1 mm in each scan. A simulated LiDAR without noise repeats itself at rest, and along a corridor whose ends are out of
its sight. So motion counts, after all delays: a turn by `TURNED`, or `DRIVEN` with a return near the line of travel, which then
must change, or `DRIVEN_BLIND` without one. At 0.2 m/s that takes 0.7 s with one scan and the delays.

**Covered.** A scan with hardly a return for `DARK` s looks like a hall, and like a covered LiDAR. The robot stands. About other
beams that return nothing see `silence`.

**Motion.** Points of a scan, moved as the robot has moved since, must lie on the surfaces that the next one shows. If they fit
clearly better with the motion turned by a quarter or half a turn, `VOTES` times in a row, the LiDAR is mounted so. If they do
with left and right exchanged, it is upside down or clockwise, which only turns show; if they do without any motion,
`STILL_VOTES` times, the scans are late or another robot's. Fits that are equally bad or good, as with people who move, wheels
that slip, symmetrical rooms and along a corridor whose ends are out of sight, are no vote.

**Parts.** In a part of the LiDAR that stands still while the rest moves, points fit better without the motion. How much better
adds up over the comparisons. Somebody who walks beside the robot at its pace looks like that, too: the part is believed again
when the directions change that did not fit with the motion.

**Late.** Where a robot starts or stops, two scans that are late and hide it fit worse with its measured motion than with an
earlier one. The difference of the misfits adds up for each of several ages, up to `DOUBT`.

A frozen or covered LiDAR counts again when its scans change; a wrong mount or late scans not until `forget`, when a person
enables the robot.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import TURN, Beams
from turtlebot_gym.motion import Motion, Track
from turtlebot_gym.silence import AT_LIMIT, Mount, Silence, place_of
from turtlebot_gym.values import ORIGIN, Command

LEAST_RETURNS = 10  # number of returns from which equal scans mean something: noise leaves ten ranges equal once in 1e10 scans
TURNED, DRIVEN, DRIVEN_BLIND = 0.02, 0.02, 0.3  # motion after which a scan must have changed, rad and m
NEAR_LINE, DARK = math.radians(15.0), 0.5
"""Angle from the line of travel within which a return must change by nearly the whole way; time without enough returns after
which a LiDAR counts as covered, s."""
STEP, LEAST_TURN, WIDE = 0.06, 0.3, 1.0
"""Way between two scans that are compared for the mount, m; turn between two without a way, and the largest turn, rad."""
BINS, COMMON = 180, 15  # most directions in which two scans are compared, and least number of those with returns in both
CAP, BETTER = 0.15, 0.6
"""Largest misfit that counts, m: a larger one is an edge, or somebody who walks; and share of the mount's own misfit below
which another mount fits clearly better."""
VOTES, STILL_VOTES = 3, 4  # comparisons in a row that refuse a mount, or scans that do not move: a slow robot starts late
MIRRORED, STILL = 4, 8  # ways of seeing the motion: turned by quarters, from this one on mirrored, and not at all
WAYS = {
    1: "move as if the LiDAR were mounted turned by 90 degrees to the left: correct its mount",
    2: "move as if the LiDAR were mounted turned by 180 degrees: correct its mount",
    3: "move as if the LiDAR were mounted turned by 90 degrees to the right: correct its mount",
    STILL: "do not move as the robot does: they are late, or another robot's: end their source",
}
EXCHANGED = "move as if left and right were exchanged: the LiDAR is upside down, or clockwise: correct its mount"
JOINED = 0.3  # distance up to which neighbouring points are of one surface, m, or three times that of their directions
PARTS, LEAST_IN_PART = 16, 8  # parts of the circle, each two sixteenths wide, and least number of points that tell of one
AT_ONCE, AT_REST, CHANGED = 0.04, 0.2, 0.4
"""Largest gain of a part without the motion that counts at once, m; sum from which the part stands still; and share of the
directions in which such a part did not fit that must change before it is believed again."""
USUAL, LATE = (-0.15, 0.0, 0.15, 0.3), (0.6, 0.9, 1.2, 1.6)
"""Ages of scans, s, beyond half of the allowed delay: usual ones, and those of late scans."""
PAUSE, LEAST_WAY, STRAIGHT = 0.5, 0.02, 0.1
"""Longest time between two scans that are compared for their age, s; least way, m, and greatest turn meanwhile, rad."""
KEPT, DOUBT, FRESH = 0.9, 0.015, 0.3
"""Share of a doubt that each scan leaves; doubt from which scans are late, m; time in which a measured twist is in force, s."""

_Points = NDArray[np.complex128]  # in the robot's frame, m
_Surface = tuple[_Points, _Points]  # the nearest point in each of some directions, and the normal there; NaN for none
_Misses = tuple[NDArray[np.float64], NDArray[np.float64]]  # directions, as shares of a turn, and distances from a surface, m


class ScanWatch:
    """Judge a LiDAR by its scans and the robot's motion, from the steady time ``now`` on, s.

    Args:
        lag: Longest time from a command to its effect in a scan, s: wheels, one revolution, and the driver.
        returns: Least share of a scan's beams that return something; with 0, those that return nothing are believed.
        narrow: Angle up to which beams without a return hide nothing as wide as the robot, rad.
    """

    def __init__(self, *, lag: float, returns: float, narrow: float, now: float) -> None:
        self._lag, self._returns, self._silence = lag, returns, Silence(narrow)
        self.track = Track(now)
        """The commands of the wheels, or the robot's twist: whoever watches adds each new one."""
        self._measured, self._measured_at = Track(now), -math.inf
        self._last: NDArray[np.float32] | None = None
        self._sent = self._since = self._light = now
        self._equal = False
        self.forget()

    def forget(self) -> None:
        """Forget what was learned about the mount, and about beams without a return."""
        self._silence.forget()
        self._key: tuple[Motion, _Points] | None = None
        self._before: tuple[float, _Points] | None = None
        self._votes: list[int] = []
        self._still, self._doubts, self._wrong = np.zeros(PARTS), np.zeros(len(LATE)), ""
        self._frozen: tuple[_Points, NDArray[np.bool_]] | None = None

    def move(self, twist: Command, now: float) -> None:
        """Take a twist that the robot has measured, in force from now on; without any, late scans are not noticed."""
        if now > self._measured_at and math.isfinite(twist.v + twist.omega):
            self._measured.add(twist, now)
            self._measured_at = now

    def hear(self, beams: Beams, sent: float, *, mount: Mount = ORIGIN, range_max: float = math.inf) -> Beams:
        """Take a scan, sent at a steady time, s, and return it without the beams that say nothing, see `silence`.

        ``mount`` is the LiDAR's pose in the robot's frame. A ``ValueError`` refuses a scan of which no beam says anything.
        """
        ranges, returned = beams.ranges, np.isfinite(beams.ranges)
        directions, count = beams.directions[returned] + mount[2], int(returned.sum())
        if int((ranges < AT_LIMIT * range_max).sum()) >= max(self._returns * len(ranges), 1.0):
            self._light = sent
        repeats = self._last is not None and np.array_equal(self._last, ranges, equal_nan=True)
        self._last, self._sent = ranges, sent
        if not repeats or count < LEAST_RETURNS:
            self._since, self._equal, self._at_first = sent, False, self.track.at(sent)
        else:
            before, after = self._at_first, self.track.at(max(sent - self._lag, self._since))
            near = np.abs(np.sin(directions)) < math.sin(NEAR_LINE)
            least = DRIVEN if near.any() else DRIVEN_BLIND
            self._equal = after.turned - before.turned >= TURNED or after.way - before.way >= least
        points = np.asarray(np.exp(1j * directions) * ranges[returned], np.complex128)
        at, bins = sent - 0.5 * self._lag, min(len(ranges), BINS)
        if count >= COMMON and self._frozen:
            self._thaw(self._frozen, points, bins)
        elif count >= COMMON and not (repeats or self._wrong):
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
    def frozen(self) -> bool:
        """Whether a part does not move as the robot does: the LiDAR is frozen there, or somebody walks beside."""
        return self._frozen is not None

    def trouble(self) -> str:
        """Return why the newest scan must not be used, or an empty text."""
        if self._equal:
            return "the scans have not changed by a bit although the robot moves: the LiDAR is frozen"
        if self._returns > 0.0 and self._sent - self._light > DARK:
            return f"fewer than {self._returns:.0%} of the beams return anything: the LiDAR is covered, or the hall too large"
        if self._frozen:
            return "a part of the scans does not move as the robot does: the LiDAR is frozen there"
        return self._wrong and f"the scans {self._wrong}, and enable the robot again"

    def _compare(self, points: _Points, motion: Motion, bins: int) -> None:
        """Vote on the mount by a scan's points, if the robot has moved far enough since the last vote."""
        key = self._key
        if key is not None and motion.way - key[0].way < STEP and motion.turned - key[0].turned < LEAST_TURN:
            return
        self._key = motion, points
        if key is None or motion.turned - key[0].turned > WIDE or motion.way - key[0].way > 4.0 * STEP:
            return
        shift, turn = _between(key[0], motion)
        if abs(shift) < 0.5 * STEP and abs(turn) < 0.5 * LEAST_TURN:
            return
        now, seen = _surface(points, bins), ((shift, turn), (shift.conjugate(), -turn))
        ways = [(way * quarter, angle) for way, angle in seen for quarter in (1, -1j, -1, 1j)]
        misses = [_misses(key[1], way, angle, now) for way, angle in (*ways, (0j, 0.0))]
        if abs(turn) < LEAST_TURN:
            self._watch_parts(misses[0], misses[-1], now)
        fits = [_mean(miss) for miss in misses]
        best = min(range(len(fits)), key=fits.__getitem__)
        if max(fits) == math.inf or (best == MIRRORED and abs(turn) < STRAIGHT):  # slip turns the robot by as much
            return
        if best and fits[best] < BETTER * fits[0]:
            self._votes.append(best)
        elif self._votes and fits[0] < fits[self._votes[-1]]:
            self._votes.clear()
        needed = STILL_VOTES if self._votes[-1:] == [STILL] else VOTES
        if len(self._votes) >= needed and len(set(self._votes[-needed:])) == 1:
            self._wrong, self._frozen = WAYS.get(self._votes[-1], EXCHANGED), None

    def _watch_parts(self, moved: _Misses, still: _Misses, now: _Surface) -> None:
        """Add up by how much the points of each part fit better without the motion."""
        (here, few), (there, less) = _by_part(moved), _by_part(still)
        both = (np.minimum(few, less) >= LEAST_IN_PART) & (np.maximum(here, there) > 0.0)
        self._still += (both & (there < BETTER * here)) * np.minimum(here - there, AT_ONCE)
        self._still[both & (here < there)] = 0.0
        if self._still.max() > AT_REST:
            (at, away), bins, part = moved, len(now[0]), int(self._still.argmax())
            telling = at[(away > 0.5 * here[part]) & np.isin(((at * PARTS).astype(int) - part) % PARTS, (0, 1))]
            self._frozen = now[0], np.isin(np.arange(bins), np.round(telling * bins) % bins)

    def _thaw(self, frozen: tuple[_Points, NDArray[np.bool_]], points: _Points, bins: int) -> None:
        """Believe a part again where points change: somebody walked beside the robot, or it measures again."""
        then, telling = frozen
        if len(then) == bins:
            now, then = abs(_surface(points, bins)[0][telling]), abs(then[telling])
            changed = ~(np.abs(now - then) < CAP) & ~(np.isnan(now) & np.isnan(then))
            if changed.mean() > CHANGED:
                self._frozen, self._still = None, np.zeros(PARTS)

    def _doubt(self, points: _Points, at: float, bins: int) -> None:
        """Add up by how much a scan's points fit the scan before better with an earlier motion."""
        before, self._before = self._before, (at, points)
        if before is None or at - before[0] > PAUSE:
            return
        track = self._measured
        motions = [_between(track.at(before[0] - age), track.at(at - age)) for age in (*USUAL, *LATE)]
        if max(abs(way) for way, _ in motions) < LEAST_WAY or max(abs(turn) for _, turn in motions) > STRAIGHT:
            return
        now = _surface(points, bins)
        fits = np.array([_mean(_misses(before[1], way, turn, now)) for way, turn in motions])
        if np.isfinite(fits).all():
            usual, late = fits[: len(USUAL)].min(), fits[len(USUAL) :]
            clear = (late < BETTER * usual) | (late > usual)
            self._doubts = np.maximum(KEPT * self._doubts + clear * (usual - late), 0.0)
            if self._doubts.max() > DOUBT:
                self._wrong, self._frozen = WAYS[STILL], None


def _between(first: Motion, last: Motion) -> tuple[complex, float]:
    """Return the way between two motions, in the frame of the first pose, m, and the turn, rad."""
    way = complex(last.pose[0] - first.pose[0], last.pose[1] - first.pose[1])
    return way * cmath.rect(1.0, -first.pose[2]), last.pose[2] - first.pose[2]


def _direction(points: _Points, bins: int) -> NDArray[np.int64]:
    return np.round(np.angle(points) * (bins / TURN)).astype(np.int64) % bins


def _surface(points: _Points, bins: int) -> _Surface:
    """Return the surface that points show in each of some directions."""
    order = np.argsort(-abs(points))
    nearest = np.full(bins, np.nan, np.complex128)
    nearest[_direction(points, bins)[order]] = points[order]
    reach = max(round(bins / 90), 1)
    right, left = np.roll(nearest, reach), np.roll(nearest, -reach)
    apart = np.maximum(JOINED, 3.0 * (TURN / bins) * abs(nearest))
    joined = (abs(left - nearest) < apart) & (abs(nearest - right) < apart)
    normal, along = np.full(bins, np.nan, np.complex128), (left - right)[joined]
    normal[joined] = 1j * along / np.maximum(abs(along), 1e-9)
    return nearest, normal


def _misses(points: _Points, way: complex, turn: float, now: _Surface) -> _Misses:
    """Return how far points are from a surface after a motion, where there is one."""
    nearest, normal = now
    moved = (points - way) * cmath.rect(1.0, -turn)
    at = _direction(moved, len(nearest))
    away = np.abs(((moved - nearest[at]) * normal[at].conj()).real)
    seen = np.isfinite(away)
    return at[seen] / len(nearest), np.minimum(away[seen], CAP)


def _mean(misses: _Misses) -> float:
    """Return the mean distance, m; infinite with too few points."""
    return float(misses[1].mean()) if len(misses[1]) >= COMMON else math.inf


def _by_part(misses: _Misses) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the mean distance and the number of points in each part, two slices wide."""
    slices = (misses[0] * PARTS).astype(int) % PARTS
    sums, numbers = np.bincount(slices, misses[1], PARTS), np.bincount(slices, minlength=PARTS)
    sums, numbers = sums + np.roll(sums, -1), numbers + np.roll(numbers, -1)
    return sums / np.maximum(numbers, 1), numbers
