"""Speed of training: the adapter's overhead per step, and PPO compared with the usual route of Stable-Baselines3.

The usual route is a ``DummyVecEnv`` of 64 scalar environments, with the same algorithm and the same batches. Both train on one
thread, as ``turtlebot-gym train`` does: a second one gains torch little, and burns a core where the machine is busy.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym

from harness.environments import NAV
from turtlebot_gym.compiled.threads import limited

HYPER = {
    "n_envs": 512,
    "n_timesteps": 1_000_000,
    "policy": "MlpPolicy",
    "n_steps": 32,
    "batch_size": 2048,
    "n_epochs": 4,
    "learning_rate": "lin_0.0015",
    "gamma": 0.98,
    "gae_lambda": 0.95,
    "policy_kwargs": {"net_arch": [64, 64], "activation_fn": "ReLU", "log_std_init": -0.5},
}
"""Hyper-parameters with which speed is measured, whatever those shipped with the package are."""


class Trained(NamedTuple):
    """Medians of trainings with PPO."""

    steps_per_second: float
    """Steps per second of the vector environment in `Sb3VecEnv`, by wall time."""
    cpu_seconds_per_million: float
    """Its CPU seconds of all threads for a million steps."""
    dummy_vec_env: float | None = None
    """Steps per second of the usual route."""
    ratio: float | None = None
    """Ratio of the two rates in the same round."""


def training(
    *,
    steps: int = 200_000,
    rounds: int = 3,
    usual: bool = True,
    progress: Callable[[int], None] = lambda rounds: None,
) -> Trained:
    """Return the speed of the whole PPO loop, ``model.learn``.

    Args:
        steps: Steps of a training; the usual route makes a quarter of them.
        rounds: Number of trainings of each.
        usual: Whether to measure the usual route too.
        progress: Called with the number of finished rounds.
    """
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from turtlebot_gym_agents.training.arguments import arguments
    from turtlebot_gym_agents.training.config import TrainingConfig
    from turtlebot_gym_agents.training.model import make_model

    config = TrainingConfig(env=NAV, config=HYPER)
    hyper = config.hyper

    def learn(model: Any, total: int) -> tuple[float, float]:
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            with limited(1):
                model.learn(total)
        finally:
            torch.set_num_threads(threads)
        return model.num_timesteps / (time.perf_counter() - wall), 1e6 * (time.process_time() - cpu) / model.num_timesteps

    def ours() -> tuple[float, float]:
        return learn(make_model(config, config.make(hyper["n_envs"])), steps)

    def theirs() -> float:
        envs = DummyVecEnv([lambda: gym.make(NAV) for _ in range(64)])
        keywords = arguments("ppo", {**hyper, "n_steps": hyper["n_envs"] * hyper["n_steps"] // 64})
        return learn(PPO("MlpPolicy", envs, device="cpu", seed=0, **keywords), steps // 4)[0]

    rates, cpu, others = [], [], []
    for number in range(rounds):
        rate, seconds = ours()
        rates.append(rate)
        cpu.append(seconds)
        if usual:
            others.append(theirs())
        progress(number + 1)
    trained = Trained(statistics.median(rates), statistics.median(cpu))
    if not usual:
        return trained
    ratio = statistics.median(mine / other for mine, other in zip(rates, others, strict=True))
    return trained._replace(dummy_vec_env=statistics.median(others), ratio=ratio)
