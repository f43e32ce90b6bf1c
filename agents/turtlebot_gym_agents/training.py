"""Train a policy with Stable-Baselines3 on the native vector environment, so that an interruption costs seconds.

A run's folder holds ``config.json`` (all that the run depends on), ``checkpoint.zip`` (the last state, to resume from),
``best.zip`` and ``best.json`` (the best one on the evaluation's seeds), ``policy.onnx`` (the bundle of the best one, when it is
done), ``result.json`` and TensorBoard's logs. Every file is replaced in one step: a killed run leaves them whole.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import stable_baselines3
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from turtlebot_gym import Parameters, Robot
from turtlebot_gym.parameters import choose
from turtlebot_gym_agents import hyperparameters, normalization
from turtlebot_gym_agents.bundle import Card, describe_robot
from turtlebot_gym_agents.callbacks import CheckpointCallback, EvaluationCallback, ProgressCallback, save_model
from turtlebot_gym_agents.export import export
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.provenance import plain, provenance
from turtlebot_gym_agents.randomization import randomized
from turtlebot_gym_agents.sb3_vec_env import Sb3VecEnv

EVALUATION_SEED = 2**40
"""First seed of the evaluation's episodes, far from those that a training reaches."""
NORMALIZATION_SEED = 2**41


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """What a training run depends on."""

    env: str = "turtlebot_gym/TurtleBotNav-v0"
    """Environment id."""
    algo: str = "ppo"
    """Algorithm of Stable-Baselines3, in lower case."""
    seed: int = 0
    """Of the network, and first seed of the environments."""
    robot: str | Robot = "burger"
    """Robot preset, or a robot."""
    noise: str = "tutorial"
    """Noise preset."""
    filter: str = "matched"
    """Filter preset."""
    observation: str = "ekf"
    """What the policy sees: ekf, odometry or truth."""
    arrival: str = "truth"
    """Who says that the robot has arrived: truth or belief."""
    delay: int = 0
    """Steps by which commands come late."""
    randomize: bool = False
    """Whether noise, speed scale and delay differ from environment to environment, see `randomization`; ``noise``, ``filter``
    and ``delay`` are then those of the evaluation."""
    steps: int | None = None
    """Environment steps; the hyper-parameters' n_timesteps where it is not given."""
    config: Path | None = None
    """Hyper-parameters, YAML; those that come with the package where it is not given."""
    evaluations: int = 8
    """How often the policy is evaluated on the way."""
    episodes: int = 500
    """Episodes of each evaluation."""
    checkpoint_seconds: float = 5.0
    """Least time between two checkpoints, s."""
    threads: int = 1
    """Torch's threads: small networks gain nothing from more."""

    def environment(self) -> dict[str, Any]:
        """Return the arguments of the environment."""
        names = ("robot", "noise", "filter", "observation", "arrival", "delay")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, kw_only=True)
class TrainingResult:
    """What a training run has come to."""

    steps: int
    seconds: float
    """Wall time of this call."""
    steps_per_second: float
    """Environment steps per second of the whole loop, evaluations included."""
    best: Mapping[str, float]
    """The best evaluation."""
    history: list[dict[str, float]] = field(default_factory=list)


def figures(envs: gym.vector.VectorEnv, policy: Callable[[NDArray[np.float32]], Any]) -> dict[str, float]:
    """Return success rate, mean return and mean steps of one episode of each environment, on the evaluation's seeds."""
    observations, _ = envs.reset(seed=EVALUATION_SEED)
    running = np.ones(envs.num_envs, np.bool_)
    returns, steps, success = np.zeros(envs.num_envs), np.zeros(envs.num_envs), np.zeros(envs.num_envs, np.bool_)
    while running.any():
        observations, rewards, terminated, truncated, infos = envs.step(policy(observations))
        done = running & (terminated | truncated)
        returns[running] += rewards[running]
        steps[running] += 1
        success[done] = infos["final_info"]["is_success"][done] if done.any() else False
        running &= ~done
    return {"success": float(success.mean()), "return": float(returns.mean()), "steps_to_end": float(steps.mean())}


