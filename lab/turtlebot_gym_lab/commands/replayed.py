"""The result of ``replay``: errors and NEES of a filter on recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.commands.report import ERRORS, error_cells
from turtlebot_gym_agents.figures import plot_drive
from turtlebot_gym_agents.front.results import Result, axes_or_new, name_of, with_legend
from turtlebot_gym_lab.commands.replay import GENERATED
from turtlebot_gym_lab.evaluation.replay import Replayed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CAPTION = "NEES of the pose, mean: 3 if the filter's covariance is right, more if it is too sure of itself"


@dataclass(frozen=True, kw_only=True, repr=False)
class ReplayResult(Result):
    """A filter on recordings.

    It prints as a table. Arrays have a number per recording, such as ``nees``, ``filter_position_mean`` and
    ``raw_position_mean``.
    """

    results: Mapping[Path, Replayed]
    """Result of each recording."""
    drives: Mapping[Path, Drive]
    """The recordings, as they were replayed."""
    sensors: Mapping[Path, str]
    """Where the measured poses of each come from: a topic, "recorded" or "generated"."""
    title: str
    """Title of the table."""
    config: Mapping[str, Any]
    """What the result depends on."""

    @property
    def labels(self) -> dict[Path, str]:
        """Name of each recording: that of its file, or the path where two have the same."""
        names = [path.name for path in self.results]
        return {path: path.name if names.count(path.name) == 1 else str(path) for path in self.results}

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Means over the seeds, by name, shape (recordings,)."""
        rows = []
        for result in self.results.values():
            parts = {"raw": result.raw, "wheels": result.wheels, "filter": result.filter}
            means = {
                f"{part}_{name}": np.mean(values) for part, each in parts.items() for name, values in each._asdict().items()
            }
            rows.append({**means, "nees": np.mean(result.nees), "drift": result.drift, "drift_heading": result.drift_heading})
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}

    def rows(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """Return a row per recording."""
        return {"recording": [*self.labels.values()], **self.arrays}

    def tables(self) -> tuple[Table, ...]:
        """Return the errors of each recording, and the drift of its wheels."""
        columns = "", "", *ERRORS, "drift, m per metre", "drift, rad per metre", "NEES"
        table = Table(*columns, title=self.title, caption=CAPTION)
        table.columns[0].no_wrap = table.columns[1].no_wrap = True
        for path, found in self.results.items():
            drift = f"{found.drift:.3f}", f"{found.drift_heading:.3f}"
            table.add_section()
            table.add_row(self.labels[path], "measured pose", *error_cells(found.raw))
            table.add_row("", "wheels alone", *error_cells(found.wheels), *drift)
            table.add_row("", "filter", *error_cells(found.filter), "", "", f"{np.mean(found.nees):.2f}")
        return (table,)

    def verdict(self) -> str:
        """Return where the measured poses of each recording come from."""
        sentences = []
        for path, sensor in self.sensors.items():
            how = f"generated from the truth, noise {name_of(self.config['noise'])}" if sensor == GENERATED else "recorded"
            sentences.append(f"{self.labels[path]}: measured poses {how}{f' on {sensor}' if sensor.startswith('/') else ''}.")
        return "\n".join(sentences)

    def content(self) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return each recording's result, and the configuration."""
        runs = [{"file": path, "measured": self.sensors[path], **each.summary()} for path, each in self.results.items()]
        return {"runs": runs}, self.config

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the first recording with the filter's estimate, seen from above."""
        return with_legend(plot_drive(axes_or_new(axes), next(iter(self.results.values())).trajectory))
