"""CPU seconds from command to policy of the shipped recipes, a process for each training.

The trainings of a seed follow one another, so that a busy machine meets all of them. Each policy drives unseen episodes, and
its mean time to the goal is divided by the baseline's where both arrive.
"""

from __future__ import annotations

import json as texts
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from typing import Any

import numpy as np
import tyro

from harness.machine import machine, on_one_thread
from harness.study import each, finished, publish
from turtlebot_gym_agents import evaluate

UNSEEN = 777_000_000
"""Seed of the first unseen episode."""
RECIPES = {
    "Nav": ("nav", "bearing", ()),
    "Nav, 40,960 steps": ("nav", "bearing", ("--steps", "40960")),
    "Nav, until success=1.0": ("nav", "bearing", ("--steps", "40960", "--until", "success=1.0")),
    "Square": ("square", "corner", ()),
    "Pose": ("pose", "ppo-pose", ()),
    "Nav, SAC": ("nav", "bearing", ("--algo", "sac")),
    "Rooms": ("rooms", "vfh", ("--steps", "262144")),
}
"""Trainings by name: task, the baseline beside which the policy drives, and more arguments of `turtlebot-gym train`."""


@cache
def baseline(env: str, policy: str, episodes: int) -> Any:
    """Return the evaluation of a baseline."""
    return evaluate(policy, env=env, episodes=episodes, seed=UNSEEN)


def trained(seed: int, name: str, episodes: int) -> dict[str, Any]:
    """Return a training by `turtlebot-gym train`, and how its policy drives."""
    env, beside, arguments = RECIPES[name]
    with tempfile.TemporaryDirectory() as folder:
        written, out = Path(folder, "result.json"), Path(folder, "run")
        command = [sys.executable, "-m", "turtlebot_gym_agents", "train", "--env", env, *arguments]
        before = getrusage(RUSAGE_CHILDREN)
        command += ["--seed", str(seed), "--out", str(out), "--json", str(written)]
        subprocess.run(command, env=on_one_thread(), check=True, capture_output=True)
        after = getrusage(RUSAGE_CHILDREN)
        steps = texts.loads(written.read_text(encoding="utf-8"))["runs"][0]["steps"]
        driven = evaluate(out / "policy.onnx", env=env, episodes=episodes, seed=UNSEEN)
    other = baseline(env, beside, episodes)
    both = driven["success"] & other["success"]
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    figures = {"success": np.mean(driven["success"]), "time": np.mean(driven["time"][both]) / np.mean(other["time"][both])}
    return {"seed": seed, "name": name, "episodes": episodes, "steps": steps, "cpu": spent, **figures}


def main(
    *,
    seeds: int = 5,
    episodes: int = 2000,
    only: tuple[str, ...] = tuple(RECIPES),
    kept: Path = Path("out/training.jsonl"),
    json: Path = Path("benchmarks/training.json"),
) -> None:
    """Train, print and write medians of CPU seconds, and the worst success and time.

    Args:
        seeds: Number of trainings of each recipe.
        episodes: Unseen episodes that each policy drives.
        only: Names of trainings.
        kept: File of the finished trainings, with which a repeated command goes on.
        json: File for the results.
    """
    options, begun, rows = {**locals()}, machine(), {}
    units = [(seed, name, episodes) for seed in range(seeds) for name in only]
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    done = list(each(finished(trained, units, kept, "seed name episodes", pool), "trainings", len(units)))
    for name in only:
        runs = [run for run in done if run["name"] == name]
        figures = {"success": min(run["success"] for run in runs), "time": max(run["time"] for run in runs)}
        rows[name] = {"steps": runs[0]["steps"], "total": median(run["cpu"] for run in runs), **figures}
    publish(json, {"machine": begun, "recipes": rows}, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
