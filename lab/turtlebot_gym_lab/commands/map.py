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

NOTICEABLE = 0.005
"""Share of the ranges from which a map with the wheels' metres says that it differs from the LiDAR's."""
STEPS = 6
"""Parts of the work, for its progress bar."""


@dataclass(frozen=True, kw_only=True)
class Map(ReportingOptions):
    """Draw the map of a place from one recorded drive through it, by its odometry and scans, to localize the next drive in.

    The scans first tell what the wheels do and where the LiDAR is, as in `calibrate`. Each scan is then matched with the map so
    far and averaged into it. The map begins where the drive does: there x, y and heading are 0. It is for places of some tens
    of metres whose rooms the drive goes through; loops are not closed: for a building with long ways round use slam_toolbox.
    """

    file: tyro.conf.Positional[Path]
    """Recording with odometry and scans: a bag, or laser arrays."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE.yaml"), OutputFile((".yaml", ".yml"))]
    """Write the map here, as map_server takes it (FILE.yaml), with its image FILE.pgm beside it."""
    resolution: float = 0.05
    """Side of a cell, m."""
    metres: str = "wheels"
    """Whose metres count: wheels corrects the ranges by the way that odometry counts, where both differ by 5 % at most; lidar
    takes the ranges as they are. The report says by how much they differ."""
    lidar: str = "lds01"
    """LiDAR, a preset or a file of your own (FILE.yaml), whose mount counts until the scans show another."""
    topics: Topics = field(default_factory=Topics)
    """Topics of a bag."""
    plot: FigureFile = None
    """Draw the map and the drive's path here."""

    def run(self) -> None:
        from rich.table import Table

        from turtlebot_gym.validation import POSITIVE, choose
        from turtlebot_gym_lab.drives import read
        from turtlebot_gym_lab.scans.map_files import write_map
        from turtlebot_gym_lab.scans.mapping import METRES, map_of

        resolution, metres = POSITIVE.check("resolution", self.resolution), choose("metres", self.metres, METRES)
        done = 0
        with progress(STEPS) as advance_to:

            def advance(part: str) -> None:
                nonlocal done
                done += 1
                advance_to(min(done, STEPS))

            drive = read(self.file, lidar=self.lidar, topics=self.topics)
            for remark in drive.remarks:
                print(remark, file=sys.stderr)
            drawn = map_of(drive, resolution=resolution, metres=metres, progress=advance)
        write_map(drawn.grid, self.out, force=self.force)
        rows, columns = drawn.grid.cells.shape
        way = float(np.hypot(*np.diff(drawn.poses[:, :2], axis=0).T).sum())
        x, y, theta = drawn.wheels.mount
        table = Table("", "", title=f"{self.file.name}: map {self.out.name}")
        for name, value in (
            ("size, m", f"{columns * resolution:.2f} x {rows * resolution:.2f}"),
            ("way, m", f"{way:.1f}"),
            ("scans averaged, of all", f"{drawn.fused} of {len(drawn.fits)}"),
            ("beams that fit, median, %", f"{100.0 * float(np.median(drawn.fits)):.1f}"),
            ("scans that fit nothing", f"{int((drawn.fits == 0.0).sum())}"),
            ("ranges longer than the wheels say, %", f"{100.0 * (drawn.scale - 1.0):+.2f}"),
            ("of which the map takes off, %", f"{100.0 * drawn.range_share:+.2f}"),
            ("LiDAR at, m, m, rad", f"{x:.3f}, {y:.3f}, {theta:.3f}"),
        ):
            table.add_row(name, value)
        print_tables(table)
        if abs(drawn.range_share) > NOTICEABLE:
            off = f"the LiDAR's ranges are {100.0 * drawn.range_share:+.1f} % off in the wheels' metres of this map"
            print(
                f"{off}: localize in it with --localizer match, which estimates such a share, or draw it with --metres lidar.",
                file=sys.stderr,
            )
        self.report(
            {
                "size": [rows, columns],
                "origin": drawn.grid.origin,
                "poses": drawn.poses,
                "fits": drawn.fits,
                "fused": drawn.fused,
                "scale": drawn.scale,
                "range_share": drawn.range_share,
                "mount": drawn.wheels.mount._asdict() | {"upside_down": drawn.wheels.upside_down},
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
