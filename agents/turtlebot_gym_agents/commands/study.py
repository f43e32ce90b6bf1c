"""The subcommand ``study``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.commands.console import File, print_tables, progress
from turtlebot_gym_agents.commands.placement import Placement
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Study(Placement):
    """Compare policies and trainings in every combination of settings that a YAML file names.

    A study that was stopped goes on: what is done is in its store.
    """

    file: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FILE.yaml")]]
    """The study: episodes, seed, compare_with, grid, policies, trainings."""
    out: Path = Path("runs/study")
    """Folder of its store, OUT/units, if no other is told."""
    json: File = None
    """Write configuration and results here."""

    def run(self) -> None:
        """Do the study, print a table, and write what is asked for."""
        from turtlebot_gym_agents.cluster.grid import read_grid, study
        from turtlebot_gym_agents.cluster.units import Drive, Training

        grid = read_grid(self.file)
        memory = Training.memory if grid.trainings else Drive.memory
        with self.place(memory=memory, store=self.out / "units") as place, progress(1) as advance_to:
            rows = study(grid, **place._asdict(), progress=lambda done, total: advance_to(done, total))
        drawn = table(rows, title=f"{self.file}: {grid.episodes} episodes from seed {grid.seed}")
        print_tables(drawn, keys=1 + [column.header for column in drawn.columns].index("policy"))
        if self.json is not None:
            write_json(
                self.json, {"cells": rows}, config={name: value for name, value in vars(grid).items() if name != "chunk"}
            )


def table(rows: Sequence[dict[str, Any]], *, title: str) -> Table:
    """Return a study's results: a row for each policy and training in each cell."""
    from rich.table import Table

    varied = [name for name in rows[0]["setting"] if len({str(row["setting"][name]) for row in rows}) > 1]
    drawn = Table(
        *varied, "policy", "success, %", "time*, s", f"minus {rows[0]['compared_with']}, s", "p (Holm)",
        title=title, caption="with 95 % intervals, for trainings over seeds, too; * failures count as the time limit",
    )  # fmt: skip
    for row in rows:
        drawn.add_section()
        for name, one in {**row["policies"], **row["trainings"]}.items():
            many = f", {one['trainings']} trainings" if "trainings" in one else ""
            low, high = 100.0 * one["success"].low, 100.0 * one["success"].high
            time, gap = one["time"], one["difference"]
            drawn.add_row(
                *(str(row["setting"][each]).removeprefix("turtlebot_gym/") for each in varied),
                f"{name}{many}",
                f"{100.0 * one['success'].value:.1f} ({low:.1f}, {high:.1f})",
                f"{time.value:.2f} ± {0.5 * (time.high - time.low):.2f}",
                "" if name == row["compared_with"] else f"{gap.value:+.2f} ({gap.low:+.2f}, {gap.high:+.2f})",
                f"{one['p_holm']:.2g}" if "p_holm" in one else "",
            )
    return drawn
