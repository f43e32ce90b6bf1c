"""Steps per second of open ground on a GPU, and whether each step has the bits of the engine: two minutes of a GPU.

``python benchmarks/gpu.py --json benchmarks/gpu.json`` measures on a CUDA device.
``--device torch-cpu --sizes 8 10 --seconds 0.2`` tries the script, on this processor. Times are those of the wall, from a
device that has nothing to do to one that has done all.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from harness.machine import machine
from turtlebot_gym.envs.navigation_device import NavigationDeviceEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.files import write_text

SYSTEMS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "rough, gated": {"noise": "rough", "filter": "gated"},
    "wheel, late fixes": {"noise": "wheel", "fix": "late"},
}
"""Systems that are compared with the engine; the first one is measured."""
STEPS = 300
"""Steps after which an episode is truncated."""
ROUNDS = 5
"""Measurements of a size, whose median counts."""
SAME = "SameStep"


def equality(device: str, options: Mapping[str, Any], *, rows: int, steps: int) -> dict[str, int]:
    """Return how many environment steps have the bits of the engine, of how many, and how many episodes ended in them."""
    given = {"max_episode_steps": 40, "autoreset_mode": SAME} | dict(options)
    engine, other = NavigationVectorEnv(rows, **given), NavigationDeviceEnv(rows, device=device, **given)
    rng, equal, ends = np.random.default_rng(0), 0, 0
    engine.reset(seed=0)
    other.reset(seed=0)
    for _ in range(steps):
        actions = rng.uniform(-1.2, 1.2, (rows, 2)).astype(np.float32)
        ours, theirs = engine.step(actions), other.step(torch.as_tensor(actions, device=other.device))
        same = (ours[0].view(np.int32) == theirs[0].cpu().numpy().view(np.int32)).all(axis=1)
        for one, two in zip(ours[1:4], theirs[1:4], strict=True):
            same &= one == two.cpu().numpy()
        equal += np.count_nonzero(same)
        ends += np.count_nonzero(ours[2] | ours[3])
    return {"equal": int(equal), "steps": rows * steps, "episodes": int(ends)}


def rate_of(env: NavigationDeviceEnv, *, seconds: float) -> dict[str, Any]:
    """Return the steps per second of an environment: the median of some rounds, with the least and the most."""
    is_gpu = env.device.type == "cuda"

    def wait() -> None:
        if is_gpu:
            torch.cuda.synchronize(env.device)

    env.reset(seed=0)
    actions = torch.rand((env.num_envs, 2), device=env.device) * 2.0 - 1.0

    def seconds_of(count: int) -> float:
        wait()
        start = time.perf_counter()
        for _ in range(count):
            env.step(actions)
        wait()
        return time.perf_counter() - start

    seconds_of(5)  # the kernels are compiled and loaded
    count = max(3, int(seconds / ROUNDS / (seconds_of(3) / 3)))
    rates = [env.num_envs * count / seconds_of(count) for _ in range(ROUNDS)]
    return {
        "environments": env.num_envs,
        "steps_per_second": statistics.median(rates),
        "range": [min(rates), max(rates)],
        "steps": count,
        "memory_bytes": torch.cuda.max_memory_allocated(env.device) if is_gpu else None,
    }


def device_of(device: torch.device) -> dict[str, Any]:
    """Describe the device that the kernels ran on."""
    is_gpu = device.type == "cuda"
    name = torch.cuda.get_device_name(device) if is_gpu else "this processor; no GPU"
    versions = {"llvmlite": version("llvmlite"), "torch": torch.__version__, "cuda": torch.version.cuda if is_gpu else None}
    return {"backend": "CUDA" if is_gpu else "CPU", "name": name} | versions


def main(argv: Sequence[str] | None = None) -> None:
    """Compare, measure, print, and write the JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--device", default="cuda", help="cuda, cuda:1 and so on, or torch-cpu (default: cuda)")
    sizes = list(range(12, 23, 2))
    parser.add_argument("--sizes", type=int, nargs="+", default=sizes, help="powers of two of environments (default: 12 to 22)")
    parser.add_argument("--seconds", type=float, default=10.0, help="time of a size, s (default: 10)")
    parser.add_argument("--rows", type=int, default=4096, help="environments of a comparison (default: 4096)")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args(argv)
    result: dict[str, Any] = {"options": {"device": options.device, "rows": options.rows, "seconds": options.seconds}}
    for name, given in SYSTEMS.items():
        found = equality(options.device, given, rows=options.rows, steps=50)
        result.setdefault("equality", {})[name] = found
        print(f"{name:<20} {found['equal']:,} of {found['steps']:,} steps have the bits of the engine", flush=True)
    for size in options.sizes:
        env = NavigationDeviceEnv(2**size, device=options.device, max_episode_steps=STEPS, autoreset_mode=SAME)
        if "device" not in result:
            result |= {"device": device_of(env.device), "machine": machine()}
            print(f"on {result['device']['name']} ({result['device']['backend']})")
        found = rate_of(env, seconds=options.seconds)
        result.setdefault("rates", []).append(found)
        print(f"2^{size:<2} environments: {found['steps_per_second']:,.0f} steps/s", flush=True)
        env.close()
    if options.json:
        write_text(options.json, json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
