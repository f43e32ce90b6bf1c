"""A drive as tables for a browser: numbers in single precision, ranges in millimetres, one table for each kind of row.

Bokeh sends each column as one compressed array. What only some rows have, or several times (scans, people, tracks, hypotheses,
reports), has a table of its own, whose column ``row`` says to which row of the drive it belongs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.drive import Drive, Seen, heading_error, position_error
from turtlebot_gym.plotting import SIGMAS

MILLIMETRES = 1000.0
NOTHING = 0
"""Value of a beam without a return."""
RESOLUTION = 2.0**-13
"""Numbers are rounded to multiples of it (0.12 mm, 0.12 mrad), so that they compress."""
MOST_BEAMS = 1_200_000
"""Most beams of a drive; of a longer one every n-th scan is sent."""
STEP = 0.005
"""A circle that has moved so far is a person, m."""
MOST_RUNS = 6
"""Most drives in a view: the number of colours that can be told apart."""
Table = dict[str, Any]


def kept_of(drive: Drive) -> int:
    """Return the n of which every n-th scan of a drive is sent."""
    return max(1, -(-sum(len(seen.scan.ranges) for seen in drive.scans) // MOST_BEAMS))


def tables_of(drive: Drive) -> dict[str, Table]:
    """Return the tables of a drive, whose time begins at 0."""
    scans, beams = _scans_of(drive.scans[:: kept_of(drive)])
    said = [k for k, text in enumerate(drive.report) if text != (drive.report[k - 1] if k else "")]
    return {
        "scans": scans,
        "beams": beams,
        "people": _people_of(drive),
        "tracks": _tracks_of(drive),
        "places": _places_of(drive),
        "reports": {"row": _whole(said), "text": [drive.report[k] for k in said]},
        "rows": rows_of(drive, start=float(drive.time[0])),
    }


def rows_of(drive: Drive, *, start: float = 0.0) -> Table:
    """Return the columns of a drive's rows, all of length T; angles in rad, lengths in m, time from a start on.

    ``x, y, theta, v, omega`` are the truth; names with the prefix ``e`` are the estimate, ``o`` the odometry and ``g`` the
    goal; ``width, height, tilt`` are the axes of the estimate's ellipse.
    """
    truth, estimate = drive.true_state, drive.estimate
    width, height, tilt = _axes(drive.covariance)
    numbers = {
        "time": drive.time - start,
        **_split(("x", "y", "theta", "v", "omega"), truth),
        **_split(("ex", "ey", "etheta"), estimate),
        **_split(("ox", "oy", "otheta"), drive.odometry),
        **_split(("gx", "gy", "gtheta"), drive.reference),
        **_split(("command_v", "command_omega"), drive.command),
        "width": width,
        "height": height,
        "tilt": tilt,
        "error": position_error(estimate, truth),
        "odometry_error": position_error(drive.odometry, truth),
        "turn": heading_error(estimate, truth),
        "odometry_turn": heading_error(drive.odometry, truth),
        "nis": drive.nis,
        "clearance": drive.clearance,
        "level": drive.level,
    }
    return {name: _numbers(values) for name, values in numbers.items()}


def _people_of(drive: Drive) -> Table:
    """Return the circles: row, x, y, radius, and whether it moves during the drive: then it is a person."""
    counts = [len(circles) for circles in drive.circles]
    table = np.concatenate([np.empty((0, 3)), *drive.circles])
    moves = np.zeros(len(table))
    if counts and min(counts) == max(counts):
        moves = np.tile(np.hypot(*np.ptp(np.array(drive.circles)[:, :, :2], axis=0).T) > STEP, len(counts))
    row = np.repeat(np.arange(len(drive)), counts)
    return {"row": _whole(row), **_split(("x", "y", "radius"), table), "moves": _numbers(moves)}


def _scans_of(scans: tuple[Seen, ...]) -> tuple[Table, Table]:
    """Return scans, with the LiDAR's pose and the first of their beams, and the ranges of all beams, mm."""
    numbers = np.array([[*seen.lidar, seen.scan.first, seen.scan.increment] for seen in scans], np.float32).reshape(-1, 5)
    ranges = [_millimetres(seen.scan.ranges) for seen in scans]
    ends = np.cumsum([len(row) for row in ranges])
    table: Table = {"row": _whole([seen.row for seen in scans]), "end": _whole(ends)}
    for at, name in enumerate(("x", "y", "theta", "first", "increment")):  # unrounded: the last beam has 359 increments
        table[name] = np.ascontiguousarray(numbers[:, at])
    return table, {"range": np.concatenate([np.empty(0, np.uint16), *ranges])}


def _tracks_of(drive: Drive) -> Table:
    """Return the tracks on the map: row, x, y, x and y in a second, and radius within `SIGMAS` standard deviations."""
    row, place = np.nonzero(drive.tracks[:, :, -1] == 1.0)
    ahead, left, ahead_v, left_v, deviation = drive.tracks[row, place, :5].T
    x, y, theta = drive.poses[row].T
    cosine, sine = np.cos(theta), np.sin(theta)
    numbers = {
        "x": x + cosine * ahead - sine * left,
        "y": y + sine * ahead + cosine * left,
        "next_x": x + cosine * (ahead + ahead_v) - sine * (left + left_v),
        "next_y": y + sine * (ahead + ahead_v) + cosine * (left + left_v),
        "radius": SIGMAS * deviation / np.sqrt(2.0),  # the deviation is that of both coordinates together
    }
    return {"row": _whole(row), **{name: _numbers(values) for name, values in numbers.items()}}


def _places_of(drive: Drive) -> Table:
    """Return the localizer's hypotheses: row, x, y, heading, weight, and how solid each is drawn."""
    row = np.repeat(np.arange(len(drive)), [len(places) for places in drive.hypotheses])
    places = np.concatenate([np.empty((0, 4)), *drive.hypotheses])
    table = _split(("x", "y", "theta", "weight"), places)
    return {"row": _whole(row), **table, "alpha": _numbers(0.15 + 0.6 * places[:, 3])}


def _numbers(values: ArrayLike) -> NDArray[np.float32]:
    return np.ascontiguousarray(np.round(np.asarray(values, np.float64) / RESOLUTION) * RESOLUTION, np.float32)


def _whole(values: ArrayLike) -> NDArray[np.int32]:
    return np.asarray(values, np.int32)


def _split(names: tuple[str, ...], table: NDArray[Any]) -> dict[str, NDArray[np.float32]]:
    return {name: _numbers(table[:, at]) for at, name in enumerate(names)}


def _axes(covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return widths, heights and tilts of the ellipses of a position; NaN if not known."""
    finite = np.isfinite(covariance[:, :2, :2]).all((1, 2))
    width, height, tilt = np.full((3, len(covariance)), np.nan)
    variances, directions = np.linalg.eigh(covariance[finite, :2, :2])
    sizes = 2.0 * SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    height[finite], width[finite] = sizes[:, 0], sizes[:, 1]
    tilt[finite] = np.arctan2(directions[:, 1, 1], directions[:, 0, 1])
    return width, height, tilt


def _millimetres(ranges: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return ranges as whole millimetres; `NOTHING` for beams without a return, or beyond 65 m."""
    rounded = np.round(MILLIMETRES * np.where(np.isfinite(ranges), ranges, 0.0))
    return np.where(rounded < 2**16, rounded, NOTHING).astype(np.uint16)


def require_number(number: int) -> None:
    """Refuse a number of drives that one view cannot show."""
    if not 0 < number <= MOST_RUNS:
        raise ValueError(f"a view shows 1 to {MOST_RUNS} drives, got {number}.")
