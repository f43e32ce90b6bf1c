"""Read a recorded drive, whatever it is recorded as."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from turtlebot_gym.drive import Drive
from turtlebot_gym.files import in_bounds
from turtlebot_gym.validation import FINITE, Numbers
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.drives.alignment import headings, interpolated
from turtlebot_gym_lab.drives.bags import is_bag, read_bag, sensors_of
from turtlebot_gym_lab.drives.causes import cause_of, jump_of
from turtlebot_gym_lab.drives.clocks import judged
from turtlebot_gym_lab.drives.laser import is_laser_arrays, read_laser_arrays
from turtlebot_gym_lab.drives.tables import is_table, read_poses, read_table
from turtlebot_gym_lab.drives.topics import Topics

OVERLAP = 1.0
"""Least time that a truth in a file of its own must share with a drive, s."""


class Format(NamedTuple):
    """A form of recordings."""

    name: str
    files: str
    """What its files are."""
    holds: str
    """What is read of it."""
    recognizes: Callable[[Path], bool]
    """Whether a file that exists has this form, by its content."""
    read: Callable[..., Drive]
    """Reads a file with the options of `read` that this form has."""
    options: tuple[str, ...] = ()
    measures_twist: bool = True
    """Whether a row's twist is measured over its own interval alone, so that a missing row is a loss."""


FORMATS = (
    Format(
        "bag",
        "a folder, `.mcap`, `.db3` (ROS 2), `.bag` (ROS 1)",
        "odometry, commands, scans, tracks, a gyro on `/imu`, maps; truth and fixes as Odometry, PoseStamped, "
        "PoseWithCovarianceStamped, TransformStamped, PointStamped or `/tf`",
        is_bag,
        read_bag,
        ("topics", "lidar", "mount"),
    ),
    Format(
        "laser arrays",
        "`.npz`: `time`, `odometry`, `ranges_cm`, `reference_row`, `reference`",
        "odometry, scans, the reference as truth",
        is_laser_arrays,
        read_laser_arrays,
        ("mount",),
        False,
    ),
    Format(
        "table",
        "text with named columns, or `.npz` with an array for each",
        "twist, measured and true poses",
        is_table,
        read_table,
        ("columns",),
    ),
)
"""The forms of recordings that `read` knows, in the order in which they are tried."""
READABLE = "; ".join(f"{form.name}: {form.files.replace('`', '')}" for form in FORMATS)
"""All of them in a line."""


@in_bounds
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
    """Read a recorded drive in any of `FORMATS`.

    Rows whose time or twist is not finite, or whose time does not increase or is far from those around, are left out. A pose
    that is not finite counts as missing. Times after a clock was set back are moved on; a topic by another clock than the
    odometry's is moved to that. The drive's remarks say all of this, and whether rows are missing.

    Args:
        path: The file, or the folder of a bag. The content decides what it is.
        topics: Topics of a bag.
        columns: Column names of a table other than those in `tables.NAMES`, by quantity, a key of `tables.NAMES`.
        truth: A topic of a bag, with ``:PARENT.CHILD`` where it holds transforms; or a table of true poses with the columns t,
            x, y and perhaps theta, by the drive's clock. By default what the drive itself holds.
        label: Label of the drive; by default the name of the file.
        lidar: For a bag, a LiDAR as in `turtlebot_gym.Options`, for the mount of one that no transform states.
        mount: Pose of the LiDAR on the robot, m, m, rad; None for that of the transforms on ``/tf`` and ``/tf_static``, and
            where none states it, for that of ``lidar``, which a remark says.

    Raises:
        OSError: If the file cannot be read, or is a pipe or a device.
        ValueError: If the file holds no drive, a topic, a column or the truth is missing, or reading takes more time or memory
            than `bounded` allows; the message names file and place.
        ImportError: If the file is a bag, and rosbags is not installed.
    """
    path, beside = Path(path), Path(truth) if truth and Path(truth).is_file() else None
    form = next((form for form in FORMATS if form.recognizes(path)), None)
    if form is None:
        raise ValueError(f"{path}: the file is binary, and not one of these: {READABLE}.")
    if truth and beside is None and "topics" not in form.options:
        raise ValueError(f"truth must be auto, none, or a file for a {form.name}, got {str(truth)!r}.")
    if mount is not None and "mount" not in form.options:
        raise ValueError(f"mount says where a LiDAR is, and a {form.name} holds no scans: leave it out.")
    topics = topics or Topics()
    topics = replace(topics, truth=str(truth)) if truth and beside is None else topics
    at = None if mount is None else Pose(*Numbers(FINITE, 3).check("mount", mount))
    options = {"topics": topics, "columns": columns or {}, "lidar": lidar, "mount": at}
    drive = form.read(path, label=label or path.name, **{name: options[name] for name in form.options})
    drive = _with_headings(drive if beside is None else _with_truth(drive, beside))
    if not form.measures_twist:
        return drive
    why = cause_of(drive) or (jump_of(drive) if "topics" in form.options else "")  # robots are moved, and their odometry reset
    if why:
        return replace(drive, remarks=(*drive.remarks, f"{drive.around.label}: {why}"))
    return judged(drive)


@in_bounds
def pose_sensors(path: str | Path, *, truth: str = "") -> list[str]:
    """Return the topics of a bag that state measured poses: the first usual one, or all others; nothing for other recordings.

    Args:
        path: The recording.
        truth: Topic of the truth, which is no measurement.
    """
    path = Path(path)
    form = next((form for form in FORMATS if form.recognizes(path)), None)
    return sensors_of(path, truth.partition(":")[0]) if form is not None and form.read is read_bag else []


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
    return replace(drive, true_state=state, remarks=(*drive.remarks, f"{drive.around.label}: {remark}"))
