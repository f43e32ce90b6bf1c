"""Pairs of scans, and how the robot moved from one to the other, by the scans alone.

A key scan is matched with those after it, each from where the one before it was found, until the robot has moved far enough;
the last one is the next key scan. So pairs follow each other without a gap, and the error of one is its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.localization.points import Timing, remember, rest, to_points
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.values import ORIGIN, Pose
from turtlebot_gym_lab.evaluation.localize import TRAIL, RecordedScans, beams_of
from turtlebot_gym_lab.scans.matching import lines_of, match, match_both

POINTS = 360
"""Most points of a scan that are matched ..."""
TRACKED = 90
"""... and while the robot has not yet moved far enough."""
WAY, TURN = 0.2, 0.4
"""Distance and turn between the scans of a pair, m and rad."""
FITS = 0.7
"""Least share of a scan's points that must fit."""
SHARP = 0.05
"""Turn between two scans from which the opposite turn is tried, too, rad."""


class Pairs(NamedTuple):
    """The motions of a robot between the n pairs of scans."""

    first: NDArray[np.int64]
    """Numbers of the scans, shape (n,)."""
    second: NDArray[np.int64]
    motion: NDArray[np.float64]
    """Pose at the second scan's row in the frame of the first one's, shape (n, 3); m, m, rad."""
    information: NDArray[np.float64]
    """Shape (n, 3, 3); 1/m^2, 1/m, 1/rad^2."""
    fits: NDArray[np.float64]
    """Share of points that fit, shape (n,)."""
    scans: int
    """Number of scans that were matched."""
    lost: int
    """Number of scans that fit no key scan."""


@in_machine_code("points of recorded scans")
def _points(
    time: Any, odometry: Any, rows: Any, last: Any, ranges: Any, beams: Any, timing: Any, points: Any, counts: Any
) -> None:
    trail, k = np.empty((TRAIL, 4)), 0
    rest(trail, time[0], Pose(odometry[0, 0], odometry[0, 1], odometry[0, 2]))
    for row in range(len(odometry)):
        if row > 0:
            remember(trail, time[row], Pose(odometry[row, 0], odometry[row, 1], odometry[row, 2]))
        while k < len(rows) and rows[k] <= row:
            when = Timing(last[k], timing.interval, timing.x, timing.y, timing.range_max)
            counts[k] = to_points(ranges[k], beams[k], 0, when, trail, points[k])
            k += 1


def points_of(
    recorded: RecordedScans, odometry: NDArray[np.floating[Any]], most: int = POINTS
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the points of each scan in the robot's frame at its row, shape (S, 5, most), and their numbers, shape (S,).

    Args:
        recorded: The scans.
        odometry: By which a scan's beams are aligned, shape (T, 3); m, m, rad.
        most: Most points of a scan.
    """
    number = len(recorded.rows)
    shape = (number, 5, min(most, recorded.ranges.shape[1]))
    points, counts = np.zeros(shape, np.float32), np.zeros(number, np.int64)
    timing = Timing(0.0, recorded.interval, *recorded.mount, recorded.range_max)
    beams = beams_of(recorded)
    _points(recorded.time, odometry, recorded.rows, recorded.last, recorded.ranges, beams, timing, points, counts)
    return points, counts


@in_machine_code("pairs of scans")
def _track(
    points: Any,
    counts: Any,
    odometry: Any,
    rows: Any,
    spacing: float,
    is_placed: bool,
    pairs: Any,
    motion: Any,
    info: Any,
    fits: Any,
) -> Any:
    """Write pairs of scans, their motions, information and shares; return the numbers of pairs and of scans that fit none."""
    most = points.shape[2]
    lines, few, matrix, scratch = np.zeros((6, most)), np.zeros((5, TRACKED)), np.zeros((3, 3)), np.zeros((4, 6, most))
    key, n, lost, before, at, share = 0, 0, 0, 0, ORIGIN, 1.0
    lines_of(points[0], counts[0], spacing, lines)
    k = 1
    while k < len(points):
        a, b = rows[before], rows[k]
        was, now = Pose(odometry[a, 0], odometry[a, 1], odometry[a, 2]), Pose(odometry[b, 0], odometry[b, 1], odometry[b, 2])
        by = increment(ORIGIN, was, now, sincos(-was.theta))
        turn, best, end = wrap(by.theta), -1.0, at
        used = min(counts[k], TRACKED)
        for i in range(used):
            for row in range(5):
                few[row, i] = points[k, row, i * counts[k] // used]
        for way in range(1 if is_placed or abs(turn) < SHARP else 2):
            step = Pose(by.x, by.y, turn) if is_placed else Pose(0.0, 0.0, turn if way == 0 else -turn)
            start = increment(at, ORIGIN, step, sincos(at.theta))
            found, value = match(points[key], lines, counts[key], few, used, start, matrix)
            if value > best:
                best, end = value, found
        if best >= FITS:
            at, before, share = end, k, best
        is_far = at.x * at.x + at.y * at.y > WAY * WAY or abs(at.theta) > TURN
        if (best < FITS or is_far) and before > key:
            motion_of, share = match_both(
                points[key], counts[key], points[before], counts[before], spacing, at, scratch, info[n]
            )
            motion[n, 0], motion[n, 1], motion[n, 2] = motion_of.x, motion_of.y, motion_of.theta
            pairs[n, 0], pairs[n, 1], fits[n] = key, before, share
            n += 1 if share >= FITS else 0
        elif best < FITS:
            before = k
            lost += 1
        if best < FITS or is_far:
            key, at = before, ORIGIN
            lines_of(points[key], counts[key], spacing, lines)
        k = before + 1
    return n, lost


def paired(recorded: RecordedScans, odometry: NDArray[np.floating[Any]], *, is_placed: bool) -> Pairs:
    """Return pairs of scans.

    Args:
        recorded: The scans.
        odometry: By which a scan's beams are aligned, and the next scan is expected, shape (T, 3); m, m, rad.
        is_placed: Whether the LiDAR's mount is known: if not, only the size of a turn is expected.
    """
    points, counts = points_of(recorded, odometry)
    number = len(points)
    pairs, motion, information = np.zeros((number, 2), np.int64), np.zeros((number, 3)), np.zeros((number, 3, 3))
    fits, spacing = np.zeros(number), float(np.abs(np.diff(recorded.angles, axis=-1)).mean())
    spacing *= recorded.ranges.shape[1] / points.shape[2]
    n, lost = _track(points, counts, odometry, recorded.rows, spacing, is_placed, pairs, motion, information, fits)
    return Pairs(pairs[:n, 0], pairs[:n, 1], motion[:n], information[:n], fits[:n], number, lost)
