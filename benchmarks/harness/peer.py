"""Program of an environment that `make bench-peers` measures, in a process of its own on one core.

``python -m harness.peer PROGRAM SIZE`` prints ``ready`` with the environment steps of a call and the CPU seconds until then.
For each number that it reads, it makes that many calls and prints ``turn`` with their wall time and the CPU seconds of all
threads. Every call returns all observations, and episodes that end begin anew.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

BEAMS = 180
"""Beams of a step: an LDS-01 measures as many in 0.1 s."""
STEPS = 32
"""Steps of a call of environments in JAX: a compiled loop, as their trainings collect them."""
FEW_STEPS = 2
"""The same for JaxNav, whose steps take long."""
WARM = 3
"""Calls before the first turn; JAX compiles in the first two."""
IRSIM = {
    "world": {"width": 5, "height": 5, "step_time": 0.1, "sample_time": 0.1},
    "robot": {
        "kinematics": {"name": "diff"},
        "shape": {"name": "circle", "radius": 0.1},
        "state": [0.5, 0.5, 0.0],
        "goal": [4.5, 4.5, 0.0],
        "vel_min": [0.0, -2.84],
        "vel_max": [0.22, 2.84],
        "sensors": [{"name": "lidar2d", "range_min": 0.12, "range_max": 3.5, "number": BEAMS, "noise": True}],
    },
    "obstacle": {
        "number": 12,
        "distribution": {"name": "random", "range_low": [1.0, 1.0, 0.0], "range_high": [4.0, 4.0, 0.0]},
        "shape": [{"name": "circle", "radius": 0.2}],
    },
}
"""A room like those of `dense`: its size, and the mean number and radius of its obstacles."""
Program = tuple[Callable[[int], Any], int]
"""Function that makes the k-th call, and the steps that each environment makes in it."""


def _own(env_id: str, size: int) -> Program:
    """Return an environment of Gymnasium's interface, which this package or Gymnasium registers."""
    import gymnasium as gym

    import turtlebot_gym  # noqa: F401

    env: Any = gym.make(env_id) if size == 1 else gym.make_vec(env_id, size, "vector_entry_point")
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]

    def call(k: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[k % 64])
        if size == 1 and (terminated or truncated):
            env.reset()

    return call, 1


def _envpool(env_id: str, size: int) -> Program:
    """Return an environment of EnvPool with one worker."""
    import envpool  # pyright: ignore[reportMissingImports]
    import numpy as np

    envs = envpool.make_gymnasium(env_id, num_envs=size, num_threads=1)
    envs.reset()
    envs.action_space.seed(0)
    actions = [np.stack([envs.action_space.sample() for _ in range(size)]) for _ in range(16)]
    return lambda k: envs.step(actions[k % 16]), 1


def _rollout(reset: Callable[..., Any], step: Callable[..., Any], actions: Any, size: int) -> Program:
    """Return a compiled loop over the steps of environments in JAX.

    Args:
        reset: Takes a key; returns an observation and a state.
        step: Takes a key, a state and an action; returns an observation, a state, and more.
        actions: Actions of each step and environment.
        size: Number of environments.
    """
    import jax  # pyright: ignore[reportMissingImports]

    def advance(state: Any, drawn: Any) -> Any:
        key, action = drawn
        observation, state, *others = jax.vmap(step)(jax.random.split(key, size), state, action)
        return state, (observation, others)

    @jax.jit
    def roll(k: Any, state: Any) -> Any:
        return jax.lax.scan(advance, state, (jax.random.split(jax.random.key(k), steps), actions))

    steps = len(jax.tree.leaves(actions)[0])
    state = jax.jit(jax.vmap(reset))(jax.random.split(jax.random.key(0), size))[1]

    def call(k: int) -> Any:
        nonlocal state
        state, seen = jax.block_until_ready(roll(k, state))
        return seen

    return call, steps


def _gymnax(env_id: str, size: int) -> Program:
    """Return an environment of gymnax."""
    import gymnax  # pyright: ignore[reportMissingImports]
    import jax  # pyright: ignore[reportMissingImports]

    env, parameters = gymnax.make(env_id)
    sample = jax.vmap(jax.vmap(env.action_space(parameters).sample))
    actions = sample(jax.random.split(jax.random.key(1), (STEPS, size)))
    return _rollout(partial(env.reset, params=parameters), partial(env.step, params=parameters), actions, size)


def _jaxnav(step: str, size: int) -> Program:
    """Return JaxNav with one robot; its `step` draws a new room for each environment in each step, `step_env` draws none."""
    import jax  # pyright: ignore[reportMissingImports]
    import jaxmarl  # pyright: ignore[reportMissingImports]

    env = jaxmarl.make("jaxnav", num_agents=1, lidar_num_beams=BEAMS)
    name = env.agents[0]
    low, high = (jax.numpy.asarray(bound) for bound in ((env.min_v, -env.max_w), (env.max_v, env.max_w)))
    actions = {name: jax.random.uniform(jax.random.key(1), (FEW_STEPS, size, 2), minval=low, maxval=high)}
    return _rollout(env.reset, getattr(env, step), actions, size)


def _irsim(world: str, size: int) -> Program:
    """Return one robot of IR-SIM; size must be 1."""
    import irsim  # pyright: ignore[reportMissingImports]
    import numpy as np
    import yaml

    with open(world, "w", encoding="utf-8") as file:
        yaml.safe_dump(IRSIM, file)
    env = irsim.make(world, display=False, disable_all_plot=True, log_level="ERROR")
    actions = np.random.default_rng(0).uniform((0.0, -2.84), (0.22, 2.84), (256, 2))[..., None]

    def call(k: int) -> Any:
        env.step(actions[k % 256])
        seen = env.get_robot_state(), env.get_lidar_scan()
        if env.done():
            env.reset()
        return seen

    return call, size


PROGRAMS: dict[str, Callable[[int], Program]] = {
    "TurtleBotNav": partial(_own, "turtlebot_gym/TurtleBotNav-v0"),
    "TurtleBotRooms": partial(_own, "turtlebot_gym/TurtleBotRooms-v0"),
    "CartPole": partial(_own, "CartPole-v1"),
    "EnvPool's Pendulum": partial(_envpool, "Pendulum-v1"),
    "gymnax's Pendulum": partial(_gymnax, "Pendulum-v1"),
    "JaxNav": partial(_jaxnav, "step"),
    "JaxNav without new rooms": partial(_jaxnav, "step_env"),
    "IR-SIM": partial(_irsim, "world.yaml"),
}
"""Programs by the names of the table."""


def main(name: str, size: str) -> None:
    """Make the requested calls until standard input ends."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # libraries start as many threads as there are cores
    call, steps = PROGRAMS[name](int(size))
    for k in range(WARM):
        call(k)
    print("ready", json.dumps({"steps": steps * int(size), "start": time.process_time()}), flush=True)
    for line in sys.stdin:
        wall, cpu = time.perf_counter(), time.process_time()
        for k in range(int(line)):
            call(k)
        print("turn", json.dumps([time.perf_counter() - wall, time.process_time() - cpu]), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
