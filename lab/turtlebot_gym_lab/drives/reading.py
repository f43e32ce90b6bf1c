"""Read a recorded drive: a bag, a table, or arrays of wheel poses and scans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from turtlebot_gym.config import FINITE, Numbers
from turtlebot_gym.drive import Drive
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.drives.bags import is_bag, read_bag, sensors_of
from turtlebot_gym_lab.drives.laser import is_laser_arrays, read_laser_arrays
from turtlebot_gym_lab.drives.streams import headings, interpolated
from turtlebot_gym_lab.drives.tables import read_poses, read_table
from turtlebot_gym_lab.drives.topics import Topics

OVERLAP = 1.0
"""Least time that a truth in a file of its own must share with a drive, s."""
MISSING = 1.75
"""Ratio to the usual interval from which a row is missing."""


def read(
    path: str | Path,
    *,
    topics: Topics | None = None,
    columns: Mapping[str, str] | None = None,
    truth: str | Path | None = None,
    label: str | None = None,
    lidar: str = "lds01",
    mount: Sequence[float] | None = None,
) -> Drive:
    """Read a recorded drive.

    Rows whose time or twist is not finite, or whose time does not increase, are left out. A pose that is not finite counts as
    missing. The drive's remarks say so.

    Args:
        path: A bag (a folder, ``.mcap``, ``.db3``, or ``.bag`` of ROS 1), laser arrays (``.npz``, see `laser`), or a table with
            named columns: text, or ``.npz`` with an array for each.
        topics: Topics of a bag.
        columns: Column names of a table other than those in `tables.NAMES`, by quantity, a key of `tables.NAMES`.
        truth: A topic of a bag, with ``:PARENT.CHILD`` where it holds transforms; or a table of true poses with the columns t,
            x, y and perhaps theta, by the drive's clock. By default what the drive itself holds.
        label: Label of the drive; by default the name of the file.
        lidar: For a bag, a LiDAR as in `turtlebot_gym.Options`, for the mount of one that ``/tf_static`` does not state.
        mount: Pose of the LiDAR on the robot, m, m, rad; None for that of ``/tf_static``, else of ``lidar``.

    Raises:
        OSError: If the file cannot be read, or is a pipe or a device.
        ValueError: If the file holds no drive, or a topic, a column or the truth is missing; the message names file and place.
        ImportError: If the file is a bag, and rosbags is not installed.
    """
    path, beside = Path(path), Path(truth) if truth and Path(truth).is_file() else None
    label = label or path.name
    at = None if mount is None else Pose(*Numbers(FINITE, 3).check("mount", mount))
    if is_bag(path):
        topics = topics or Topics()
        topics = replace(topics, truth=str(truth)) if truth and beside is None else topics
        drive = read_bag(path, topics=topics, label=label, lidar=lidar, mount=at)
    elif truth and beside is None:
        raise ValueError(f"truth must be auto, none, or a file where the recording is no bag, got {str(truth)!r}.")
    elif is_laser_arrays(path):
        drive = read_laser_arrays(path, label=label, mount=at)
        return drive if beside is None else _with_headings(_with_truth(drive, beside))
    elif at is not None:
        raise ValueError("mount says where a LiDAR is, and a table holds no scans: leave it out.")
    else:
        drive = read_table(path, columns=columns or {}, label=label)
    drive = _unwound(drive if beside is None else _with_truth(drive, beside))
    return _with_gaps_noted(_with_headings(drive))


def pose_sensors(path: str | Path, *, truth: str = "") -> list[str]:
    """Return the topics of a bag that state measured poses: the first usual one, or all others; nothing for other recordings.

    The topic of the truth is none of them.
    """
    return sensors_of(Path(path), truth.partition(":")[0]) if is_bag(Path(path)) else []


def _remarked(drive: Drive, remark: str) -> Drive:
    return replace(drive, remarks=(*drive.remarks, f"{drive.around.label}: {remark}"))


def _with_truth(drive: Drive, path: Path) -> Drive:
    time, poses = read_poses(path)
    if len(time) < 2 or min(time[-1], drive.time[-1]) - max(time[0], drive.time[0]) < OVERLAP:
        ends = [f"{min(each, default=0.0):.3f} to {max(each, default=0.0):.3f} s" for each in (time, drive.time)]
        text = f"shares less than a second with the drive: it is from {ends[0]}, the drive from {ends[1]}"
        raise ValueError(f"{path}: the truth {text}. If their clocks differ, give the truth's time by that of the drive.")
    return replace(drive, true_state=interpolated(time, poses, drive.time))


def _with_headings(drive: Drive) -> Drive:
    """Return a drive whose truth has headings; of positions alone they are the directions in which the robot moves."""
    positions = np.isfinite(drive.truth[:, :2]).all(axis=1)
    if positions.sum() < 2 or np.isfinite(drive.truth[:, 2]).any():
        return drive
    state = drive.true_state.copy()
    state[:, 2] = headings(drive.time, state[:, :2], drive.twist[:, 0])
    remark = "the truth has no heading: the direction of motion is taken for it, whose error counts for alpha3 and alpha4"
    return _remarked(replace(drive, true_state=state), remark)


def _unwound(drive: Drive) -> Drive:
    """Take turning rates of more than half a turn to a row from the measured headings: TurtleBot3's driver wraps wrongly."""
    turn, interval = (np.diff(each, prepend=np.nan) for each in (drive.odometry[:, 2], drive.time))
    wrong = drive.joined & (np.abs(drive.twist[:, 1]) * interval > np.pi) & np.isfinite(turn)
    if not wrong.any():
        return drive
    twist = drive.twist.copy()
    twist[wrong, 1] = wrap_all(turn[wrong]) / interval[wrong]
    text = f"{wrong.sum()} turning rates are more than half a turn to a row, first at {drive.time[wrong][0]:.3f} s"
    return _remarked(replace(drive, twist=twist), f"{text}: the change of the measured heading is taken")


def _with_gaps_noted(drive: Drive) -> Drive:
    steps = np.diff(drive.time)
    gaps = np.flatnonzero((steps > MISSING * drive.period) & drive.joined[1:])
    if not len(gaps):
        return drive
    rows = int((np.rint(steps[gaps] / drive.period) - 1).sum())
    text = f"{rows} rows are missing at {len(gaps)} places, first after {drive.time[gaps[0]]:.3f} s"
    return _remarked(drive, f"{text}: the twist after each gap holds over it")
