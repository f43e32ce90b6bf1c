"""The subcommand ``localize``."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tyro

from turtlebot_gym_agents.commands.console import FigureFile, JsonFile, ReportingOptions, print_tables, progress, save_figure
from turtlebot_gym_lab.commands.recorded import StartOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from turtlebot_gym.drive import Drive
    from turtlebot_gym.rooms.grid import GridMap
    from turtlebot_gym_lab.evaluation.localize import RecordedCourse


@dataclass(frozen=True, kw_only=True)
class Localize(ReportingOptions, StartOptions):
    """Localize a recorded drive in a map by its odometry and scans, and compare with its truth, if it has one."""

    file: tyro.conf.Positional[Path]
    """Recording with odometry and scans: a bag, or laser arrays."""
    map: Path
    """Map, as map_server takes it (FILE.yaml)."""
    json: JsonFile = None
    """Write configuration, results and the belief at each row here."""
    plot: FigureFile = None
    """Draw the path in the map here."""

    def run(self) -> None:
        from rich.table import Table

        from turtlebot_gym.drive import known
        from turtlebot_gym_lab.drives import read
        from turtlebot_gym_lab.evaluation.localize import STATES, errors_of, evidence_of, localize, recorded_of

        with progress(3) as advance_to:
            drive = self.localizable(read(self.file, **self.reading()))
            for remark in drive.remarks:
                print(remark, file=sys.stderr)
            advance_to(1)
            grid, place = self.place(self.map, drive, self.file)
            rows = np.flatnonzero(known(drive.truth))
            recorded, where = recorded_of(drive)
            advance_to(2)
            first = int(where[place.first])
            course = localize(recorded, place._replace(first=first))
        states = {name: float(np.mean(course.states[first:] == state)) for name, state in STATES.items()}
        judged = rows[rows >= place.first]
        errors = errors_of(course, where[judged], drive.truth[judged]) if len(judged) else {}
        evidence = evidence_of(course, recorded.odometry, first)
        table = Table("", "", title=f"{self.file.name} in {self.map.name}, {course.scans} scans")
        for name, figure in errors.items():
            table.add_row(LABELS[name], f"{figure:.3g}")
        table.add_row("beams that fit the map, mean, %", f"{100.0 * evidence['fits']:.1f}")
        table.add_row("leaps of more than 0.3 m or 0.3 rad", f"{evidence['leaps']:g}")
        for name, share in states.items():
            table.add_row(f"{name}, % of the rows", f"{100.0 * share:.1f}")
        print_tables(table)
        beliefs = {"poses": course.poses, "covariances": course.covariances, "fits": course.fits, "states": course.states}
        self.report(
            {
                "errors": errors,
                "evidence": evidence,
                "shares": states,
                "time": recorded.time,
                **beliefs,
            }
        )
        if self.plot is not None:
            save_figure(_path_figure(course, drive, grid, title=self.file.name), self.plot)


LABELS = {
    "median": "position error, median, m",
    "quantile95": "position error, 95 %, m",
    "worst": "position error, worst, m",
    "lost": "share beyond 0.5 m",
    "median_heading": "heading error, median, rad",
    "nees": "NEES, median (2.4 if exact)",
}
"""Headings of errors."""


def _path_figure(course: RecordedCourse, drive: Drive, grid: GridMap, *, title: str) -> Figure:
    """Return a figure of a localized drive in its map: the path, where the localizer was unsure, and the truth."""
    from matplotlib.figure import Figure

    from turtlebot_gym.localization.localizer import TRACKING
    from turtlebot_gym.rooms.grid import OCCUPIED

    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    axes = figure.subplots()
    rows, columns = np.nonzero(grid.cells == OCCUPIED)
    x, y, cosine, sine, side = grid.frame.tolist()
    along, up = (columns + 0.5) * side, (rows + 0.5) * side
    axes.plot(x + cosine * along - sine * up, y + sine * along + cosine * up, ",", color="0.6")
    axes.plot(drive.truth[:, 0], drive.truth[:, 1], "k.", markersize=3.0, label="truth")
    axes.plot(course.poses[:, 0], course.poses[:, 1], linewidth=1.0, label="localizer")
    doubtful = course.poses[course.states != TRACKING]
    axes.plot(doubtful[:, 0], doubtful[:, 1], "rx", markersize=4.0, label="unsure or lost")
    axes.set(title=title, xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.legend()
    return figure
