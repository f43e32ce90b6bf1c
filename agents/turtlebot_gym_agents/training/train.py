"""Train a policy with Stable-Baselines3 on the native vector environment.

A run's folder holds ``config.json`` (everything that the run depends on), ``best.zip`` (the best model on the evaluation's
seeds), ``policy.onnx`` (its bundle, once the run is done), ``result.json`` and TensorBoard logs.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from stable_baselines3.common.callbacks import BaseCallback

from turtlebot_gym.compiled.threads import limited
from turtlebot_gym.files import write_text
from turtlebot_gym_agents.training.callbacks import EvaluationCallback, RewardCallback
from turtlebot_gym_agents.training.config import TrainingConfig, require_no_run
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.model import make_model

CHECKED = 100
"""Steps in which a training's bundle is compared with its model."""


@dataclass(frozen=True, kw_only=True)
class TrainingResult:
    """Result of a training run."""

    steps: int
    """Environment steps."""
    seconds: float
    """Wall time, s, evaluations and export included."""
    best: Mapping[str, float]
    """Figures of the best model."""
    history: list[dict[str, float]] = field(default_factory=list)
    """Figures of all evaluations of the run."""


def train(
    config: TrainingConfig, folder: str | Path, *, progress: bool = True, callbacks: Sequence[BaseCallback] = ()
) -> TrainingResult:
    """Train one policy into a folder, which must hold no run, and return what it reached.

    ``progress`` shows Stable-Baselines3's bar. A missing device and hyper-parameters that Stable-Baselines3 refuses are errors.
    """
    start, folder = time.perf_counter(), Path(folder)
    require_no_run(folder)
    torch.set_num_threads(config.threads)
    with closing(config.make_training()) as envs, closing(config.make_judging()) as judges:
        model = make_model(config, envs, tensorboard=folder / "tensorboard")
        record = {**config.record(), "device": model.device.type}
        write_text(folder / "config.json", json.dumps(record, indent=1) + "\n")
        judge = EvaluationCallback(
            judges,
            path=folder / "best.zip",
            every=max(1, config.total // config.evaluations),
            episodes=config.episodes,
        )
        with limited(config.threads), warnings.catch_warnings():
            warnings.filterwarnings("ignore", "rich is experimental")  # tqdm says so of the bar
            watching = [judge, RewardCallback(), *callbacks]
            model.learn(config.total, callback=watching, tb_log_name="run", progress_bar=progress)
        seconds = time.perf_counter() - start
        about = {**record, "steps": model.num_timesteps, "seconds": round(seconds, 1), "evaluation": judge.best}
        with judge.best_model():
            own = {"vec_normalize": "none", "training": about, "steps": CHECKED}  # its network normalizes
            export(model, folder / "policy.onnx", env=config.env, **own, **config.options)
    seconds = time.perf_counter() - start
    result = TrainingResult(
        steps=model.num_timesteps,
        seconds=seconds,
        best=judge.best,
        history=judge.history,
    )
    write_text(folder / "result.json", json.dumps(asdict(result), indent=1) + "\n")
    return result
