"""Program of a peer, which runs in its own process: another library in its virtual environment, or a clone of this repository.

``python peer.py NAME ENV SIZE FORM`` prints ``ready`` with the versions. For each number that it reads, it makes that many
calls and prints ``turn`` with their wall time and the CPU seconds of all threads.

References:
    Lange, *gymnax: A JAX-based Reinforcement Learning Environment Library* (2022), https://github.com/RobertTLange/gymnax.
    Weng et al., *EnvPool: A Highly Parallel Reinforcement Learning Environment Execution Engine* (NeurIPS 2022).
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

SCANNED = 16
"""Steps in one call of the form "scan"."""


def gymnax_calls(env_id: str, size: int, form: str) -> Callable[[int], Any]:
    """Return a function that makes the k-th call and waits for its results.

    Args:
        env_id: Environment.
        size: Number of environments stepped together.
        form: "step": a call is one compiled step, as a library without JAX would use it. "scan": a call is `SCANNED` steps in
            one compiled loop, which returns all observations, rewards and ends, as a rollout in JAX does.
    """
    import gymnax  # pyright: ignore[reportMissingImports]
    import jax  # pyright: ignore[reportMissingImports]

    env, parameters = gymnax.make(env_id)
    key = jax.random.key(0)
    space = env.action_space(parameters)
    reset = jax.vmap(env.reset, in_axes=(0, None))
    _, first = jax.jit(reset)(jax.random.split(key, size), parameters)

    def step(state: Any, drawn: Any) -> tuple[Any, Any]:
        step_key, actions = drawn
        keys = jax.random.split(step_key, size)
        result = jax.vmap(env.step, in_axes=(0, 0, 0, None))(keys, state, actions, parameters)
        observations, state, reward, terminated, truncated = result[:5]
        return state, (observations, reward, terminated, truncated)

    steps = 16 if form == "step" else SCANNED
    keys = jax.random.split(key, steps)
    actions = jax.vmap(jax.vmap(space.sample))(jax.random.split(key, (steps, size)))
    state = [first]
    compiled = jax.jit(step) if form == "step" else jax.jit(lambda state, drawn: jax.lax.scan(step, state, drawn))

    def call(k: int) -> None:
        drawn = (keys[k % steps], actions[k % steps]) if form == "step" else (keys, actions)
        state[0], results = compiled(state[0], drawn)
        jax.block_until_ready(results)

    return call


def envpool_calls(env_id: str, size: int, form: str) -> Callable[[int], Any]:
    """Return a function that makes the k-th call, one step of all environments, with as many threads as EnvPool uses.

    Args:
        env_id: Environment.
        size: Number of environments stepped together.
        form: Only "step".
    """
    import envpool  # pyright: ignore[reportMissingImports]
    import numpy as np

    if form != "step":
        raise ValueError(f"form must be 'step', got {form!r}.")
    envs = envpool.make(env_id, env_type="gymnasium", num_envs=size)
    envs.reset()
    rng = np.random.default_rng(0)
    discrete = hasattr(envs.action_space, "n")
    actions = rng.integers(0, envs.action_space.n, (16, size)) if discrete else None
    if actions is None:
        low, high = envs.action_space.low, envs.action_space.high
        actions = rng.uniform(low, high, (16, size, *low.shape)).astype(np.float32)
    return lambda k: envs.step(actions[k % 16])


def clone_calls(env_id: str, size: int, form: str) -> Callable[[int], Any]:
    """Return a function that makes the k-th call, one step of all environments.

    Args:
        env_id: Environment of `turtlebot_gym`, whichever clone that is.
        size: Number of environments stepped together.
        form: "scalar", "vector", or a vector with the noise "rough" or with the filter "slip".
    """
    import gymnasium as gym

    import turtlebot_gym  # noqa: F401

    options: dict[str, Any] = {"rough": {"noise": "rough"}, "slip": {"filter": "slip"}}.get(form, {})
    scalar = form == "scalar"
    env: Any = gym.make(env_id) if scalar else gym.make_vec(env_id, size, "vector_entry_point", **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]

    def call(k: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[k % 64])
        if scalar and (terminated or truncated):
            env.reset()

    return call


def versions_of(packages: tuple[str, ...]) -> dict[str, str]:
    """Return the versions of packages, and the file from which ``turtlebot_gym`` was imported, if it was."""
    versions = {"python": platform.python_version(), **{package: version(package) for package in packages}}
    clone = sys.modules.get("turtlebot_gym")
    return versions | ({"file": str(clone.__file__)} if clone else {})


CALLS = {
    "gymnax": (gymnax_calls, ("gymnax", "jax", "jaxlib", "numpy")),
    "envpool": (envpool_calls, ("envpool", "numpy")),
    "turtlebot_gym": (clone_calls, ("gymnasium", "numba", "numpy")),
}
"""Function that makes the calls of each peer, and packages whose versions are reported."""


def main(name: str, env_id: str, size: str, form: str) -> None:
    """Make the calls requested on standard input until it ends."""
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    make, packages = CALLS[name]
    call = make(env_id, int(size), form)
    call(0)  # compile
    print("ready", json.dumps(versions_of(packages)), flush=True)
    for line in sys.stdin:
        wall, cpu = time.perf_counter(), time.process_time()
        for k in range(int(line)):
            call(k)
        print("turn", json.dumps([time.perf_counter() - wall, time.process_time() - cpu]), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
