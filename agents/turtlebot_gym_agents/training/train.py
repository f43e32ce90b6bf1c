"""Train a policy with Stable-Baselines3 on the native vector environment; an interruption costs only seconds of work.

A run's folder holds ``config.json`` (everything that the run depends on), ``checkpoint.zip`` (the last state, to resume from;
with ``checkpoint.replay.pkl`` if there is a replay buffer), ``best.zip`` (the best model on the evaluation's seeds),
``policy.onnx`` (its bundle, once the run is done), ``result.json`` and TensorBoard logs. Files are replaced atomically, so a
killed run leaves them complete.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import stable_baselines3
import torch
from gymnasium.vector import VectorEnv
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from turtlebot_gym import Parameters
from turtlebot_gym.compiled.threads import limited
from turtlebot_gym.files import load
from turtlebot_gym.systems import system_of
from turtlebot_gym.validation import choose
from turtlebot_gym_agents.files import replace_json
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.bundle import Card
from turtlebot_gym_agents.policies.fit import describe_robot
from turtlebot_gym_agents.provenance import plain, provenance
from turtlebot_gym_agents.training import hyperparameters, normalization
from turtlebot_gym_agents.training.algorithms import ALGORITHMS
from turtlebot_gym_agents.training.callbacks import CheckpointCallback, EvaluationCallback, ProgressCallback, replay_path
from turtlebot_gym_agents.training.config import FREE_TO_CHANGE, TrainingConfig, require_no_run
from turtlebot_gym_agents.training.devices import choose_device
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.optimizer import EPS, Adam
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

NORMALIZATION_SEED = 2**41
TRAINING_SEED = 2**42
"""Environments of a run have seeds from (1 + its seed) times this, separate from other runs and from the evaluation."""


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
    """Figures of this call's evaluations."""


