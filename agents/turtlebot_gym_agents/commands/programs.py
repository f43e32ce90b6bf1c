"""The command ``study``, which is no part of the Python front door."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from turtlebot_gym_agents.front.results import Shown
from turtlebot_gym_agents.outputs import JSON, require_outputs
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from rich.table import Table


def study(
    file: tyro.conf.Positional[Path],
    out: Path = Path("runs/study"),
    *,
    cluster: str | None = None,
    workers: int | None = None,
    json: Path | None = None,
    force: bool = False,
) -> Shown:
    """Compare policies and trainings in every combination of settings that a YAML file names.

    The same command resumes an interrupted study.

    Args:
        file: The study: episodes, seed, compare_with, grid, policies, trainings.
        out: Folder of the study, in which finished jobs and trained policies are kept.
        cluster: Where jobs run: local, or the address of a Ray cluster.
        workers: With --cluster local: number of processes.
        json: Write the results here.
        force: Overwrite a file that exists.
    """
    require_outputs([("--json", json, JSON)], inputs=[file], force=force)
    from turtlebot_gym_agents.cluster import study as program
    from turtlebot_gym_agents.cluster.grid import read_grid

    grid = read_grid(file)
    rows = program.study(grid, out, cluster=cluster, workers=workers)
    if json is not None:
        write_json(json, {"cells": rows}, config=vars(grid))
    return Shown(_study_table(rows, title=f"{file}: {grid.episodes} episodes from seed {grid.seed}"))


def _study_table(rows: Sequence[dict[str, Any]], *, title: str) -> Table:
    """Return a row per policy and training in each cell."""
    from rich.table import Table

    varied = [name for name in rows[0]["setting"] if len({str(row["setting"][name]) for row in rows}) > 1]
    columns = ("policy", "success, %", "time*, s", f"minus {rows[0]['compared_with']}, s", "p (Holm)")
    caption = "with 95 % intervals, for trainings over seeds, too; * failures count as the time limit"
    drawn = Table(*varied, *columns, title=title, caption=caption)
    for row in rows:
        drawn.add_section()
        for name, result in {**row["policies"], **row["trainings"]}.items():
            many = f", {result['trainings']} trainings" if "trainings" in result else ""
            drawn.add_row(
                *(str(row["setting"][option]).removeprefix("turtlebot_gym/") for option in varied),
                f"{name}{many}",
                f"{result['success']:.1%}",
                f"{result['time']:.2f}",
                "" if name == row["compared_with"] else f"{result['difference']:+.2f}",
                f"{result['p_holm']:.2g}" if "p_holm" in result else "",
            )
    return drawn
