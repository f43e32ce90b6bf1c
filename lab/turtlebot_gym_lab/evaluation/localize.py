"""Run the localizer over a recording: odometry and scans row by row, in a known map."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.drive import Drive, heading_error, known, position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.localization.bank import COLUMNS, ROWS
from turtlebot_gym.localization.hypotheses import correct_by_scan, nowhere
from turtlebot_gym.localization.localizer import LEAP, LOST, TRACKING, UNSURE, locate, move, state_of, stay
from turtlebot_gym.localization.points import Timing, directions, remember, rest
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import wrap, wrap_all
from turtlebot_gym.values import Command, Pose
from turtlebot_gym_agents.evaluation.episodes import ASTRAY
from turtlebot_gym_lab.drives.clocks import said
from turtlebot_gym_lab.drives.topics import ELSEWHERE

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
    trail, bank = np.empty((TRAIL, 4)), np.zeros((ROWS, COLUMNS))
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
            way += np.hypot(now.x - before.x, now.y - before.y)
            turn += abs(wrap(now.theta - before.theta))
        while at < len(rows) and rows[at] <= row:
            is_due = left_out == STALE or state_of(located, q) != TRACKING
            if way > STILL or turn > UNTURNED or is_due:
                when = Timing(last[at], timing.interval, timing.x, timing.y, timing.range_max)
                located = correct_by_scan(located, ranges[at], beams[at], when, trail, bank, field, frame, q)
                way, turn, left_out = 0.0, 0.0, 0
            else:
                located, left_out = stay(located), left_out + 1
            at += 1
        mean, P = located.belief
        course[row, 0], course[row, 1], course[row, 2] = mean.x, mean.y, mean.theta
        course[row, 3], course[row, 4], course[row, 5] = P.xx, P.xy, P.xt
        course[row, 6], course[row, 7], course[row, 8] = P.yy, P.yt, P.tt
        course[row, 9] = located.fits
        states[row] = state_of(located, q)
    return located


STATES = {"tracking": TRACKING, "unsure": UNSURE, "lost": LOST}
"""States of a localizer by name."""


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


def evidence_of(course: RecordedCourse, odometry: NDArray[np.float64], first: int) -> dict[str, float]:
    """Return what a localizer shows of itself where there is no truth.

    Args:
        course: Its beliefs.
        odometry: The odometry at each row, shape (T, 3).
        first: The first row.

    Returns:
        Mean share of fitting beams; number of leaps: corrections by more than `LEAP`, m or rad, of a belief that was not lost.
    """
    poses, wheels = course.poses[first:], odometry[first:]
    turn, (dx, dy, moved) = poses[:-1, 2] - wheels[:-1, 2], np.diff(wheels, axis=0).T
    cosine, sine = np.cos(turn), np.sin(turn)
    away = np.hypot(*(np.diff(poses[:, :2], axis=0) - np.column_stack((cosine * dx - sine * dy, sine * dx + cosine * dy))).T)
    leaps = (away > LEAP) | (np.abs(wrap_all(np.diff(poses[:, 2]) - moved)) > LEAP)
    return {"fits": float(np.mean(course.fits[first:])), "leaps": int(np.sum(leaps & (course.states[first:-1] != LOST)))}


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


def recorded_of(drive: Drive) -> tuple[RecordedScans, NDArray[np.intp]]:
    """Return a localizer's inputs from a drive, and the rows in them of the drive's rows, shape (T,).

    A scan that was recorded with an odometry pose of its own becomes a row.

    Raises:
        ValueError: If the drive has no odometry or no scans, or a LiDAR that moves on the robot.
    """
    if not drive.has_odometry or not drive.scans:
        lacks = "scans" if drive.has_odometry else "odometry"
        why = said(drive, ELSEWHERE) or "a localizer needs odometry and scans"
        raise ValueError(f"{drive.around.label or 'The recording'} holds no {lacks}; {why}.")
    seen = sorted(drive.scans, key=lambda scanned: (scanned.row, scanned.time))
    if len({scanned.mount for scanned in seen}) > 1:
        raise ValueError(f"The LiDAR of {drive.around.label or 'the recording'} must stay where it is on the robot.")
    scan, mount = seen[0].scan, seen[0].mount
    number = max(len(scanned.scan.ranges) for scanned in seen)
    ranges = np.full((len(seen), number), np.nan, np.float32)
    for at, scanned in enumerate(seen):
        ranges[at, : len(scanned.scan.ranges)] = scanned.scan.ranges
    aim = np.array([(scanned.scan.first, scanned.scan.increment) for scanned in seen])
    aim = aim[:1] if (aim == aim[0]).all() else aim
    angles = mount.theta + aim[:, :1] + aim[:, 1:] * np.arange(number, dtype=np.float64)
    interval = float(np.median([scanned.scan.beam_period for scanned in seen]))
    measured = known(drive.odometry)
    newest = np.maximum.accumulate(np.where(measured, np.arange(len(drive)), np.flatnonzero(measured)[0]))
    rows, times = np.array([scanned.row for scanned in seen]), np.array([scanned.time for scanned in seen])
    extra = np.array([scanned.odometry is not None for scanned in seen]) & (times != drive.time[rows])
    poses = np.array([scanned.odometry for scanned, is_extra in zip(seen, extra, strict=True) if is_extra]).reshape(-1, 3)
    before = rows[extra]
    time = np.insert(drive.time, before, times[extra])
    where = np.arange(len(drive)) + np.searchsorted(before, np.arange(len(drive)), side="right")
    rows = np.where(extra, rows + np.cumsum(extra) - 1, where[rows])
    recorded = RecordedScans(
        time,
        np.insert(drive.odometry[newest], before, poses, axis=0),
        rows,
        np.where(np.isfinite(times), times + interval * (number - 1), time[rows]),
        ranges,
        angles[0] if len(angles) == 1 else angles,
        interval,
        (mount.x, mount.y),
        min(scan.range_max, FAR),
    )
    return recorded, where


def errors_of(course: RecordedCourse, rows: NDArray[np.intp], reference: NDArray[np.float64]) -> dict[str, float]:
    """Return the errors of beliefs against reference poses at some rows, shape (K, 3); m, rad, and the median NEES."""
    poses = course.poses[rows]
    far, turned = position_error(poses, reference), heading_error(poses, reference)
    return {
        "median": float(np.median(far)),
        "quantile95": float(np.quantile(far, 0.95)),
        "worst": float(far.max()),
        "lost": float(np.mean(far > ASTRAY)),
        "median_heading": float(np.median(turned)),
        "nees": float(np.median(nees(poses, reference, course.covariances[rows], components=3))),
    }
