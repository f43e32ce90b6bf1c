"""Speed, measured as ratios in one run, so that a busy machine disturbs all contenders alike.

Environments are compared with Gymnasium's CartPole: actions are sampled beforehand, infos are the default ones, all returned
arrays are fresh; the contenders take turns, and the median over the rounds counts. Training is compared with the usual route of
Stable-Baselines3, a ``DummyVecEnv`` of 64 scalar environments, with the same algorithm and the same batches.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode

NAV = "turtlebot_gym/TurtleBotNav-v0"
CARTPOLE = "CartPole-v1"


def scalar(env_id: str, **options: Any) -> Callable[[int], None]:
    """Return a function that makes a number of steps in a scalar environment made by ``gym.make``."""
    env = gym.make(env_id, **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(256)]

    def run(steps: int) -> None:
        for k in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[k % 256])
            if terminated or truncated:
                env.reset()

    return run


def vector(env_id: str, num_envs: int, **options: Any) -> Callable[[int], None]:
    """Return a function that makes a number of steps in a native vector environment."""
    envs = gym.make_vec(env_id, num_envs=num_envs, vectorization_mode="vector_entry_point", **options)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]

    def run(steps: int) -> None:
        for k in range(steps):
            envs.step(actions[k % 16])

    return run


def rate(run: Callable[[int], None], seconds: float) -> float:
    """Return the calls per second that a contender makes in about so many seconds."""
    steps, elapsed = 1, 0.0
    while elapsed < seconds / 4:
        steps *= 2
        start = time.perf_counter()
        run(steps)
        elapsed = time.perf_counter() - start
    steps = max(1, round(steps * seconds / elapsed))
    start = time.perf_counter()
    run(steps)
    return steps / (time.perf_counter() - start)


def environments(*, num_envs: int = 4096, rounds: int = 7, seconds: float = 0.5) -> dict[str, dict[str, float]]:
    """Return steps per second, and the ratio to CartPole's, of scalar and vector environments.

    Args:
        num_envs: Size of the vector environments.
        rounds: How often each contender has its turn.
        seconds: How long a turn takes.
    """
    n = num_envs
    contenders = {
        f"scalar, {CARTPOLE}": (scalar(CARTPOLE), 1),
        "scalar, TurtleBotNav-v0": (scalar(NAV), 1),
        "scalar, TurtleBotNav-v0, filter tutorial": (scalar(NAV, filter="tutorial"), 1),
        f"vector of {n}, {CARTPOLE}": (vector(CARTPOLE, n), n),
        f"vector of {n}, TurtleBotNav-v0": (vector(NAV, n), n),
        f"vector of {n}, TurtleBotNav-v0, noise rough": (vector(NAV, n, noise="rough"), n),
        f"vector of {n}, TurtleBotSquare-v0": (vector("turtlebot_gym/TurtleBotSquare-v0", n), n),
        f"vector of {n}, TurtleBotNav-v0, info full": (vector(NAV, n, info="full"), n),
    }
    for run, _ in contenders.values():
        run(16)  # compile
    turns = [{name: rate(run, seconds) * size for name, (run, size) in contenders.items()} for _ in range(rounds)]
    base = {"scalar": f"scalar, {CARTPOLE}", "vector": f"vector of {n}, {CARTPOLE}"}
    return {
        name: {
            "steps_per_second": statistics.median(turn[name] for turn in turns),
            "ratio": statistics.median(turn[name] / turn[base[name[:6]]] for turn in turns),
        }
        for name in contenders
    }


def adapter(*, num_envs: int = 512, rounds: int = 7, steps: int = 500) -> float:
    """Return what `Sb3VecEnv` adds to a step of the vector environment, in ns for each environment."""
    from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

    envs = gym.make_vec(NAV, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP)
    adapted = Sb3VecEnv(envs)
    adapted.reset()
    actions = [envs.action_space.sample() for _ in range(16)]

    def elapsed(step: Callable[[Any], Any]) -> float:
        start = time.perf_counter()
        for k in range(steps):
            step(actions[k % 16])
        return time.perf_counter() - start

    elapsed(adapted.step)
    added = [elapsed(adapted.step) - elapsed(envs.step) for _ in range(rounds)]
    return statistics.median(added) / steps / num_envs * 1e9


def training(*, steps: int = 300_000, rounds: int = 3) -> dict[str, float]:
    """Return environment steps per second of the whole PPO loop, with our adapter and with SB3's own route, and their ratio."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from turtlebot_gym_agents.training import hyperparameters
    from turtlebot_gym_agents.training.train import TrainingConfig, make_model

    config = TrainingConfig(env=NAV)
    hyper = hyperparameters.load("ppo", NAV)

    def ours(total: int) -> float:
        model = make_model(config, hyper, config.make(hyper["n_envs"]), tensorboard=None)
        start = time.perf_counter()
        model.learn(total)
        return model.num_timesteps / (time.perf_counter() - start)

    def theirs(total: int) -> float:
        envs = DummyVecEnv([lambda: gym.make(NAV) for _ in range(64)])
        keywords = hyperparameters.arguments({**hyper, "n_steps": hyper["n_envs"] * hyper["n_steps"] // 64}, PPO)
        model = PPO("MlpPolicy", envs, device="cpu", seed=0, **keywords)
        start = time.perf_counter()
        model.learn(total)
        return model.num_timesteps / (time.perf_counter() - start)

    turns = [(ours(steps), theirs(steps // 4)) for _ in range(rounds)]
    return {
        "ours": statistics.median(turn[0] for turn in turns),
        "dummy_vec_env": statistics.median(turn[1] for turn in turns),
        "ratio": statistics.median(turn[0] / turn[1] for turn in turns),
    }


def machine() -> dict[str, Any]:
    """Return on how many cores, and under which load, it was measured."""
    return {"cores": len(os.sched_getaffinity(0)), "load_before": os.getloadavg()[0]}
