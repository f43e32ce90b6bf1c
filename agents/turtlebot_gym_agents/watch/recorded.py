"""Recorded drives for the view; over one of wheels and truth alone, the filter is run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from turtlebot_gym.drives import Drive, read
from turtlebot_gym_agents.evaluation.replay import replay, replayable


def read_recorded(path: str | Path, *, label: str | None = None, lidar: str = "lds01", **options: Any) -> Drive:
    """Read a recorded drive.

    Args:
        path: A recording, see `turtlebot_gym.drives.read`.
        label: Label in the view; by default the name of the file.
        lidar: For a bag, a name in `turtlebot_gym.rooms.lidar.LIDARS`, for the mounting of the LiDAR.
        **options: For a drive in which no pose was measured, passed to `evaluation.replay.replay`.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file holds no drive; the message says what is missing.
        ImportError: If the file is a bag and rosbags is missing.
    """
    drive = read(path, label=label, lidar=lidar)
    if drive.has_truth and not drive.has_odometry:
        return replay(replayable(drive), **options)
    return drive
