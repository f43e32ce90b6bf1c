"""The subcommand ``study``, which compares many policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.commands.console import Placement, ReportingOptions, print_tables, progress
from turtlebot_gym_agents.outputs import FOLDER

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Study(Placement, ReportingOptions):
    """Compare policies and trainings in every combination of settings that a YAML file names.

    The same command resumes an interrupted study.
    """

    file: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FILE.yaml")]]
    """The study: episodes, seed, compare_with, grid, policies, trainings."""
    out: Annotated[Path, FOLDER] = Path("runs/study")
    """Folder of the study, in which finished jobs and trained policies are kept."""

    def run(self) -> None:
        from turtlebot_gym_agents.cluster.grid import read_grid
        from turtlebot_gym_agents.cluster.study import study

        grid = read_grid(self.file)
        with progress(1) as advance_to:
            rows = study(grid, self.out, run=self.runner(), progress=advance_to)
        drawn = _table(rows, title=f"{self.file}: {grid.episodes} episodes from seed {grid.seed}")
        print_tables(drawn, keys=1 + [column.header for column in drawn.columns].index("policy"))
        self.report({"cells": rows}, vars(grid))

    def resuming(self) -> str:
        """Return how to continue after an interruption."""
        return f"The same command continues: finished jobs are in {self.out}."


def _table(rows: Sequence[dict[str, Any]], *, title: str) -> Table:
    """Return a table of a study's results: a row per policy and training in each cell."""
    from rich.table import Table

    varied = [name for name in rows[0]["setting"] if len({str(row["setting"][name]) for row in rows}) > 1]
    drawn = Table(
        *varied,
        "policy",
        "success, %",
        "time*, s",
        f"minus {rows[0]['compared_with']}, s",
        "p (Holm)",
        title=title,
        caption="with 95 % intervals, for trainings over seeds, too; * failures count as the time limit",
    )
    for row in rows:
        drawn.add_section()
        for name, result in {**row["policies"], **row["trainings"]}.items():
            many = f", {result['trainings']} trainings" if "trainings" in result else ""
            time, gap = result["time"], result["difference"]
            drawn.add_row(
                *(str(row["setting"][option]).removeprefix("turtlebot_gym/") for option in varied),
                f"{name}{many}",
                f"{result['success']:.1%}",
                f"{time.value:.2f} ± {0.5 * (time.high - time.low):.2f}",
                "" if name == row["compared_with"] else f"{gap:+.2f}",
                f"{result['p_holm']:.2g}" if "p_holm" in result else "",
            )
    return drawn