def train(config: TrainingConfig, folder: Path, *, resume: bool = False, progress: bool = True) -> TrainingResult:
    """Train one policy.

    Args:
        config: What to train.
        folder: Where the run's files go.
        resume: Go on from the folder's checkpoint, if there is one.
        progress: Whether to show a bar.

    Returns:
        What it has come to; the folder holds the policy.

    Raises:
        ValueError: If a name in the configuration is unknown, or the folder holds a run and ``resume`` is not set.
    """
    start = time.perf_counter()
    algorithms: dict[str, type[BaseAlgorithm]] = {
        name.lower(): getattr(stable_baselines3, name) for name in ("A2C", "DDPG", "PPO", "SAC", "TD3")
    }
    algorithm = choose("algo", config.algo, algorithms)
    hyper = hyperparameters.load(config.algo, config.env, config.config)
    total = config.steps or int(hyper["n_timesteps"])
    checkpoint = folder / "checkpoint.zip"
    if checkpoint.exists() and not resume:
        raise ValueError(f"{folder} holds a run already: resume it with --resume, or choose another folder.")
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(config.threads)

    options = config.environment()
    envs = gym.make_vec(config.env, num_envs=hyper["n_envs"], autoreset_mode=AutoresetMode.SAME_STEP, **options)
    judges = gym.make_vec(config.env, num_envs=config.episodes, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    bare: Any = envs.unwrapped
    parameters: Parameters = bare.parameters
    if config.randomize:
        bare.set_parameters(randomized(parameters, hyper["n_envs"], seed=config.seed))
    record = {"config": plain(asdict(config)), "hyperparameters": hyper, **provenance()}
    _write(folder / "config.json", record)

    if checkpoint.exists():
        # A checkpoint is the run's own file: unpickling it is as safe as the folder.
        model = algorithm.load(checkpoint, env=Sb3VecEnv(envs), device="cpu")
        model.env.seed(config.seed + model.num_timesteps)
    else:
        bearing = make_policy("bearing", robot=parameters.robot, dt=parameters.dt)
        mean, std = normalization.measure(envs, bearing, seed=NORMALIZATION_SEED + config.seed)
        keywords = hyperparameters.arguments(hyper)
        keywords["policy_kwargs"] |= {
            "features_extractor_class": normalization.NormalizedObservation,
            "features_extractor_kwargs": {"mean": mean, "std": std},
        }
        adapter = Sb3VecEnv(envs)
        adapter.seed(config.seed * hyper["n_envs"])
        model = algorithm(
            hyper["policy"], adapter, seed=config.seed, device="cpu", tensorboard_log=str(folder / "tensorboard"), **keywords
        )
    if isinstance(model, OnPolicyAlgorithm):
        model.env.bootstrap_with(model)

    judge = EvaluationCallback(
        lambda policy: figures(judges, policy), path=folder / "best.zip", every=max(1, total // config.evaluations)
    )
    callbacks = [CheckpointCallback(checkpoint, seconds=config.checkpoint_seconds), judge]
    callbacks += [ProgressCallback(total, label=f"{config.env.partition('/')[2]} seed {config.seed}")] if progress else []
    done_before = model.num_timesteps
    if done_before < total:
        model.learn(total - done_before, callback=callbacks, reset_num_timesteps=False, tb_log_name="run")
        judge.run()
        save_model(model, checkpoint)
    best = json.loads((folder / "best.json").read_text())
    seconds = time.perf_counter() - start
    card = Card(
        env=config.env,
        robot=describe_robot(config.robot),
        dt=parameters.dt,
        noise="randomized" if config.randomize else config.noise,
        filter=config.filter,
        observation=config.observation,
        training={**record, "steps": model.num_timesteps, "seconds": round(seconds, 1), "evaluation": best},
    )
    export(algorithm.load(folder / "best.zip", device="cpu"), folder / "policy.onnx", card)
    result = TrainingResult(
        steps=model.num_timesteps,
        seconds=seconds,
        steps_per_second=(model.num_timesteps - done_before) / seconds,
        best=best,
        history=judge.history,
    )
    _write(folder / "result.json", asdict(result))
    envs.close()
    judges.close()
    return result


def _write(path: Path, content: Any) -> None:
    beside = path.with_name(f".{path.name}.new")
    beside.write_text(json.dumps(content, indent=2) + "\n")
    beside.replace(path)
