"""CPU seconds from command to policy of the shipped recipes, a process for each training.

The trainings of a seed follow one another, so that a busy machine meets all of them. Each policy drives unseen episodes, and
its mean time to the goal is divided by the baseline's where both arrive.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from typing import Any

import numpy as np
import tyro

from harness.machine import machine
from harness.study import each, finished, publish
from turtlebot_gym.files import load
from turtlebot_gym_agents import evaluate

UNSEEN = 777_000_000  # seed of the first unseen episode
RECIPES = {
    "Nav": ("nav", "bearing", ()),
    "Nav, 40,960 steps": ("nav", "bearing", ("--steps", "40960")),
    "Square": ("square", "corner", ()),
    "Pose": ("pose", "ppo-pose", ()),
}
"""Trainings by name: task, the baseline beside which the policy drives, and more arguments of `turtlebot-gym train`."""


def trained(seed: int, name: str, episodes: int) -> dict[str, Any]:
    """Return a training by `turtlebot-gym train`, and how its policy drives."""
    env, baseline, arguments = RECIPES[name]
    with tempfile.TemporaryDirectory() as folder:
        result, out = Path(folder, "result.json"), Path(folder, "run")
        command = [sys.executable, "-m", "turtlebot_gym_agents", "train", "--env", env, *arguments]
        before = getrusage(RUSAGE_CHILDREN)
        subprocess.run([*command, "--seed", str(seed), "--out", out, "--json", result], check=True, capture_output=True)
        after, steps = getrusage(RUSAGE_CHILDREN), load(result)["runs"][0]["steps"]
        driven, other = (evaluate(who, env=env, episodes=episodes, seed=UNSEEN) for who in (out / "policy.onnx", baseline))
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
    """Train each recipe with some seeds, which are kept and not repeated; write median CPU seconds, worst success and time."""
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
