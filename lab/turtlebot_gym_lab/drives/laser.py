"""Arrays of wheel poses and laser scans, as this project converts recordings of buildings.

The odometry is a pose that the wheels add up; a row's twist is the arc from the pose before it.
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
from turtlebot_gym_lab.drives.tables import increasing

RANGE_MAX = 80.0
"""Range from which a reading means that nothing returned, m."""


def is_laser_arrays(path: Path) -> bool:
    """Return whether an ``.npz`` file holds odometry, and ranges in centimetres."""
    if not (path.is_file() and zipfile.is_zipfile(path)):
        return False
    with zipfile.ZipFile(path) as file:
        return {"time.npy", "odometry.npy", "ranges_cm.npy"} <= set(file.namelist())


def read_laser_arrays(path: Path, *, label: str, mount: Pose | None) -> Drive:
    """Read arrays of wheel poses and scans of half a turn; see `reading.read`.

    The file holds ``time`` (T), s; ``odometry`` (T, 3), m, m, rad; ``ranges_cm`` (T, beams); and where there is a truth,
    ``reference_row`` (K), and ``reference`` (K, 3), m, m, rad. The LiDAR is where ``mount`` says, or in the middle of the axle.

    Raises:
        ValueError: If the arrays do not fit each other, or fewer than two rows are good.
    """
    file = read_arrays(path)
    time, odometry, ranges = (file[name] for name in ("time", "odometry", "ranges_cm"))
    if odometry.shape != (len(time), 3) or ranges.ndim != 2 or len(ranges) != len(time) or not ranges.size:
        raise ValueError(f"{path}: its arrays time, odometry and ranges_cm do not fit each other.")
    true = np.full((len(time), 3), np.nan)
    if "reference" in file:
        true[file["reference_row"]] = file["reference"]
    good = increasing(time) & np.isfinite(odometry).all(axis=1)
    if good.sum() < 2:
        raise ValueError(f"{path}: a drive needs two rows with odometry, got {good.sum()}.")
    time, odometry, ranges, true = time[good] - time[good][0], odometry[good], ranges[good] / np.float32(100.0), true[good]
    remarks = [] if mount else [f"{path}: the LiDAR is assumed in the middle of the axle; watch --mount X Y YAW states it"]
    if not good.all():
        remarks.append(f"{path}: {(~good).sum()} of {len(good)} rows have no finite pose, or a time that does not increase")
    mount, scans = mount or ORIGIN, []
    for row, pose in enumerate(odometry.tolist()):
        lidar = increment(Pose(*pose), ORIGIN, mount, sincos(pose[2]))
        scans.append(Seen(row, lidar, _scan(ranges[row]), float(time[row]), mount))
    twist = _twist(time, odometry)
    return Drive(
        time=time,
        twist=twist,
        command=twist,
        odometry=odometry,
        true_state=true,
        scans=tuple(scans),
        around=RoomData(label),
        remarks=tuple(remarks),
    )


def _scan(ranges: NDArray[np.float32]) -> Scan:
    """Return a scan of half a turn, one or two beams to a degree."""
    first, step = -0.5 * math.pi, math.radians(round(360.0 / len(ranges)) / 2.0)
    below = float(np.nextafter(np.float32(RANGE_MAX), np.float32(0.0)))
    beams = beams_of(ranges.astype(np.float32), first=first, increment=step, range_min=0.0, range_max=below)
    return Scan(beams.ranges, first, step, 0.0, RANGE_MAX)


def _twist(time: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speed and turning rate on the arc from the pose before each pose, shape (T, 2)."""
    turn = wrap_all(np.diff(poses[:, 2]))
    middle = poses[:-1, 2] + 0.5 * turn
    chord = np.diff(poses[:, 0]) * np.cos(middle) + np.diff(poses[:, 1]) * np.sin(middle)
    arcs = np.stack([chord / np.sinc(0.5 * turn / np.pi), turn], axis=1) / np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, 2)), arcs])
