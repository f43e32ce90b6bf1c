"""Recorded drives as tracks: bags, the recorder's snapshots, and tables with a true path that `replay` reads."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.calibration.bags import is_bag
from turtlebot_gym.trajectory import Trajectory
from turtlebot_gym.validation import shown
from turtlebot_gym_agents.evaluation.replay import read_drive, replay
from turtlebot_gym_agents.watch.bag import read_bag_track
from turtlebot_gym_agents.watch.track import Surroundings, Track, of_trajectory

_SNAPSHOT = {"true_state": 5, "odom": 3, "estimate": 5, "reference": 3}
"""Topics in a snapshot, and the number of components used of each."""
_COMPONENTS = ("x", "y", "theta", "v", "omega")


def read_recorded(path: str | Path, *, label: str | None = None, lidar: str = "lds01", **options: Any) -> Track:
    """Read a recorded drive.

    Args:
        path: A bag (folder, ``.mcap`` or ``.db3``), ``snapshots.csv`` of ``data_logger``, or a table as
            `evaluation.replay.read_drive` takes it, over which the filter is run.
        label: Label in the view; by default the name of the file.
        lidar: For a bag, a name in `turtlebot_gym.rooms.lidar.LIDARS`, for the mounting of the LiDAR.
        **options: For a table, passed to `evaluation.replay.replay`.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file holds no drive; the message says what is missing.
        ImportError: If the file is a bag and rosbags is missing.
    """
    path = Path(path)
    around = Surroundings(label or path.name)
    if is_bag(path):
        return read_bag_track(path, around, lidar=lidar)
    if _is_snapshots(path):
        return of_trajectory(_read_snapshots(path), around)
    return of_trajectory(replay(read_drive(path), **options), around)


def _is_snapshots(path: Path) -> bool:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return {"time", "odom_x", "estimate_x"} <= set(file.readline().strip().split(","))


def _number(name: str, line: int, row: dict[str, Any]) -> float:
    try:
        return float(row[name]) if row.get(name) else np.nan
    except (TypeError, ValueError):
        raise ValueError(f"row {line}: {name} must be a number, got {shown(row[name])}.") from None


def _read_snapshots(path: Path) -> Trajectory:
    """Read the snapshots that ``data_logger`` writes ten times a second; stale values count as unknown."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
    except csv.Error as error:
        raise ValueError(f"{path}: {error}.") from error
    if len(rows) < 2:
        raise ValueError(f"{path}: a drive has at least two rows, got {len(rows)}.")

    def column(name: str) -> list[float]:
        return [_number(name, at, row) for at, row in enumerate(rows, start=2)]

    def table(topic: str, size: int) -> NDArray[np.float64]:
        return np.array([column(f"{topic}_{name}") for name in _COMPONENTS[:size]]).T

    try:
        time = np.array(column("time"))
        parts = {topic: table(topic, size) for topic, size in _SNAPSHOT.items()}
        command = np.array([column("cmd_vel_v"), column("cmd_vel_omega")]).T
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    driven = np.flatnonzero(np.isfinite(parts["odom"]).all(axis=1))
    if not len(driven):
        raise ValueError(f"{path}: no row has odometry.")
    during = slice(driven[0], driven[-1] + 1)  # the recorder may have begun before the robot
    time, command = time[during], command[during]
    parts = {topic: rows[during] for topic, rows in parts.items()}
    return Trajectory(
        time=time - time[0],
        true_state=parts["true_state"],
        odometry=parts["odom"],
        estimate=parts["estimate"],
        covariance=np.full((len(time), 5, 5), np.nan),
        reference=parts["reference"],
        command=command,
    )
