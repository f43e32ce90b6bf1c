"""A study: policies and trainings in every cell of a grid, on the same episodes, with intervals; each, of each seed, is a
job.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from turtlebot_gym_agents.cluster.grid import StudyGrid
from turtlebot_gym_agents.cluster.workers import run
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome, compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval, holm, mean
from turtlebot_gym_agents.policies.named import bare
from turtlebot_gym_agents.provenance import provenance
from turtlebot_gym_agents.training.config import TrainingConfig


class _Result(NamedTuple):
    """What a job returns."""

    summary: dict[str, Interval]
    outcome: PairedOutcome
    bundle: bytes = b""
    """The trained policy; empty for another one."""


def study(grid: StudyGrid, folder: Path, *, cluster: str | None = None, workers: int | None = None) -> list[dict[str, Any]]:
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
