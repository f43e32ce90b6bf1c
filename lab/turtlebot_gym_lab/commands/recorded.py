"""The options of every command that reads recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from turtlebot_gym_lab.drives.topics import Topics


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
