"""Train a policy with Stable-Baselines3 on the native vector environment; an interruption costs only seconds of work.

A run's folder holds ``config.json`` (everything that the run depends on), ``checkpoint.zip`` (the last state, to resume from;
with ``checkpoint.replay.npz`` if there is a replay buffer), ``best.zip`` (the best model on the evaluation's seeds),
``policy.onnx`` (its bundle, once the run is done), ``evaluations.json`` (success and return at each evaluation),
``result.json`` and TensorBoard logs. Files are replaced atomically, so a killed run leaves them complete.

A resumed run is not the uninterrupted one to the bit: its environments begin new episodes, with new seeds.
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
from turtlebot_gym.files import load
from turtlebot_gym_agents.provenance import replace_json
from turtlebot_gym_agents.training.callbacks import (
    CheckpointCallback,
    EvaluationCallback,
    ProgressCallback,
    RecordCallback,
    RewardCallback,
)
from turtlebot_gym_agents.training.cloning import begin_with
from turtlebot_gym_agents.training.config import TrainingConfig, require_no_run
from turtlebot_gym_agents.training.history import NAME
from turtlebot_gym_agents.training.model import make_model


@dataclass(frozen=True, kw_only=True)
class TrainingResult:
    """Result of a training run."""

    steps: int
    """Environment steps, including those before an interruption."""
    seconds: float
    """Wall time of this call, s."""
    steps_per_second: float
    """Environment steps per second of this call, evaluations and export included."""
    best: Mapping[str, float]
    """Figures of the best model."""
    history: list[dict[str, float]] = field(default_factory=list)
    """Figures of all evaluations of the run, with those before an interruption."""
    stopped: str | None = None
    """What ended the training before its number of steps: "until" or nothing."""


def train(
    config: TrainingConfig,
    folder: str | Path,
    *,
    resume: bool = False,
    progress: bool = True,
    callbacks: Sequence[BaseCallback] = (),
) -> TrainingResult:
    """Train one policy.

    Args:
        config: Configuration of the training.
        folder: Folder for the run's files.
        resume: Resume from the folder's checkpoint, if there is one; nothing pickled in it is run.
        progress: Whether to show a bar.
        callbacks: Additional callbacks.

    Returns:
        The result; the folder holds the policy.

    Raises:
        ValueError: If the device is missing, or the folder holds a run and ``resume`` is not set, or a run of another
            configuration.
    """
    start, folder = time.perf_counter(), Path(folder)
    checkpoint = folder / "checkpoint.zip"
    begun = checkpoint if checkpoint.exists() else None
    if not resume:
        require_no_run(folder)
    if begun is not None:
        config = config.continuing(folder)
    written = folder / "result.json"
    reached = begun is not None and written.is_file() and config.reached(load(written)["best"])
    bar = ProgressCallback(config.total, label=config.title)
    with closing(config.make_training()) as envs, closing(config.make_judging()) as judges:
        judge = EvaluationCallback(
            judges,
            path=folder / "best.zip",
            history=folder / NAME,
            every=config.between_evaluations,
            episodes=config.episodes,
            go_on=lambda figures: not config.reached(figures),
            confirm=True,
        )
        saver = CheckpointCallback(checkpoint, seconds=config.checkpoint_seconds)
        watching = [*([bar] if progress else []), *callbacks]
        try:
            # A finished run has nothing left to learn, but the callbacks restore its best model.
            recorder = RecordCallback(config, folder, judge)
            observers = [judge, saver, RewardCallback(), *watching, recorder]
            model = learn(config, envs, observers, tensorboard=folder / "tensorboard", checkpoint=begun, finished=reached)
        finally:
            bar.stop()
    seconds = time.perf_counter() - start
    result = TrainingResult(
        steps=model.num_timesteps,
        seconds=seconds,
        steps_per_second=(model.num_timesteps - judge.begun) / seconds,
        best=judge.best,
        history=judge.history,
        stopped="until" if reached or judge.stopped else None,
    )
    replace_json(written, asdict(result))
    return result


def learn(
    config: TrainingConfig,
    envs: VectorEnv,
    callbacks: Sequence[BaseCallback],
    *,
    tensorboard: Path | None = None,
    checkpoint: Path | None = None,
    finished: bool = False,
) -> BaseAlgorithm:
    """Make a model, and train it up to the configured number of steps.

    Args:
        config: Configuration of the training.
        envs: Environments to train in.
        callbacks: Callbacks of the training.
        tensorboard: Folder of the logs.
        checkpoint: Checkpoint to continue from; its steps count.
        finished: Whether that has nothing left to learn.
    """
    torch.set_num_threads(config.threads)
    model = make_model(config, envs, tensorboard=tensorboard, checkpoint=checkpoint)
    steps = 0 if finished else max(0, config.total - model.num_timesteps)
    with limited(config.threads):
        learned = list(callbacks)
        if config.from_policy is not None:
            learned.append(begin_with(model, envs, config, is_new=checkpoint is None))
        model.learn(steps, callback=learned, reset_num_timesteps=False, tb_log_name="run")
    return model
