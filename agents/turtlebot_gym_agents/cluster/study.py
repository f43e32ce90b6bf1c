"""A study: policies and trainings in every cell of a grid, on the same episodes, with intervals.

Each policy in each cell, and each training of each seed in each cell, is a job. Results of trainings include the variation
between the trained policies.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.cluster.grid import StudyGrid
from turtlebot_gym_agents.cluster.ledger import Ledger, files_in
from turtlebot_gym_agents.cluster.trainings import settings_of
from turtlebot_gym_agents.cluster.workers import Run, results
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome, compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval, holm, mean
from turtlebot_gym_agents.provenance import plain
from turtlebot_gym_agents.training.config import TrainingConfig

Label = tuple[str, int | None]
"""A policy and None, or a training and its seed."""


def study(
    grid: StudyGrid, folder: Path, *, run: Run = results, progress: Callable[[int, int], None] = lambda done, total: None
) -> list[dict[str, Any]]:
    """Return the results of policies and trainings in each cell.

    Args:
        grid: The study.
        folder: Folder of the study. Finished jobs are kept there and not repeated; ``policies`` holds the trained ones.
        run: Runs the jobs.
        progress: Called with the number of finished jobs and their total.

    Returns:
        Per cell its setting; per policy a summary and the paired difference of times to the baseline, s; per training the
        result of `evaluation.comparison.compare`, with p-values corrected over the whole study (Holm).

    Raises:
        ValueError: If a job fails, or the folder holds work of other code or settings.
    """
    cells = [(cell, _jobs_of(grid, cell)) for cell in grid.cells()]
    jobs = {name: job for _, parts in cells for name, job in parts.values()}
    ledger = Ledger(folder, {"episodes": grid.episodes, "seed": grid.seed})
    missing = {name: job for name, job in jobs.items() if name not in ledger.results}
    kept = len(jobs) - len(missing)
    progress(kept, len(jobs))
    for done, (name, (result, bundle)) in enumerate(run(missing), kept + 1):
        if bundle:
            with replacing(folder / "policies" / f"{name}.onnx") as beside:
                beside.write_bytes(bundle)
        ledger.add(name, result)
        progress(done, len(jobs))
    rows = [_row(grid, cell, {label: ledger.results[name] for label, (name, _) in parts.items()}) for cell, parts in cells]
    compared = [comparison for row in rows for comparison in row["trainings"].values()]
    for comparison, p in zip(compared, holm([comparison["p"] for comparison in compared]), strict=True):
        comparison["p_holm"] = p
    return rows


def _jobs_of(grid: StudyGrid, cell: Mapping[str, Any]) -> dict[Label, tuple[str, Callable[[], Any]]]:
    """Return the jobs of a cell, each with its name."""
    jobs: dict[Label, tuple[str, Callable[[], Any]]] = {}
    request = {**cell, "episodes": grid.episodes, "seed": grid.seed}
    for training in grid.trainings:  # first, since they take longest
        for config in grid.trainings_of(training, cell):
            name = _name(f"{training} seed {config.seed}", cell, {**cell, **settings_of(config)})
            jobs[training, config.seed] = name, partial(_train_and_drive, config, request)
    for policy in grid.policies:
        about = {**cell, **files_in([policy, *cell.values()])}
        jobs[policy, None] = _name(policy, cell, about), partial(_drive, {**request, "policy": policy})
    return jobs


def _name(label: str, cell: Mapping[str, Any], about: Mapping[str, Any]) -> str:
    """Return the name of a job, also for a file: what and where, and a hash of all that the job depends on."""
    digest = sha256(json.dumps(plain({"label": label, **about}), sort_keys=True).encode()).hexdigest()[:12]
    words = (str(value).removeprefix("turtlebot_gym/") for value in (label, *cell.values(), digest))
    return " ".join(words).replace("/", "-")


def _drive(request: Mapping[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Return the result of an evaluation as JSON types, and no bundle."""
    evaluation = evaluate(**request)
    return {"summary": evaluation.summary(), "outcome": PairedOutcome.of(evaluation).json()}, b""


def _train_and_drive(config: TrainingConfig, request: Mapping[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Return the result of the evaluation of a new policy, and its bundle."""
    from turtlebot_gym_agents.training.train import train

    with TemporaryDirectory(prefix="turtlebot-gym-") as folder:
        train(config, Path(folder), progress=False)
        bundle = Path(folder) / "policy.onnx"
        return _drive({**request, "policy": str(bundle)})[0], bundle.read_bytes()


def _row(grid: StudyGrid, cell: Mapping[str, Any], results: Mapping[Label, Mapping[str, Any]]) -> dict[str, Any]:
    outcomes = {label: PairedOutcome.read(result["outcome"]) for label, result in results.items()}
    baseline = outcomes[grid.compare_with, None]

    def beside(label: Label) -> dict[str, Any]:
        summary = {name: Interval(*values) for name, values in results[label]["summary"].items()}
        return {**summary, "difference": mean(outcomes[label].times - baseline.times)}

    policies, trainings = {policy: beside((policy, None)) for policy in grid.policies}, {}
    for name in grid.trainings:
        learned = [label for label in outcomes if label[0] == name and label[1] is not None]
        if len(learned) > 1:
            trainings[name] = compare([outcomes[label] for label in learned], baseline)
        else:  # a single training says nothing about the spread of trainings: treat it as a policy
            policies[name] = beside(learned[0])
    return {"setting": dict(cell), "compared_with": grid.compare_with, "policies": policies, "trainings": trainings}
