"""Trainings of several seeds, or of several configurations, as units of work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from turtlebot_gym_agents.cluster.store import Store
from turtlebot_gym_agents.cluster.units import training
from turtlebot_gym_agents.cluster.work import Workers, complete, in_turn
from turtlebot_gym_agents.files import replacing
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import TrainingResult


def train_all(
    configs: Sequence[TrainingConfig],
    folders: Sequence[Path],
    *,
    workers: Workers = in_turn,
    store: Store | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Iterator[TrainingResult]:
    """Train policies, and write for each the files of `training.train.train` except checkpoints and logs.

    Args:
        configs: Configurations of the trainings.
        folders: Folder for the files of each.
        workers: See `work.complete`, as for the next two.
        store: Store of the results.
        progress: Called with the number of finished trainings.

    Raises:
        ValueError: As `training.train.train`, and if a folder holds a run that was trained here.
    """
    for folder in folders:
        if (folder / "checkpoint.zip").exists():
            raise ValueError(f"{folder} holds a run already: choose another folder.")
    units = [training(config) for config in configs]
    for folder, result in zip(folders, complete(units, workers=workers, store=store, progress=progress), strict=True):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in result.files.items():
            with replacing(folder / name) as beside:
                beside.write_bytes(content)
        yield TrainingResult(
            steps=result.facts["steps"],
            seconds=result.times["training"],
            steps_per_second=result.times["steps_per_second"],
            best=result.facts["best"],
            history=result.facts["history"],
        )