def train(
    config: TrainingConfig,
    folder: Path,
    *,
    resume: bool = False,
    progress: bool = True,
    hyper: Mapping[str, Any] | None = None,
    callbacks: Sequence[BaseCallback] = (),
) -> TrainingResult:
    """Train one policy.

    Args:
        config: Configuration of the training.
        folder: Folder for the run's files.
        resume: Resume from the folder's checkpoint, if there is one.
        progress: Whether to show a bar.
        hyper: Hyper-parameters, if the configuration's file was already read.
        callbacks: Additional callbacks.

    Returns:
        The result; the folder holds the policy.

    Raises:
        ValueError: If a name in the configuration is unknown, a hyper-parameter is not what its rule allows, or the folder
            holds a run and ``resume`` is not set, or a run of another configuration.
    """
    start = time.perf_counter()
    if hyper is None:
        hyper = hyperparameters.load(config.algo, config.env, config.config)
    else:
        hyper = hyperparameters.checked_for(config.algo, hyper)
    total = config.steps or hyper["n_timesteps"]
    checkpoint = folder / "checkpoint.zip"
    device = choose_device(config.device, choose("algo", config.algo, ALGORITHMS))
    record = {"config": plain(asdict(config)), "hyperparameters": hyper, "device": device, **provenance()}
    if not resume:
        require_no_run(folder)
    if checkpoint.exists():
        _require_same(load(folder / "config.json"), record, folder)
    torch.set_num_threads(config.threads)

    envs, judges = config.make(hyper["n_envs"], randomize=config.randomize), config.make(config.episodes)
    if checkpoint.exists():
        model = load_checkpoint(config, checkpoint, envs)
    else:
        model = make_model(config, hyper, envs, tensorboard=folder / "tensorboard")
    folder.mkdir(parents=True, exist_ok=True)
    replace_json(folder / "config.json", record)
    before = model.num_timesteps
    judge = EvaluationCallback(judges, path=folder / "best.zip", every=max(1, total // config.evaluations))
    bar = ProgressCallback(total, label=f"{config.env.partition('/')[2]} seed {config.seed}")
    own = [judge, CheckpointCallback(checkpoint, seconds=config.checkpoint_seconds), *([bar] if progress else [])]
    try:
        # A finished run has nothing left to learn, but the callbacks restore its best model.
        learn(model, total, [*own, *callbacks], threads=config.threads)
    finally:
        bar.stop()
    seconds = round(time.perf_counter() - start, 1)
    card = Card(
        env=config.env,
        robot=describe_robot(config.robot),
        dt=_parameters(judges).dt,
        noise="randomized" if config.randomize else config.noise,
        filter=config.filter,
        observation=config.observation,
        layout=system_of(_parameters(judges)).layout,
        training={
            **record,
            "steps": model.num_timesteps,
            "seconds": round(time.perf_counter() - start, 1),
            "evaluation": judge.best,
        },
    )
    best = ALGORITHMS[config.algo].load(folder / "best.zip", device="cpu")
    export(best, folder / "policy.onnx", card)
    envs.close()
    judges.close()
    seconds = time.perf_counter() - start
    result = TrainingResult(
        steps=model.num_timesteps,
        seconds=seconds,
        steps_per_second=(model.num_timesteps - before) / seconds,
        best=judge.best,
        history=judge.history,
    )
    replace_json(folder / "result.json", asdict(result))
    return result


def make_model(config: TrainingConfig, hyper: Mapping[str, Any], envs: VectorEnv, *, tensorboard: Path | None) -> BaseAlgorithm:
    """Return a new model.

    Args:
        config: Configuration of the training.
        hyper: Hyper-parameters.
        envs: Environments to train in.
        tensorboard: Folder of the logs.
    """
    algorithm = choose("algo", config.algo, ALGORITHMS)
    keywords = hyperparameters.arguments(dict(hyper), algorithm)
    bearing = make_policy("bearing", robot=_parameters(envs).robot, dt=_parameters(envs).dt)
    with limited(config.threads):
        mean, std = normalization.measure(envs, bearing, seed=NORMALIZATION_SEED + config.seed)
    keywords["policy_kwargs"] |= {
        "features_extractor_class": normalization.NormalizedObservation,
        "features_extractor_kwargs": {"mean": mean, "std": std},
    }
    if algorithm is stable_baselines3.PPO:
        keywords["policy_kwargs"] = {"optimizer_class": Adam, "optimizer_kwargs": {"eps": EPS}} | keywords["policy_kwargs"]
    model = algorithm(
        hyper["policy"],
        Sb3VecEnv(envs),
        seed=config.seed,
        device=choose_device(config.device, algorithm),
        tensorboard_log=None if tensorboard is None else str(tensorboard),
        **keywords,
    )
    return _set_up(model, config)


def load_checkpoint(config: TrainingConfig, checkpoint: Path, envs: VectorEnv) -> BaseAlgorithm:
    """Load the model of a checkpoint by `CheckpointCallback` from the run's own folder; loading unpickles it.

    Args:
        config: Configuration of the training.
        checkpoint: The file.
        envs: Environments in which training continues.
    """
    algorithm = choose("algo", config.algo, ALGORITHMS)
    model = algorithm.load(checkpoint, env=Sb3VecEnv(envs), device=choose_device(config.device, algorithm))
    if isinstance(model, OffPolicyAlgorithm):
        model.load_replay_buffer(replay_path(checkpoint))
    return _set_up(model, config)


def _set_up(model: BaseAlgorithm, config: TrainingConfig) -> BaseAlgorithm:
    adapter = model.env
    assert isinstance(adapter, Sb3VecEnv)
    adapter.seed((1 + config.seed) * TRAINING_SEED + model.num_timesteps)  # the model has set its own seed there
    if isinstance(model, OnPolicyAlgorithm):
        adapter.bootstrap_with(model)
    return model


def learn(model: BaseAlgorithm, total: int, callbacks: list[Any], *, threads: int = 1) -> None:
    """Train a model up to a total number of steps, including those it has already made.

    Args:
        model: The model.
        total: Total number of steps.
        callbacks: Callbacks of the training.
        threads: Threads of the compiled loop.
    """
    with limited(threads):
        model.learn(max(0, total - model.num_timesteps), callback=callbacks, reset_num_timesteps=False, tb_log_name="run")


def _parameters(envs: VectorEnv) -> Parameters:
    """Return the environments' parameters; those of the first one if they differ."""
    found: Any = envs.unwrapped.parameters  # pyright: ignore[reportAttributeAccessIssue]
    return found if isinstance(found, Parameters) else found[0]


def _require_same(old: Mapping[str, Any], new: Mapping[str, Any], folder: Path) -> None:
    """Raise ValueError if a folder's run has another configuration."""
    for part in ("config", "hyperparameters"):
        keys = set(old[part]) | set(new[part])
        for key in sorted(keys - set(FREE_TO_CHANGE)):
            before, now = old[part].get(key), new[part].get(key)
            if before != now:
                raise ValueError(f"{folder} holds a run with {key} {before!r}: it cannot be resumed with {now!r}.")
