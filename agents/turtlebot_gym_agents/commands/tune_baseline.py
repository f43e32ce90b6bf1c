"""The subcommand ``tune-baseline``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from turtlebot_gym_agents.commands.console import JsonFile, Setting, Writing, print_tables, progress
from turtlebot_gym_agents.commands.flags import own_first
from turtlebot_gym_agents.outputs import JSON
from turtlebot_gym_agents.provenance import write_json

SHOWN = 5
"""Number of tries in the table, fastest first."""


@own_first
@dataclass(frozen=True, kw_only=True)
class TuneBaseline(Writing, Setting):
    """Tune a baseline's numbers for a scenario, and write the best to OUT, a file for --policy.

    A policy trained for a scenario should be compared with a baseline tuned for it. The same command resumes an interrupted
    search.
    """

    policy: str = "bearing"
    """The baseline: proportional, bearing, corner, polar, rotate-drive-rotate, and for rooms vfh, gap or dwa."""
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
        if self.json is not None:
            write_json(self.json, {"tries": [asdict(attempt) for attempt in tries]}, config=self.asked())
