"""Logs of MRCLAM: a robot's odometry, and its true poses by motion capture in the file beside it.

References:
    Leung, Halpern, Barfoot, Liu, "The UTIAS multi-robot cooperative localization and mapping dataset" (2011).
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drives.alignment import interpolated
from turtlebot_gym.drives.clocks import continued, increasing
from turtlebot_gym.drives.drive import Drive, RoomData, known
from turtlebot_gym.drives.tables import LARGEST, first_lines
from turtlebot_gym.files import LARGEST_LOG, read_text


def is_mrclam(path: Path) -> bool:
    """Return whether a file is the odometry of a robot of MRCLAM: by its name, and three numbers to a row."""
    rows = [line for line in first_lines(path) if line.strip() and line[0] != "#"]
    return path.name.endswith("Odometry.dat") and bool(rows) and len(rows[0].split()) == 3


def read_mrclam(path: Path, *, label: str) -> Drive:
    """Read a robot's odometry and, from the file beside it, its true poses; see `reading.read`."""
    rows = _numbers(path, 3)
    time, is_set, remarks = continued(rows[:, 0], str(path))
    keep = increasing(time) & known(rows)
    if not keep.all():
        remarks.append(
            f"{path}: {(~keep).sum()} of {len(keep)} rows are not finite, or have a time that does not increase: left out"
        )
    if keep.sum() < 2:
        raise ValueError(f"{path}: a drive needs two good rows, got {keep.sum()}.")
    beside, truth = path.with_name(path.name.replace("Odometry", "Groundtruth")), np.full((int(keep.sum()), 3), np.nan)
    if beside.is_file():
        poses = _numbers(beside, 4)
        poses = poses[increasing(poses[:, 0])]
        truth = interpolated(poses[:, 0], poses[:, 1:], time[keep])
    else:
        remarks.append(f"{path}: there is no {beside.name} beside it: the truth is unknown")
    twist = rows[keep, 1:]
    return Drive(
        time=time[keep],
        twist=twist,
        command=twist,
        true_state=truth,
        joined=np.concatenate([[False], keep[:-1]])[keep] & ~is_set[keep],
        around=RoomData(label),
        remarks=tuple(remarks),
    )


def _numbers(path: Path, columns: int) -> NDArray[np.float64]:
    """Return the rows of a file without names; a number that cannot be is NaN."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty file, which is refused below
            rows = np.loadtxt(read_text(path, most=LARGEST_LOG).splitlines(), comments="#", ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}.") from error
    if rows.shape[1] != columns or len(rows) < 2:
        raise ValueError(f"{path}: it must have {columns} columns and two rows at least, got {rows.shape[1]} and {len(rows)}.")
    return np.where(np.abs(rows) <= LARGEST, rows, np.nan)
