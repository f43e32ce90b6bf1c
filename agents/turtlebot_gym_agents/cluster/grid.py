"""The command ``study`` and its file, YAML. Values in ``grid`` may be lists; each combination of them is a cell::

episodes: 2000
seed: 1000000
compare_with: bearing
grid:
  env: turtlebot_gym/TurtleBotNav-v0
  noise: [tutorial, documented]
policies: [bearing, proportional]
trainings:
  ppo: {algo: ppo, seeds: 3, steps: 200000}
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym import Options
from turtlebot_gym.config import Range, as_int, build, check_fields, choose, short_repr
from turtlebot_gym.files import load
from turtlebot_gym_agents.evaluation.evaluate import require_known
from turtlebot_gym_agents.front.results import text_of
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.outputs import JSON, require_outputs
from turtlebot_gym_agents.provenance import write_json
from turtlebot_gym_agents.training.config import TrainingConfig

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class StudyGrid:
    """Contents of a study. Every policy drives in every cell; every training is repeated in every cell."""

    policies: tuple[str, ...]
    """Names for `turtlebot_gym_agents.make_policy`."""
    grid: Mapping[str, Any] = field(default_factory=dict)
    """Settings by name, each a value or a list of values."""
    trainings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Trainings by name: fields of `training.config.TrainingConfig`, and ``seeds``, the number of seeds, from seed 0."""
    compare_with: str = ""
    """Policy whose times are subtracted; by default the first one."""
    episodes: Annotated[int, Range(2, 10**9, whole=True)] = 1000
    """Episodes of each policy in each cell."""
    seed: int = 0
    """Seed of the first episode."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        if not self.policies or not all(isinstance(name, str) for name in self.policies):
            raise ValueError(f"policies must be names, at least one, got {short_repr(list(self.policies))}.")
        object.__setattr__(self, "compare_with", self.compare_with or self.policies[0])
        choose("compare_with", self.compare_with, dict.fromkeys(self.policies))
        for name in self.grid:
            choose("grid", name, dict.fromkeys(("env", *(item.name for item in fields(Options)))))
        for cell in self.cells():
            require_known(cell["env"], self.seed)
            for name in self.trainings:
                self.trainings_of(name, cell)

    def cells(self) -> list[dict[str, Any]]:
        """Return the combinations of settings."""
        names = {"env": "nav", **self.grid}
        cells = [dict(zip(names, values, strict=True)) for values in itertools.product(*map(_listed, names.values()))]
        return [{**cell, "env": environment_id(cell["env"])} for cell in cells]

    def trainings_of(self, name: str, cell: Mapping[str, Any]) -> list[TrainingConfig]:
        """Return the configurations of a training in a cell, one per seed."""
        settings = {**self.trainings[name], **cell}
        seeds = as_int(f"seeds of training {short_repr(name)}", settings.pop("seeds", 1), 1, 1000)
        if "config" in settings:
            settings["config"] = Path(settings["config"])
        return [build(TrainingConfig, {**settings, "seed": seed}, f"training {short_repr(name)}") for seed in range(seeds)]


def read_grid(path: Path) -> StudyGrid:
    """Read a study; a refusal names the file."""
    content = load(path)
    try:
        if isinstance(content, Mapping) and "policies" in content:
            content = {**content, "policies": tuple(_listed(content["policies"]))}
        return build(StudyGrid, content, "a study")
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def study(
    file: tyro.conf.Positional[Path],
    out: Path = Path("runs/study"),
    *,
    cluster: str | None = None,
    workers: int | None = None,
    json: Path | None = None,
    force: bool = False,
) -> str:
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
    from turtlebot_gym_agents.cluster.study import study as run_study

    grid = read_grid(file)
    rows = run_study(grid, out, cluster=cluster, workers=workers)
    if json is not None:
        write_json(json, {"cells": rows}, config=vars(grid))
    return text_of([_study_table(rows, title=f"{file}: {grid.episodes} episodes from seed {grid.seed}")])


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
