"""A drive as columns for a browser: numbers in single precision, ranges in millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, Seen, heading_error, position_error
from turtlebot_gym.plotting import SIGMAS

MILLIMETRES = 1000.0
NOTHING = 0
"""Value of a beam without a return."""


def rows_of(drive: Drive, *, scans_before: int = 0, start: float = 0.0) -> dict[str, Any]:
    """Return the columns of a drive's rows, all of length T; angles in rad, lengths in m.

    ``x, y, theta, v, omega`` are the truth; names with the prefix ``e`` are the estimate, ``o`` the odometry and ``g`` the
    goal; ``width, height, tilt`` are the axes of the estimate's ellipse.

    ``hypotheses`` has x, y, heading and weight of each hypothesis.

    Args:
        drive: The drive, or a piece of one.
        scans_before: Number of scans in earlier pieces.
        start: Time that is shown as 0, s.
    """
    truth, estimate = drive.true_state, drive.estimate
    width, height, tilt = _axes(drive.covariance)
    newest = np.full(len(drive), scans_before - 1)
    for seen in drive.scans:
        newest[seen.row :] += 1
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
        "fix": drive.fix,
        "scan": newest,
    }
    columns: dict[str, Any] = {name: np.ascontiguousarray(values, np.float32) for name, values in numbers.items()}
    columns["report"] = list(drive.report)
    columns["hypotheses"] = [np.asarray(places, np.float32).ravel() for places in drive.hypotheses]
    columns["circles"] = [np.asarray(circles, np.float32).ravel() for circles in drive.circles]
    return columns


def apart(drive: Drive, other: Drive) -> NDArray[np.float32]:
    """Return the distance between the robots of two drives at each row of the first, shape (T,), m; NaN beyond the other's end.

    It is that of the true positions, or of the estimates of a drive without truth.
    """
    positions = []
    for run in (drive, other):
        states = run.true_state if np.isfinite(run.true_state[:, 0]).any() else run.estimate
        positions.append(states[:, :2])
    time, other_time = drive.time - drive.time[0], other.time - other.time[0]
    at = [np.interp(time, other_time, positions[1][:, axis], right=np.nan) for axis in (0, 1)]
    return np.hypot(positions[0][:, 0] - at[0], positions[0][:, 1] - at[1]).astype(np.float32)


def scans_of(scans: tuple[Seen, ...]) -> dict[str, Any]:
    """Return the columns of scans: the LiDAR's pose, its beams, and ranges in mm."""
    numbers = np.array([[*seen.lidar, seen.scan.first, seen.scan.increment] for seen in scans], np.float32).reshape(-1, 5)
    columns: dict[str, Any] = _split(("x", "y", "theta", "first", "increment"), numbers)
    columns["ranges"] = [_millimetres(seen.scan.ranges) for seen in scans]
    return columns


def _split(names: tuple[str, ...], table: NDArray[Any]) -> dict[str, NDArray[Any]]:
    return {name: np.ascontiguousarray(table[:, at]) for at, name in enumerate(names)}


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
