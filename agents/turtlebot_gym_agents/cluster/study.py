"""The command ``study``: policies and trainings in every cell of a grid, on the same episodes, with intervals; each, of each
seed, is a job.

Its file is YAML; values in ``grid`` may be lists, and each combination of them is a cell::

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
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import tyro

from turtlebot_gym.config import Range, as_int, build, check_fields, choose, short_repr
from turtlebot_gym.files import load
from turtlebot_gym_agents.cluster.workers import run
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome, compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate, require_known
from turtlebot_gym_agents.evaluation.metrics import Interval, holm, mean
from turtlebot_gym_agents.front.results import text_of
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.outputs import JSON, require_outputs
from turtlebot_gym_agents.policies.named import bare
from turtlebot_gym_agents.provenance import provenance, write_json
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
    grid = read_grid(file)
    rows = results_of(grid, out, cluster=cluster, workers=workers)
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


class _Result(NamedTuple):
    """What a job returns."""

    summary: dict[str, Interval]
    outcome: PairedOutcome
    bundle: bytes = b""
    """The trained policy; empty for another one."""


def results_of(
    grid: StudyGrid, folder: Path, *, cluster: str | None = None, workers: int | None = None
) -> list[dict[str, Any]]:
    """Return the results of policies and trainings in each cell of a study.

    joblib keeps finished jobs in the folder, which the same commit does not repeat on the same files; ``policies`` in it holds
    the trained ones. Jobs run where `workers.run` says.

    Each result has the cell's setting; per policy a summary and the paired difference of times to the baseline, s; per training
    the result of `evaluation.comparison.compare`, with p-values corrected over the whole study (Holm).
    """
    from joblib import Memory

    memory, code = Memory(folder / "jobs", verbose=0), provenance()
    drive, learn = memory.cache(_drive), memory.cache(_train_and_drive)
    labels, jobs = list[tuple[int, str, int | None]](), list[Any]()
    for at, cell in enumerate(grid.cells()):
        request = {**cell, "episodes": grid.episodes, "seed": grid.seed}
        for name in grid.trainings:  # first, since they take longest
            for config in grid.trainings_of(name, cell):
                labels.append((at, name, config.seed))
                jobs.append(partial(learn, config, request, (code, _files_in([*cell.values()]))))
        for policy in grid.policies:
            labels.append((at, policy, None))
            jobs.append(partial(drive, {**request, "policy": policy}, (code, _files_in([policy, *cell.values()]))))
    done = dict(zip(labels, run(jobs, cluster, workers), strict=True))
    for (at, name, seed), result in done.items():
        if result.bundle:
            path = folder / "policies" / f"cell {at}, {name}, seed {seed}.onnx"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(result.bundle)
    rows = [
        _row(grid, cell, {label[1:]: result for label, result in done.items() if label[0] == at})
        for at, cell in enumerate(grid.cells())
    ]
    compared = [comparison for row in rows for comparison in row["trainings"].values()]
    for comparison, p in zip(compared, holm([comparison["p"] for comparison in compared]), strict=True):
        comparison["p_holm"] = p
    return rows


def _files_in(values: list[Any]) -> dict[str, bytes]:
    """Return the content of the files that some values name, on which a job depends too."""
    paths = (Path(bare(value)) for value in values if isinstance(value, str))
    return {str(path): path.read_bytes() for path in paths if path.is_file()}


def _drive(request: Mapping[str, Any], made_of: Any) -> _Result:
    """Return the result of an evaluation; ``made_of`` names the code and the files that it depends on."""
    evaluation = evaluate(**request)
    return _Result(evaluation.summary(), PairedOutcome.of(evaluation))


def _train_and_drive(config: TrainingConfig, request: Mapping[str, Any], made_of: Any) -> _Result:
    """Return the result of the evaluation of a new policy, and its bundle."""
    from turtlebot_gym_agents.training.train import train

    with TemporaryDirectory(prefix="turtlebot-gym-") as folder:
        train(config, Path(folder), progress=False)
        bundle = Path(folder) / "policy.onnx"
        return _drive({**request, "policy": str(bundle)}, made_of)._replace(bundle=bundle.read_bytes())


def _row(grid: StudyGrid, cell: Mapping[str, Any], results: Mapping[tuple[str, int | None], _Result]) -> dict[str, Any]:
    baseline = results[grid.compare_with, None].outcome

    def beside(result: _Result) -> dict[str, Any]:
        return {**result.summary, "difference": mean(result.outcome.times - baseline.times)}

    policies, trainings = {policy: beside(results[policy, None]) for policy in grid.policies}, {}
    for name in grid.trainings:
        learned = [result for (of, seed), result in results.items() if of == name and seed is not None]
        if len(learned) > 1:
            trainings[name] = compare([result.outcome for result in learned], baseline)
        else:  # a single training says nothing about the spread of trainings: treat it as a policy
            policies[name] = beside(learned[0])
    return {"setting": dict(cell), "compared_with": grid.compare_with, "policies": policies, "trainings": trainings}
