"""Program of a clone of this repository, which runs in its own process.

``python clone.py ENV SIZE FORM`` prints ``ready`` with the versions. For each number that it reads, it makes that many calls
and prints ``turn`` with their wall time and the CPU seconds of all threads.
"""

from __future__ import annotations

import json
import platform
import sys
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from typing import Any


def clone_calls(env_id: str, size: int, form: str) -> Callable[[int], Any]:
    """Return a function that makes the k-th call, one step of all environments.

    Args:
        env_id: Environment of `turtlebot_gym`, whichever clone that is.
        size: Number of environments stepped together.
        form: "scalar", "vector", or a vector with the noise "rough".
    """
    import gymnasium as gym

    import turtlebot_gym  # noqa: F401

    options: dict[str, Any] = {"rough": {"noise": "rough"}}.get(form, {})
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


def versions() -> dict[str, str]:
    """Return the versions of the libraries, and the file from which ``turtlebot_gym`` was imported."""
    found = {"python": platform.python_version(), **{name: version(name) for name in ("gymnasium", "llvmlite", "numpy")}}
    return found | {"file": str(sys.modules["turtlebot_gym"].__file__)}


def serve(call: Callable[[int], Any], ready: Mapping[str, Any]) -> None:
    """Say that the process is ready, and make the calls requested on standard input until it ends."""
    print("ready", json.dumps(ready), flush=True)
    for line in sys.stdin:
        wall, cpu = time.perf_counter(), time.process_time()
        for k in range(int(line)):
            call(k)
        print("turn", json.dumps([time.perf_counter() - wall, time.process_time() - cpu]), flush=True)


def main(env_id: str, size: str, form: str) -> None:
    """Serve the calls of an environment."""
    call = clone_calls(env_id, int(size), form)
    call(0)  # compile
    serve(call, versions())


if __name__ == "__main__":
    main(*sys.argv[1:])
