"""Arrays of wheel poses and laser scans, as recordings of buildings are often published.

The odometry is a pose that the wheels add up; a row's twist is the arc from the pose before it, so that rows may be left out
without loss.
"""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import beams_of
from turtlebot_gym.drive import Drive, RoomData, Seen
from turtlebot_gym.files import read_arrays
from turtlebot_gym.models.angles import sincos, wrap_all
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import ORIGIN, Pose
from turtlebot_gym_lab.drives.clocks import continued, increasing, strays
from turtlebot_gym_lab.drives.tables import LARGEST

RANGE_MAX = 80.0
"""Range from which a reading means that nothing returned, m."""
SPARSE = 0.4
"""Least interval between rows as a share of one that 99 in 100 do not exceed: stamps that scatter are no gaps."""


def is_laser_arrays(path: Path) -> bool:
    """Return whether an ``.npz`` file holds odometry, and ranges in centimetres."""
    if not (path.is_file() and zipfile.is_zipfile(path)):
        return False
    with zipfile.ZipFile(path) as file:
        return {"time.npy", "odometry.npy", "ranges_cm.npy"} <= set(file.namelist())


def read_laser_arrays(path: Path, *, label: str, mount: Pose | None) -> Drive:
    """Read arrays of wheel poses and scans of half a turn; see `reading.read`.

    The file holds ``time`` (T), s; ``odometry`` (T, 3), m, m, rad; ``ranges_cm`` (T, beams); and where there is a truth,
    ``reference_row`` (K), and ``reference`` (K, 3), m, m, rad. The LiDAR is where ``mount`` says.

    Raises:
        ValueError: If the arrays do not fit each other, or fewer than two rows are good.
    """
    file = read_arrays(path)
    try:
        time, odometry, ranges = (file[name] for name in ("time", "odometry", "ranges_cm"))
        rows = np.asarray(file["reference_row"], np.intp) if "reference_row" in file else np.zeros(0, np.intp)
        reference = np.asarray(file["reference"], np.float64) if len(rows) else np.zeros((0, 3))
        shapes = odometry.shape == (len(time), 3) and ranges.ndim == 2 and len(ranges) == len(time) > 1
        good = (np.abs(time) <= LARGEST) & (np.abs(odometry) <= LARGEST).all(axis=1) if shapes else np.zeros(0, np.bool_)
        if not (shapes and ranges.shape[1] and reference.shape == (len(rows), 3) and ((rows >= 0) & (rows < len(time))).all()):
            raise ValueError("its arrays time, odometry, ranges_cm, reference_row and reference do not fit each other")
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}.") from error
    true = np.full((len(time), 3), np.nan)
    true[rows] = reference
    bad = int((~good).sum())
    remarks = [f"{path}: {bad} of {len(good)} rows are not finite: left out"] if bad else []
    if mount is None:
        mount = ORIGIN
        remarks.append(
            f"{path}: nothing says where the LiDAR is on the robot: it is assumed in the middle of the axle, looking ahead; "
            "--mount X Y YAW states its pose"
        )
    scans = (ranges[good].astype(np.float32) / 100.0).astype(np.float32)
    return _of_poses(path, time[good], odometry[good], true[good], scans, mount, label=label, remarks=remarks)


def _of_poses(
    path: Path,
    stamps: NDArray[np.float64],
    odometry: NDArray[np.float64],
    true: NDArray[np.float64],
    ranges: NDArray[np.float32],
    mount: Pose,
    *,
    label: str,
    remarks: list[str],
) -> Drive:
    """Return a drive whose rows are poses that the wheels add up, with truth and scans by the same clock."""
    is_stray = strays(np.asarray(stamps, np.float64))
    times, is_set, notes = continued(np.where(is_stray, np.nan, stamps), str(path))
    resets, has_truth = np.cumsum(is_set), np.isfinite(true).all(axis=1)
    keep = increasing(times)
    for bad, how in ((is_stray, "a time that is far from those around"), (~keep & ~is_stray, "a time that does not increase")):
        if bad.any():
            notes.append(f"{path}: {bad.sum()} of {len(keep)} rows have {how}: left out")
    rows = np.flatnonzero(keep)
    rows = rows[_spaced(times[rows], np.isin(times[rows], times[has_truth]))]
    if len(rows) < 2:
        raise ValueError(f"{path}: a drive needs two rows with odometry, got {len(rows)}.")
    time, poses = times[rows], np.asarray(odometry[rows], np.float64)
    truth, known = np.full((len(rows), 3), np.nan), np.isin(times, time) & has_truth
    truth[np.searchsorted(time, times[known])] = true[known]
    seen = []
    for at, row in enumerate(np.searchsorted(time, times).tolist()):
        if row < len(rows):
            robot = Pose(*odometry[at].tolist())
            lidar = increment(robot, ORIGIN, mount, sincos(robot.theta))
            seen.append(Seen(row, lidar, _scan(ranges[at]), float(times[at] - time[0]), mount, robot))
    twist = _twist(time, poses)
    return Drive(
        time=time - time[0],
        twist=twist,
        command=twist,
        odometry=poses,
        true_state=truth,
        joined=np.diff(resets[rows], prepend=resets[rows[0]]) == 0,
        scans=tuple(seen),
        around=RoomData(label),
        remarks=(*remarks, *notes),
    )


def _scan(ranges: NDArray[np.float32]) -> Scan:
    """Return a scan of half a turn, one or two beams to a degree."""
    first, increment = -0.5 * math.pi, math.radians(round(360.0 / len(ranges)) / 2.0)
    below = float(np.nextafter(np.float32(RANGE_MAX), np.float32(0.0)))
    beams = beams_of(ranges, first=first, increment=increment, range_min=0.0, range_max=below)
    return Scan(beams.ranges, first, increment, 0.0, RANGE_MAX)


def _spaced(time: NDArray[np.float64], wanted: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the rows that are not much nearer to each other than others are, and those that are wanted."""
    if len(time) < 2:
        return np.arange(len(time))
    least, last, kept = SPARSE * float(np.percentile(np.diff(time), 99)), -math.inf, []
    for row, (at, is_wanted) in enumerate(zip(time.tolist(), wanted.tolist(), strict=True)):
        if kept and is_wanted and at - last < least and not wanted[kept[-1]]:
            kept.pop()
            last = time[kept[-1]] if kept else -math.inf
        if is_wanted or at - last >= least:
            kept.append(row)
            last = at
    return np.array(kept, np.intp)


def _twist(time: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speed and turning rate on the arc from the pose before each pose, shape (T, 2)."""
    turn = wrap_all(np.diff(poses[:, 2]))
    middle = poses[:-1, 2] + 0.5 * turn
    chord = np.diff(poses[:, 0]) * np.cos(middle) + np.diff(poses[:, 1]) * np.sin(middle)
    arcs = np.stack([chord / np.sinc(0.5 * turn / np.pi), turn], axis=1) / np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, 2)), arcs])
