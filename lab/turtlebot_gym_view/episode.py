"""Drives for the view: an episode, or a recorded drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.evaluation.recording import record_episode

__all__ = ["read_recorded", "record_episode"]


def read_recorded(path: str | Path, *, noise: str = "documented", **options: Any) -> Drive:
    """Read a recorded drive; if it has only wheels and truth, the filter is run over it.

    Args:
        path: A recording, see `turtlebot_gym_lab.drives.read`.
        noise: Noise of the filter's measurements, see `evaluation.replay.replay`.
        **options: As for `turtlebot_gym_lab.drives.read`, with its errors.
    """
    from turtlebot_gym_lab.drives import read  # the lab is needed for recordings only
    from turtlebot_gym_lab.evaluation.replay import replay, replayable

    drive = read(path, **options)
    return replay(replayable(drive), noise=noise) if drive.has_truth and not drive.has_odometry else drive
