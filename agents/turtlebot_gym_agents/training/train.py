"""Train a policy with Stable-Baselines3 on the native vector environment.

A run's folder holds ``config.json`` (everything that the run depends on), ``best.zip`` (the best model on the evaluation's
seeds), ``policy.onnx`` (its bundle, once the run is done), ``result.json`` and TensorBoard logs. Files are replaced atomically.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from gymnasium.vector import VectorEnv
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from turtlebot_gym.compiled.threads import limited
from turtlebot_gym_agents.provenance import replace_json
from turtlebot_gym_agents.training.callbacks import (
    EvaluationCallback,
    ProgressCallback,
    RecordCallback,
    RewardCallback,
)
from turtlebot_gym_agents.training.cloning import begin_with
from turtlebot_gym_agents.training.config import TrainingConfig, require_no_run
from turtlebot_gym_agents.training.model import make_model


@dataclass(frozen=True, kw_only=True)
class TrainingResult:
    """Result of a training run."""

    steps: int
    """Environment steps."""
    seconds: float
    """Wall time, s."""
    steps_per_second: float
    """Environment steps per second, evaluations and export included."""
    best: Mapping[str, float]
    """Figures of the best model."""
    history: list[dict[str, float]] = field(default_factory=list)
    """Figures of all evaluations of the run."""
    stopped: str | None = None
    """What ended the training before its number of steps: "until" or nothing."""


def train(
    config: TrainingConfig,
    folder: str | Path,
    *,
    progress: bool = True,
    callbacks: Sequence[BaseCallback] = (),
) -> TrainingResult:
    """Train one policy.

    Args:
        config: Configuration of the training.
        folder: Folder for the run's files.
        progress: Whether to show a bar.
        callbacks: Additional callbacks.

    Returns:
        The result; the folder holds the policy.

    Raises:
        ValueError: If the device is missing, or the folder holds a run.
    """
    start, folder = time.perf_counter(), Path(folder)
    require_no_run(folder)
    bar = ProgressCallback(config.total, label=config.title)
    with closing(config.make_training()) as envs, closing(config.make_judging()) as judges:
        judge = EvaluationCallback(
            judges,
            path=folder / "best.zip",
            every=config.between_evaluations,
            episodes=config.episodes,
            go_on=lambda figures: not config.reached(figures),
            confirm=True,
        )
        watching = [*([bar] if progress else []), *callbacks]
        try:
            recorder = RecordCallback(config, folder, judge)
            observers = [judge, RewardCallback(), *watching, recorder]
            model = learn(config, envs, observers, tensorboard=folder / "tensorboard")
        finally:
            bar.stop()
    seconds = time.perf_counter() - start
    result = TrainingResult(
        steps=model.num_timesteps,
        seconds=seconds,
        steps_per_second=model.num_timesteps / seconds,
        best=judge.best,
        history=judge.history,
        stopped="until" if judge.stopped else None,
    )
    replace_json(folder / "result.json", asdict(result))
    return result


def learn(
    config: TrainingConfig,
    envs: VectorEnv,
    callbacks: Sequence[BaseCallback],
    *,
    tensorboard: Path | None = None,
) -> BaseAlgorithm:
    """Make a model, and train it.

    Args:
        config: Configuration of the training.
        envs: Environments to train in.
        callbacks: Callbacks of the training.
        tensorboard: Folder of the logs.
    """
    torch.set_num_threads(config.threads)
    model = make_model(config, envs, tensorboard=tensorboard)
    with limited(config.threads):
        learned = list(callbacks)
        if config.from_policy is not None:
            learned.append(begin_with(model, envs, config))
        model.learn(config.total, callback=learned, tb_log_name="run")
    return model
