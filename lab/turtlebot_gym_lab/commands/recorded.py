"""The options of every command that reads recordings, or localizes one in a map."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from turtlebot_gym_lab.drives.topics import Topics

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive
    from turtlebot_gym.rooms.grid import GridMap
    from turtlebot_gym_lab.evaluation.localize import KnownPlace


@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """How recordings are read."""

    truth: str = "auto"
    """auto uses the truth if a recording has it; otherwise a topic of the bag (TOPIC:PARENT.CHILD where it holds transforms,
    such as /tf:map.base_footprint), or a table with the columns t, x, y and perhaps theta."""
    columns: tuple[str, ...] = ()
    """Names of a table's columns, as QUANTITY=COLUMN: time, v, omega, x, y, theta, true_x, true_y, true_theta."""
    topics: Topics = field(default_factory=Topics)
    """Topics of a bag."""

    def reading(self) -> dict[str, Any]:
        """Return the options of `turtlebot_gym_lab.drives.read`."""
        columns = {name: column for name, _, column in (pair.partition("=") for pair in self.columns)}
        truth = None if self.truth in ("auto", "none") else self.truth
        return {"topics": self.topics, "columns": columns, "truth": truth}


@dataclass(frozen=True, kw_only=True)
class MountOption(RecordingOptions):
    """Where the LiDAR is."""

    mount: tuple[float, float, float] | None = None
    """Pose of the LiDAR on the robot: x, y, heading; m, m, rad. Default: as the transforms of the bag state it, else as
    assumed, which is said."""

    def reading(self) -> dict[str, Any]:
        """Return the options of `turtlebot_gym_lab.drives.read`."""
        return super().reading() | {"mount": self.mount}


@dataclass(frozen=True, kw_only=True)
class StartOptions(MountOption):
    """How a recording is localized."""

    localizer: str = "robot"
    """Assumptions: robot, match, or a file of them (FILE.yaml)."""
    lidar: str = "lds01"
    """LiDAR, a preset or a file of your own (FILE.yaml): match assumes its errors, and where no transform states the LiDAR's
    mount, its mount is assumed."""
    hits: bool = True
    """Whether the map's occupied cells say where a LiDAR's hits fell, as in maps by SLAM, and not what is solid."""
    start: tuple[float, float, float] | Literal["unknown"] | None = None
    """Pose in the map at the first row, within 0.3 m and 0.3 rad: x, y, heading; m, m, rad. Or unknown: the whole map is
    searched. Default: the first true pose."""

    def reading(self) -> dict[str, Any]:
        """Return the options of `turtlebot_gym_lab.drives.read`."""
        return super().reading() | {"lidar": self.lidar}

    def localizable(self, drive: Drive) -> Drive:
        """Return a drive with odometry: where it was not recorded, its twist is added up from the origin."""
        from turtlebot_gym.values import ORIGIN
        from turtlebot_gym_lab.evaluation.replay import dead_reckoning

        if drive.has_odometry:
            return drive
        remark = f"{drive.around.label}: there is no odometry: the twist, added up, stands for it"
        return replace(drive, odometry=dead_reckoning(drive, start=ORIGIN), remarks=(*drive.remarks, remark))

    def place(self, map: Path, drive: Drive, name: Path) -> tuple[GridMap, KnownPlace]:
        """Return a map, and the place of a drive in it."""
        from turtlebot_gym.drive import known
        from turtlebot_gym.localization.tuning import make_localizer
        from turtlebot_gym.rooms.maps import read_map
        from turtlebot_gym.rooms.worlds import find_lidar
        from turtlebot_gym.values import Pose
        from turtlebot_gym_lab.evaluation.localize import KNOWN, KnownPlace

        tuning, grid = make_localizer(self.localizer, find_lidar(self.lidar)), read_map(map).map
        assert grid is not None
        rows = np.flatnonzero(known(drive.truth))
        if self.start is not None:
            start = None if self.start == "unknown" else Pose(*self.start)
            return grid, KnownPlace(grid.field(hits=self.hits), grid.frame, tuning, start)
        if not len(rows):
            raise ValueError(f"{name} holds no truth: --start must say where in the map the drive begins, or unknown.")
        first = int(rows[0])
        start = Pose(*drive.truth[first].tolist())
        return grid, KnownPlace(grid.field(hits=self.hits), grid.frame, tuning, start, KNOWN, first)
