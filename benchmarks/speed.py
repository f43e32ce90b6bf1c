"""Measure the speed of environments beside Gymnasium's CartPole: ratios within one run, by wall time and CPU seconds.

All take turns, forwards and backwards, so that other programs disturb those of a round alike; rates and ratios are medians over
the rounds. Actions are sampled beforehand, infos are the default ones, and all returned arrays are new.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import tyro

from harness.machine import busy, machine
from harness.study import publish
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
KEY = ("CartPole-v1", "TurtleBotNav-v0", "TurtleBotNav-v0, one thread")  # measured beside busy processes, too


class Contender(NamedTuple):
    """What makes a number of calls and returns wall time and CPU seconds of all threads; its environments, and its base."""

    run: Callable[[int], tuple[float, float]]
    size: int
    base: str


def contender(step: Callable[[int], Any], size: int, limit: Callable[[], Any] = nullcontext) -> Contender:
    """Return a contender that steps some environments at a time within a context of ``limit``."""

    def run(calls: int) -> tuple[float, float]:
        with limit():
            wall, cpu = time.perf_counter(), time.process_time()
            for k in range(calls):
                step(k)
            return time.perf_counter() - wall, max(time.process_time() - cpu, 1e-9)

    return Contender(run, size, f"{'scalar' if size == 1 else f'vector of {size}'}, {CARTPOLE}")


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

    return contender(step, 1)


def vector(env_id: str, size: int, *, one_thread: bool = False, drawn: bool = False, **options: Any) -> Contender:
    """Return a native vector environment; its parameters may be drawn for each row, as in trainings."""
    envs = gym.make_vec(env_id, num_envs=size, vectorization_mode="vector_entry_point", **options)
    if drawn:
        bare: Any = envs.unwrapped
        bare.set_parameters(randomized(bare.parameters, size, seed=0))
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]
    return contender(lambda k: envs.step(actions[k % 16]), size, partial(limited, 1) if one_thread else nullcontext)


def rates(contenders: Mapping[str, Contender], rounds: int, seconds: float) -> dict[str, dict[str, float]]:
    """Return each contender's steps per second, and their ratios to those of its base, after turns of some seconds each."""
    calls, turns = {}, {name: list[tuple[float, float]]() for name in contenders}
    for name, (run, *_) in contenders.items():
        run(1)  # it compiles
        calls[name] = 1
        while (wall := run(calls[name])[0]) < seconds / 4.0:
            calls[name] *= 2
        calls[name] = max(1, round(calls[name] * seconds / wall))
    for number in range(rounds):
        for name in [*contenders][:: 1 if number % 2 == 0 else -1]:
            each = calls[name] * contenders[name].size
            wall, cpu = contenders[name].run(calls[name])
            turns[name].append((wall / each, cpu / each))
    rows = {}
    for name, (*_, base) in contenders.items():
        pairs = list(zip(turns[name], turns[base], strict=True))
        rows[name] = {
            "steps_per_second": statistics.median(1.0 / wall for wall, _ in turns[name]),
            "ratio": statistics.median(theirs[0] / mine[0] for mine, theirs in pairs),
            "steps_per_cpu_second": statistics.median(1.0 / cpu for _, cpu in turns[name]),
            "cpu_ratio": statistics.median(theirs[1] / mine[1] for mine, theirs in pairs),
        }
    return rows


def main(
    *,
    num_envs: tuple[int, ...] = (4096, 65536),
    rounds: int = 7,
    seconds: float = 0.5,
    beside: int = 4,
    json: Path = Path("benchmarks/speed.json"),
) -> None:
    """Measure sizes of vector environments, in turns of some seconds; the key rows again beside some busy processes."""
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
