"""Read a recorded drive, whatever it is recorded as."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from turtlebot_gym.drives.alignment import headings, interpolated
from turtlebot_gym.drives.bags import is_bag, read_bag
from turtlebot_gym.drives.drive import Drive
from turtlebot_gym.drives.tables import read_poses, read_table
from turtlebot_gym.topics import Topics

OVERLAP = 1.0
"""Least time that a truth in a file of its own must share with a drive, s."""


def read(
    path: str | Path,
    *,
    topics: Topics | None = None,
    columns: Mapping[str, str] | None = None,
    truth: str | Path | None = None,
    label: str | None = None,
    lidar: str = "lds01",
) -> Drive:
    """Read a recorded drive: a ROS 2 bag (sqlite3 or MCAP), a table with named columns, or the recorder's snapshots.

    Rows whose time or twist is not finite, or whose time does not increase, are left out. A pose that is not finite counts as
    missing. The drive's remarks count both.

    Args:
        path: A bag's folder or file, a text file, or an ``.npz`` file with an array for each column. The content decides.
        topics: Topics of a bag.
        columns: Column names of a table other than those in `tables.NAMES`, by quantity, a key of `tables.NAMES`.
        truth: A topic of a bag, with ``:FRAME`` where it holds transforms; or a table of true poses with the columns t, x, y
            and perhaps theta, by the drive's clock. By default what the drive itself holds.
        label: Label of the drive; by default the name of the file.
        lidar: For a bag, a name in `turtlebot_gym.rooms.lidar.LIDARS`, for the mounting of the LiDAR.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file holds no drive, or a topic, a column or the truth is missing; the message names file and place.
        ImportError: If the file is a bag, and rosbags is not installed.
    """
    path, beside = Path(path), Path(truth) if truth and Path(truth).is_file() else None
    if is_bag(path):
        asked = topics or Topics()
        asked = replace(asked, truth=str(truth)) if truth and beside is None else asked
        drive = read_bag(path, asked, label=label or path.name, lidar=lidar)
    elif truth and beside is None:
        raise ValueError(f"truth must be auto, none, or a file for a table, got {str(truth)!r}.")
    else:
        drive = read_table(path, columns or {}, label=label or path.name)
    return _with_headings(drive if beside is None else _with_truth(drive, beside))


def _with_truth(drive: Drive, path: Path) -> Drive:
    time, poses = read_poses(path)
    if len(time) < 2 or min(time[-1], drive.time[-1]) - max(time[0], drive.time[0]) < OVERLAP:
        raise ValueError(f"{path}: the truth shares less than a second with the drive, which begins at {drive.time[0]:.3f} s.")
    return replace(drive, true_state=interpolated(time, poses, drive.time))


def _with_headings(drive: Drive) -> Drive:
    """Return a drive whose truth has headings; of positions alone they are the directions in which the robot moves."""
    positions = np.isfinite(drive.truth[:, :2]).all(axis=1)
    if positions.sum() < 2 or np.isfinite(drive.truth[:, 2]).any():
        return drive
    state = drive.true_state.copy()
    state[:, 2] = headings(drive.time, state[:, :2], drive.twist[:, 0])
    remark = "the truth has no heading: the direction of motion is taken for it, whose error counts for alpha3 and alpha4"
    return replace(drive, true_state=state, remarks=(*drive.remarks, f"{drive.around.label}: {remark}"))
