"""Speed of the environments, as ratios to Gymnasium's CartPole measured in the same run.

Actions are sampled beforehand, infos are the default ones, all returned arrays are fresh. Measurements of the contenders take
turns, and the median over the rounds counts, so that a busy machine disturbs all of them alike.
"""

from __future__ import annotations

import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

import turtlebot_gym


@dataclass(frozen=True)
class Config:
    """Measure the speed of the environments."""

    rounds: int = 7
    """Rounds; in each, every contender runs once."""
    seconds: float = 0.5
    """How long a contender runs in a round."""
    num_envs: int = 4096
    """Size of the vector environments."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the results here too."""


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


def measure(config: Config) -> dict[str, Any]:
    """Return the rates in steps per second, and the ratios to CartPole."""
    nav, cart, n = "turtlebot_gym/TurtleBotNav-v0", "CartPole-v1", config.num_envs
    contenders = {
        "scalar, CartPole-v1": (scalar(cart), 1),
        "scalar, TurtleBotNav-v0": (scalar(nav), 1),
        "scalar, TurtleBotNav-v0, filter tutorial": (scalar(nav, filter="tutorial"), 1),
        f"vector of {n}, CartPole-v1": (vector(cart, n), n),
        f"vector of {n}, TurtleBotNav-v0": (vector(nav, n), n),
        f"vector of {n}, TurtleBotNav-v0, noise rough": (vector(nav, n, noise="rough"), n),
        f"vector of {n}, TurtleBotSquare-v0": (vector("turtlebot_gym/TurtleBotSquare-v0", n), n),
        f"vector of {n}, TurtleBotNav-v0, info full": (vector(nav, n, info="full"), n),
    }
    for run, _ in contenders.values():
        run(16)  # compile
    rounds = [
        {name: rate(run, config.seconds) * size for name, (run, size) in contenders.items()} for _ in range(config.rounds)
    ]
    rates = {name: statistics.median(one[name] for one in rounds) for name in contenders}
    base = {"scalar": "scalar, CartPole-v1", "vector": f"vector of {n}, CartPole-v1"}
    ratios = {
        name: statistics.median(one[name] / one[base[name.split()[0].rstrip(",")]] for one in rounds) for name in contenders
    }
    return {
        "steps_per_second": rates,
        "ratio_to_cartpole": ratios,
        "cores": len(os.sched_getaffinity(0)),
        "versions": {
            "python": platform.python_version(),
            "gymnasium": gym.__version__,
            "numpy": np.__version__,
            "turtlebot_gym": turtlebot_gym.__version__,
        },
    }


def main() -> None:
    """Measure, print a table, and write JSON."""
    config = tyro.cli(Config, description=__doc__)
    result = measure(config)
    table = Table("contender", "steps/s", "times CartPole", title=f"{result['cores']} cores")
    for name, steps in result["steps_per_second"].items():
        table.add_row(name, f"{steps:,.0f}", f"{result['ratio_to_cartpole'][name]:.2f}")
    Console().print(table)
    if config.json is not None:
        config.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
