"""Trainings of several seeds as jobs."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from turtlebot_gym.files import load
from turtlebot_gym_agents.cluster.ledger import files_in, require_same
from turtlebot_gym_agents.cluster.workers import results
from turtlebot_gym_agents.training.config import TrainingConfig, require_no_run

if TYPE_CHECKING:
    from turtlebot_gym_agents.training.train import TrainingResult


def train_seeds(
    config: TrainingConfig,
    folders: dict[int, Path],
    *,
    cluster: str | None,
    workers: int | None,
) -> dict[int, TrainingResult]:
    """Train a policy with several seeds; repeated, it keeps finished trainings, and begins unfinished ones anew.

    Args:
        config: Configuration of the trainings, except the seed.
        folders: Folder of each seed's run, all in one folder, which every machine of a cluster must share.
        cluster: Where the jobs run, as for `workers.results`.
        workers: Number of processes.

    Raises:
        ValueError: As `training.train.train`, and if the folder holds trainings of other code or settings.
    """
    shared = next(iter(folders.values())).parent / "settings.json"
    if not shared.exists():
        for folder in folders.values():
            require_no_run(folder)
    about = settings_of(config)
    del about["seed"]
    require_same(shared, about)
    jobs = {
        f"seed {seed}": partial(_train, replace(config, seed=seed, config=config.hyper), folder.resolve())
        for seed, folder in folders.items()
    }
    done = dict(results(jobs, cluster=cluster, workers=workers))
    return {seed: done[f"seed {seed}"] for seed in folders}


def settings_of(config: TrainingConfig) -> dict[str, Any]:
    """Return all on which a training depends, files included, as JSON types."""
    settings = {name: value for name, value in config.settings().items() if name not in ("config", "device")}
    return {**settings, "hyperparameters": dict(config.hyper), **files_in([config.from_policy, *config.options.values()])}


def _train(config: TrainingConfig, folder: Path) -> TrainingResult:
    """Train, unless the folder holds a finished training. The folder appears when the training is finished."""
    from turtlebot_gym_agents.training.train import TrainingResult, train

    if (folder / "result.json").exists():
        return TrainingResult(**load(folder / "result.json"))
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    result = train(config, unfinished, progress=False)
    unfinished.replace(folder)
    return result
