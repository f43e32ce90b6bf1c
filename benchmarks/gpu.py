"""Steps per second of open ground on a GPU, and whether each step has the bits of the engine: two minutes of a GPU.

``--device torch-cpu --sizes 8 10 --seconds 0.2`` tries the script on this processor. Times are those of the wall, from a device
that has nothing to do to one that has done all.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro

from harness.machine import machine
from harness.study import publish
from turtlebot_gym.envs.navigation_device import NavigationDeviceEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv

SYSTEMS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "rough, gated": {"noise": "rough", "filter": "gated"},
    "wheel, late fixes": {"noise": "wheel", "fix": "late"},
}
"""Systems that are compared with the engine; the first one is measured."""
ROUNDS = 5
"""Measurements of a size, whose median counts."""


def equality(device: str, options: Mapping[str, Any], rows: int) -> dict[str, int]:
    """Return how many environment steps have the bits of the engine, of how many."""
    given = {"max_episode_steps": 40, "autoreset_mode": "SameStep"} | dict(options)
    engine, other = NavigationVectorEnv(rows, **given), NavigationDeviceEnv(rows, device=device, **given)
    rng, equal, steps = np.random.default_rng(0), 0, 50
    engine.reset(seed=0)
    other.reset(seed=0)
    for _ in range(steps):
        actions = rng.uniform(-1.2, 1.2, (rows, 2)).astype(np.float32)
        ours, theirs = engine.step(actions), other.step(torch.as_tensor(actions, device=other.device))
        same = (ours[0].view(np.int32) == theirs[0].cpu().numpy().view(np.int32)).all(axis=1)
        for one, two in zip(ours[1:4], theirs[1:4], strict=True):
            same &= one == two.cpu().numpy()
        equal += int(np.count_nonzero(same))
    return {"equal": equal, "steps": rows * steps}


def rate_of(env: NavigationDeviceEnv, seconds: float) -> dict[str, Any]:
    """Return the steps per second of an environment, and the memory of a GPU, bytes."""
    is_gpu = env.device.type == "cuda"
    env.reset(seed=0)
    actions = torch.rand((env.num_envs, 2), device=env.device) * 2.0 - 1.0

    def seconds_of(count: int) -> float:
        start = time.perf_counter()
        for _ in range(count):
            env.step(actions)
        if is_gpu:
            torch.cuda.synchronize(env.device)
        return time.perf_counter() - start

    seconds_of(5)  # the kernels are compiled and loaded
    count = max(3, int(seconds / ROUNDS / (seconds_of(3) / 3)))
    rate = statistics.median(env.num_envs * count / seconds_of(count) for _ in range(ROUNDS))
    memory = torch.cuda.max_memory_allocated(env.device) if is_gpu else None
    return {"environments": env.num_envs, "steps_per_second": rate, "memory_bytes": memory}


def main(
    *,
    device: str = "cuda",
    sizes: tuple[int, ...] = tuple(range(12, 23, 2)),
    seconds: float = 10.0,
    rows: int = 4096,
    json: Path = Path("benchmarks/gpu.json"),
) -> None:
    """Compare, measure, print and write.

    Args:
        device: cuda, cuda:1 and so on, or torch-cpu.
        sizes: Powers of two of environments.
        seconds: Time of a size, s.
        rows: Environments of a comparison.
        json: File for the results.
    """
    options = {**locals()}
    results: dict[str, Any] = {"machine": machine(), "device": "this processor" if device == "torch-cpu" else ""}
    results["equality"] = {name: equality(device, given, rows) for name, given in SYSTEMS.items()}
    results["rates"] = []
    for size in sizes:
        env = NavigationDeviceEnv(2**size, device=device, max_episode_steps=300, autoreset_mode="SameStep")
        results["device"] = results["device"] or torch.cuda.get_device_name(env.device)
        results["rates"].append(rate_of(env, seconds))
        env.close()
    print(results["device"], results["equality"])
    publish(json, results, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
