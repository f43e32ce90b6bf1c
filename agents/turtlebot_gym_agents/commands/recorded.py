"""The options of every command that reads recordings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from turtlebot_gym.topics import Topics
from turtlebot_gym_agents.commands.console import columns_of


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """How recordings are read."""

    truth: str = "auto"
    """auto uses the truth if a recording has it; otherwise a topic of the bag (TOPIC:FRAME where it holds transforms, such as
    /tf:base_footprint), or a table with the columns t, x, y and perhaps theta."""
    columns: tuple[str, ...] = ()
    """Names of a table's columns, as QUANTITY=COLUMN: time, v, omega, x, y, theta, true_x, true_y, true_theta."""
    topics: Topics = field(default_factory=Topics)
    """Topics of a bag."""

    def reading(self) -> dict[str, Any]:
        """Return the options of `turtlebot_gym.drives.read`."""
        truth = None if self.truth in ("auto", "none") else self.truth
        return {"topics": self.topics, "columns": columns_of(self.columns), "truth": truth}
