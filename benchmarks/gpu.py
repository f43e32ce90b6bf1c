"""Steps per second of open ground on a GPU, by wall time from a device that has nothing to do to one that has done all.

``--device torch-cpu --sizes 8 10 --seconds 0.2`` tries the script on this processor.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Any

import torch
import tyro

from harness.machine import machine
from harness.study import publish
from turtlebot_gym.envs.navigation_device import NavigationDeviceEnv

ROUNDS = 5  # of each size; the median counts


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
    json: Path = Path("benchmarks/gpu.json"),
) -> None:
    """Measure a device for some seconds with each size, a power of two of environments, and write."""
    options = {**locals()}
    results: dict[str, Any] = {"machine": machine(), "device": "this processor" if device == "torch-cpu" else ""}
    results["rates"] = []
    for size in sizes:
        env = NavigationDeviceEnv(2**size, device=device, max_episode_steps=300, autoreset_mode="SameStep")
        results["device"] = results["device"] or torch.cuda.get_device_name(env.device)
        results["rates"].append(rate_of(env, seconds))
        env.close()
    publish(json, results, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
