"""The subcommands that compare many policies: ``study`` and ``tune-baseline``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.commands.console import JsonFile, Placement, Reporting, Setting, print_tables, progress
from turtlebot_gym_agents.commands.flags import own_first
from turtlebot_gym_agents.outputs import FOLDER, JSON

if TYPE_CHECKING:
    from rich.table import Table


SHOWN = 5
"""Number of tries in the table, fastest first."""


@own_first
@dataclass(frozen=True, kw_only=True)
class Study(Placement, Reporting):
    """Compare policies and trainings in every combination of settings that a YAML file names.

    An interrupted study resumes from its store.
    """

    file: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FILE.yaml")]]
    """The study: episodes, seed, compare_with, grid, policies, trainings."""
    out: Annotated[Path, FOLDER] = Path("runs/study")
    """Folder of the study; its store is OUT/units by default."""

    def run(self) -> None:
        from turtlebot_gym_agents.cluster.drives import DriveUnit
        from turtlebot_gym_agents.cluster.grid import read_grid, study
        from turtlebot_gym_agents.cluster.trainings import Training

        grid = read_grid(self.file)
        memory = Training.memory if grid.trainings else DriveUnit.memory
        with self.place(memory=memory, store=self.out / "units") as runner, progress(1) as advance_to:
            rows = study(grid, runner=runner, progress=advance_to)
        drawn = _table(rows, title=f"{self.file}: {grid.episodes} episodes from seed {grid.seed}")
        print_tables(drawn, keys=1 + [column.header for column in drawn.columns].index("policy"))
        self.report({"cells": rows}, {name: value for name, value in vars(grid).items() if name != "chunk"})

    def resuming(self) -> str:
        """Return how to continue after an interruption."""
        return f"The same command continues: finished units are in {self.store or self.out / 'units'}."


@own_first
@dataclass(frozen=True, kw_only=True)
class TuneBaseline(Reporting, Setting):
    """Tune a baseline's numbers for a scenario, and write the best to OUT, a file for --policy.

    A policy trained for a scenario should be compared with a baseline tuned for it. The same command resumes an interrupted
    search.
    """

    policy: str = "bearing"
    """The baseline: proportional, bearing, corner, polar, rotate-drive-rotate, and for rooms vfh, gap, dwa or planner."""
    tries: int = 40
    """Total number of tries, earlier ones included; the first one has the baseline's defaults."""
    episodes: int = 2000
    """Episodes per try, the same for all tries; evaluations and trainings use other seeds."""
    seed: int = 0
    """Seed of the search."""
    out: Annotated[Path, JSON._replace(resumed=True)] = Path("baseline.json")
    """File for the tuned baseline, with all tries."""
    json: JsonFile = None
    """Also write configuration and all tries here."""

    def run(self) -> None:
        from rich.table import Table

        from turtlebot_gym_agents.evaluation.tune_baseline import tune_baseline

        with progress(self.tries) as advance_to:
            tries = tune_baseline(
                self.policy,
                self.out,
                env=self.env,
                tries=self.tries,
                episodes=self.episodes,
                seed=self.seed,
                progress=advance_to,
                **self.options(),
            )
        table = Table("try", "time, s", "success, %", "numbers", title=f"{self.env}, {self.policy}: the best of {len(tries)}")
        ranked = sorted(range(len(tries)), key=lambda at: tries[at].time)
        for at in dict.fromkeys([*ranked[:SHOWN], 0]):
            attempt = tries[at]
            numbers = ", ".join(f"{name} {value:g}" for name, value in attempt.numbers.items())
            table.add_row(str(at) if at else "0, defaults", f"{attempt.time:.3f}", f"{100.0 * attempt.success:.1f}", numbers)
        print_tables(table)
        print(f"Use it with --policy {self.out}.")
        self.report({"tries": [asdict(attempt) for attempt in tries]})

    def resuming(self) -> str:
        """Return how to continue after an interruption."""
        return f"The same command continues from the tries in {self.out}."


def _table(rows: Sequence[dict[str, Any]], *, title: str) -> Table:
    """Return a table of a study's results: a row per policy and training in each cell."""
    from rich.table import Table

    varied = [name for name in rows[0]["setting"] if len({str(row["setting"][name]) for row in rows}) > 1]
    drawn = Table(
        *varied, "policy", "success, %", "time*, s", f"minus {rows[0]['compared_with']}, s", "p (Holm)",
        title=title, caption="with 95 % intervals, for trainings over seeds, too; * failures count as the time limit",
    )  # fmt: skip
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
