"""Run the localizer over a recording: odometry and scans row by row, in a known map."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.compiled.program import in_machine_code
from turtlebot_gym.localization.bank import COLUMNS, ROWS
from turtlebot_gym.localization.hypotheses import correct_by_scan, nowhere
from turtlebot_gym.localization.localizer import TRACKING, locate, move, state_of
from turtlebot_gym.localization.points import Timing, directions, remember, rest
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.rooms.scene import LocalizerMemory
from turtlebot_gym.values import Command, Pose

TRAIL = 64
"""Number of odometry poses that reach back to the first beam of a scan."""
FAR = 20.0
"""Greatest range that is used, m: an error of the heading moves the end of a longer beam by more than a cell of the map."""
STILL, UNTURNED = 0.02, 0.01
"""Distance and turn since the last used scan, m and rad, up to which a scan says nothing new and is left out ..."""
STALE = 6
"""... unless so many before it were left out, or the place is in doubt."""
KNOWN = (0.01, 0.01, 0.001)
"""Variances of a start that is a true pose; m^2, m^2, rad^2."""


class RecordedScans(NamedTuple):
    """Inputs of a localizer from a recording of T rows and S scans."""

    time: NDArray[np.float64]
    """Shape (T,), s; if it does not increase, scans count as instantaneous, at their rows."""
    odometry: NDArray[np.float64]
    """Shape (T, 3); m, m, rad."""
    rows: NDArray[np.int64]
    """Row at which each scan arrives, shape (S,), ascending."""
    last: NDArray[np.float64]
    """Time of each scan's last beam, shape (S,), s; not after its row."""
    ranges: NDArray[np.float32]
    """Shape (S, B), m; beams without a measurement are NaN, infinite or not in (0, `range_max`]."""
    angles: NDArray[np.float64]
    """Directions of the beams in the robot's frame, shape (B,), rad; shape (S, B) where they differ from scan to scan."""
    interval: float = 0.0
    """Time between two beams, s; 0 if all were measured at once."""
    mount: tuple[float, float] = (0.0, 0.0)
    """Position of the LiDAR on the robot, m."""
    range_max: float = FAR
    """Greatest range that is used, m."""


class KnownPlace(NamedTuple):
    """A map, and where in it a drive starts."""

    field: NDArray[np.float32]
    """Distances to the surfaces of the map, see `rooms.field`."""
    frame: NDArray[np.float64]
    """Frame of the distances."""
    tuning: LocalizerTuning
    start: Pose | None
    """The pose at the first row; None if it is unknown."""
    R: tuple[float, float, float] = (0.02, 0.02, 0.02)
    """Variances of that pose; m^2, m^2, rad^2."""
    first: int = 0
    """The first row; rows and scans before it are left out."""


class RecordedCourse(NamedTuple):
    """Beliefs at each row of a recording."""

    poses: NDArray[np.float64]
    """Shape (T, 3); m, m, rad."""
    covariances: NDArray[np.float64]
    """Shape (T, 3, 3)."""
    fits: NDArray[np.float64]
    """Share of the beams of the newest scan that fit, shape (T,)."""
    states: NDArray[np.int64]
    """`localizer.TRACKING`, `UNSURE` or `LOST`, shape (T,)."""
    scans: int
    """Number of scans used."""
    scale: float
    """Share by which ranges are too long, at the end."""


@in_machine_code("localizer of recordings")
def _follow(
    time: Any,
    odometry: Any,
    rows: Any,
    last: Any,
    ranges: Any,
    beams: Any,
    timing: Any,
    field: Any,
    frame: Any,
    q: Any,
    located: Any,
    first: int,
    course: Any,
    states: Any,
) -> Any:
    """Write the belief at each row from ``first`` on, shape (T, 11): pose, covariance, share of fitting beams."""
    trail = np.empty((TRAIL, 4))
    memory = LocalizerMemory(field, frame, trail, np.zeros((ROWS, COLUMNS)))
    now = Pose(odometry[first, 0], odometry[first, 1], odometry[first, 2])
    rest(trail, time[first], now)
    at = 0
    while at < len(rows) and rows[at] < first:
        at += 1
    way, turn, left_out = 1.0, 0.0, 0  # as if the robot had driven far, so that the first scan is used
    for row in range(first, len(odometry)):
        if row > first:
            before, now = now, Pose(odometry[row, 0], odometry[row, 1], odometry[row, 2])
            dt = max(time[row] - time[row - 1], 0.0)
            located = move(located, before, now, Command(0.0, 0.0), (0.0, 0.0), dt, q)
            remember(trail, time[row], now)
            way += math.hypot(now.x - before.x, now.y - before.y)
            turn += abs(wrap(now.theta - before.theta))
        while at < len(rows) and rows[at] <= row:
            is_due = left_out == STALE or state_of(located, q) != TRACKING
            if way > STILL or turn > UNTURNED or is_due:
                when = Timing(last[at], timing.interval, timing.x, timing.y, timing.range_max)
                located = correct_by_scan(located, ranges[at], beams[at], when, memory, q)
                way, turn, left_out = 0.0, 0.0, 0
            else:
                located, left_out = located._replace(silent=0.0), left_out + 1  # it would say the same again
            at += 1
        mean, P = located.belief
        course[row, 0], course[row, 1], course[row, 2] = mean.x, mean.y, mean.theta
        course[row, 3], course[row, 4], course[row, 5] = P.xx, P.xy, P.xt
        course[row, 6], course[row, 7], course[row, 8] = P.yy, P.yt, P.tt
        course[row, 9] = located.fits
        states[row] = state_of(located, q)
    return located


def localize(recorded: RecordedScans, place: KnownPlace) -> RecordedCourse:
    """Return the beliefs of a localizer that sees a recording; those before the place's first row are NaN."""
    recorded = clocked(recorded)
    time = recorded.time
    q: Any = as_tuple(place.tuning)
    course, states = np.full((len(time), 10), np.nan), np.zeros(len(time), np.int64)
    timing = Timing(0.0, recorded.interval, *recorded.mount, recorded.range_max)
    located = _follow(
        time,
        recorded.odometry,
        recorded.rows,
        recorded.last,
        recorded.ranges,
        beams_of(recorded),
        timing,
        place.field,
        place.frame,
        q,
        nowhere(q) if place.start is None else locate(place.start, place.R, q),
        place.first,
        course,
        states,
    )
    a, b, c, d, e, f = course[:, 3:9].T
    covariances = np.stack((a, b, c, b, d, e, c, e, f), axis=1).reshape(-1, 3, 3)
    return RecordedCourse(course[:, :3], covariances, course[:, 9], states, int(located.scans), float(located.scale.mean))


def beams_of(recorded: RecordedScans) -> NDArray[np.float64]:
    """Return the cosine and sine of the beams of each scan, shape (S, 2, B)."""
    turned = directions(recorded.angles)
    return np.broadcast_to(turned, (len(recorded.rows), *turned.shape)) if turned.ndim == 2 else np.moveaxis(turned, 0, 1)


def clocked(recorded: RecordedScans) -> RecordedScans:
    """Return a recording whose time increases: if stamps do not, rows count as regular."""
    rows = recorded.rows.astype(np.int64)
    if (np.diff(recorded.time) > 0.0).all():
        return recorded._replace(rows=rows)
    usual = np.median(np.diff(np.unique(recorded.time))) if len(np.unique(recorded.time)) > 1 else 1.0
    time = usual * np.arange(len(recorded.odometry))
    return recorded._replace(time=time, rows=rows, last=time[rows], interval=0.0)
