"""Measure the speed of environments beside Gymnasium's CartPole: ratios within one run, by wall time and CPU seconds.

Actions are sampled beforehand, infos are the default ones, and all returned arrays are new.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import tyro

from harness.machine import busy, machine
from harness.study import publish
from harness.turns import Contender, rates, timed
from turtlebot_gym.compiled.threads import limited
from turtlebot_gym_agents.training.randomization import randomized

NAV, SQUARE, CARTPOLE = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotSquare-v0", "CartPole-v1"
VECTORS: dict[str, tuple[str, dict[str, Any]]] = {
    "TurtleBotNav-v0": (NAV, {}),
    "TurtleBotNav-v0, noise rough": (NAV, {"noise": "rough"}),
    "TurtleBotSquare-v0": (SQUARE, {}),
}
"""Vector environments of each size: id and options."""
MORE: dict[str, tuple[str, dict[str, Any]]] = {
    "TurtleBotNav-v0, info full": (NAV, {"info": "full"}),
    "TurtleBotNav-v0, randomized": (NAV, {"drawn": True}),
    "TurtleBotNav-v0, fix late": (NAV, {"fix": "late"}),
}
"""Those of the first size only."""
KEY = ("CartPole-v1", "TurtleBotNav-v0", "TurtleBotNav-v0, one thread")
"""Ends of the names that are measured beside busy processes, too."""


def scalar(env_id: str, **options: Any) -> Contender:
    """Return a scalar environment made by ``gym.make``."""
    env = gym.make(env_id, **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(256)]

    def step(k: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[k % 256])
        if terminated or truncated:
            env.reset()

    return Contender(timed(step), 1, f"scalar, {CARTPOLE}")


def vector(env_id: str, size: int, *, one_thread: bool = False, drawn: bool = False, **options: Any) -> Contender:
    """Return a native vector environment; its parameters may be drawn for each row, as in trainings."""
    envs = gym.make_vec(env_id, num_envs=size, vectorization_mode="vector_entry_point", **options)
    if drawn:
        bare: Any = envs.unwrapped
        bare.set_parameters(randomized(bare.parameters, size, seed=0))
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]
    limit = [partial(limited, 1)] if one_thread else []
    return Contender(timed(lambda k: envs.step(actions[k % 16]), *limit), size, f"vector of {size}, {CARTPOLE}")


def main(
    *,
    num_envs: tuple[int, ...] = (4096, 65536),
    rounds: int = 7,
    seconds: float = 0.5,
    beside: int = 4,
    json: Path = Path("benchmarks/speed.json"),
) -> None:
    """Measure, print and write.

    Args:
        num_envs: Sizes of the vector environments.
        rounds: Number of turns of each contender.
        seconds: Length of a turn, s of CPU.
        beside: Number of busy processes beside which the most important rows are measured again; 0 for none.
        json: File for the results.
    """
    options = {**locals()}
    contenders = {
        f"scalar, {CARTPOLE}": scalar(CARTPOLE),
        "scalar, TurtleBotNav-v0": scalar(NAV),
        "scalar, TurtleBotNav-v0, filter tutorial": scalar(NAV, filter="tutorial"),
    }
    for size in num_envs:
        contenders[f"vector of {size}, {CARTPOLE}"] = vector(CARTPOLE, size)
        for name, (env_id, given) in {**VECTORS, **(MORE if size == num_envs[0] else {})}.items():
            contenders[f"vector of {size}, {name}"] = vector(env_id, size, **given)
            contenders[f"vector of {size}, {name}, one thread"] = vector(env_id, size, one_thread=True, **given)
    results: dict[str, Any] = {"machine": machine(), "environments": rates(contenders, rounds, seconds)}
    if beside:
        key = {name: contender for name, contender in contenders.items() if name.partition(", ")[2] in KEY}
        with busy(beside):
            results["busy"] = {"processes": beside, "environments": rates(key, rounds, seconds)}
    publish(json, results, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
