"""The subcommand ``map``."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from turtlebot_gym_agents.commands.console import FigureFile, ReportingOptions, print_tables, progress, save_figure
from turtlebot_gym_agents.outputs import OutputFile
from turtlebot_gym_lab.drives.topics import Topics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from turtlebot_gym_lab.scans.mapping import DrivenMap

STEPS = 3
"""Parts of the work, for its progress bar."""


@dataclass(frozen=True, kw_only=True)
class Map(ReportingOptions):
    """Draw the map of a place from one recorded drive through it, by its odometry and scans, to localize the next drive in.

    Each scan is matched with the map so far, from where the odometry says that it is, and averaged into it. The map begins
    where the drive does: there x, y and heading are 0. It is for places of some tens of metres whose rooms the drive goes
    through; loops are not closed: for a building with long ways round use slam_toolbox.
    """

    file: tyro.conf.Positional[Path]
    """Recording with odometry and scans: a bag, or laser arrays."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE.yaml"), OutputFile((".yaml", ".yml"))]
    """Write the map here, as map_server takes it (FILE.yaml), with its image FILE.pgm beside it."""
    resolution: float = 0.05
    """Side of a cell, m."""
    lidar: str = "lds01"
    """LiDAR, a preset or a file of your own (FILE.yaml), whose mount counts where no transform states another."""
    mount: tuple[float, float, float] | None = None
    """Pose of the LiDAR on the robot: x, y, heading; m, m, rad. Default: as the transforms of the bag state it, else as
    assumed, which is said."""
    topics: Topics = field(default_factory=Topics)
    """Topics of a bag."""
    plot: FigureFile = None
    """Draw the map and the drive's path here."""

    def run(self) -> None:
        from rich.table import Table

        from turtlebot_gym.config import POSITIVE
        from turtlebot_gym_lab.drives import read
        from turtlebot_gym_lab.scans.map_files import write_map
        from turtlebot_gym_lab.scans.mapping import map_of

        resolution = POSITIVE.check("resolution", self.resolution)
        done = 0
        with progress(STEPS) as advance_to:

            def advance(part: str) -> None:
                nonlocal done
                done += 1
                advance_to(min(done, STEPS))

            drive = read(self.file, lidar=self.lidar, mount=self.mount, topics=self.topics)
            for remark in drive.remarks:
                print(remark, file=sys.stderr)
            drawn = map_of(drive, resolution=resolution, progress=advance)
        write_map(drawn.grid, self.out, force=self.force)
        rows, columns = drawn.grid.cells.shape
        way = float(np.hypot(*np.diff(drawn.poses[:, :2], axis=0).T).sum())
        table = Table("", "", title=f"{self.file.name}: map {self.out.name}")
        for name, value in (
            ("size, m", f"{columns * resolution:.2f} x {rows * resolution:.2f}"),
            ("way, m", f"{way:.1f}"),
            ("scans averaged, of all", f"{drawn.fused} of {len(drawn.fits)}"),
            ("beams that fit, median, %", f"{100.0 * float(np.median(drawn.fits)):.1f}"),
            ("scans that fit nothing", f"{int((drawn.fits == 0.0).sum())}"),
        ):
            table.add_row(name, value)
        print_tables(table)
        self.report(
            {
                "size": [rows, columns],
                "origin": drawn.grid.origin,
                "poses": drawn.poses,
                "fits": drawn.fits,
                "fused": drawn.fused,
            }
        )
        if self.plot is not None:
            save_figure(figure_of(drawn, title=self.file.name), self.plot)


def figure_of(drawn: DrivenMap, *, title: str) -> Figure:
    """Return a figure of a map with the path that was driven."""
    from matplotlib.figure import Figure

    from turtlebot_gym.plotting import BLUE
    from turtlebot_gym.rooms.grid import FREE, OCCUPIED

    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    axes = figure.subplots()
    grid, (rows, columns) = drawn.grid, drawn.grid.cells.shape
    shade = np.select([grid.cells == OCCUPIED, grid.cells == FREE], [0.0, 1.0], 0.8)
    x, y, side = grid.origin.x, grid.origin.y, grid.resolution
    axes.imshow(shade, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=(x, x + columns * side, y, y + rows * side))
    axes.plot(drawn.poses[:, 0], drawn.poses[:, 1], color=BLUE, linewidth=1.0, label="path")
    axes.plot(0.0, 0.0, "o", color=BLUE, label="start")
    axes.set(title=title, xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.legend()
    return figure
