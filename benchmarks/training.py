"""CPU seconds from command to policy of the shipped recipes, a process for each training.

The trainings of a seed follow one another, so that a busy machine meets all of them. Each policy drives unseen episodes, and
its mean time to the goal is divided by the baseline's where both arrive.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from harness.machine import machine
from harness.process import HERE, environment_of
from harness.study import Study, each, finished, run
from turtlebot_gym_agents import evaluate

UNSEEN = 777_000_000
"""Seed of the first unseen episode."""


class Recipe(NamedTuple):
    """A training, and the baseline beside which its policy drives."""

    arguments: tuple[str, ...]
    """Arguments of `turtlebot-gym train`."""
    env: str = "nav"
    """Task."""
    baseline: str = "bearing"
    """Policy without learning."""


ROOMS = "262144"
"""Steps in rooms."""
RECIPES = {
    "Nav": Recipe(()),
    "Nav, 40,960 steps": Recipe(("--steps", "40960")),
    "Nav, until success=1.0": Recipe(("--steps", "40960", "--until", "success=1.0")),
    "Square": Recipe((), "square", "corner"),
    "Pose": Recipe((), "pose", "ppo-pose"),
    "Nav, SAC": Recipe(("--algo", "sac")),
    "Rooms": Recipe(("--steps", ROOMS), "rooms", "vfh"),
}
"""Trainings by name."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Train the shipped recipes."""

    seeds: int = 5
    """Number of trainings of each."""
    episodes: int = 2000
    """Unseen episodes that each policy drives."""
    only: tuple[str, ...] = tuple(RECIPES)
    """Names of trainings."""
    kept: Path = Path("out/training.jsonl")
    """File of the finished trainings, with which a repeated command goes on."""


@cache
def baseline(env: str, policy: str, episodes: int) -> Any:
    """Return the evaluation of a baseline."""
    return evaluate(policy, env=env, episodes=episodes, seed=UNSEEN)


def ours(recipe: Recipe, seed: int, episodes: int) -> dict[str, Any]:
    """Return a training by `turtlebot-gym train`, and how its policy drives."""
    with tempfile.TemporaryDirectory() as folder:
        written, out = Path(folder, "result.json"), Path(folder, "run")
        command = [sys.executable, "-m", "turtlebot_gym_agents", "train", "--env", recipe.env, *recipe.arguments]
        command += ["--seed", str(seed), "--out", str(out), "--json", str(written)]
        before = getrusage(RUSAGE_CHILDREN)
        subprocess.run(command, env=environment_of(HERE), check=True, capture_output=True)
        after = getrusage(RUSAGE_CHILDREN)
        result = json.loads(written.read_text(encoding="utf-8"))
        driven = evaluate(out / "policy.onnx", env=recipe.env, episodes=episodes, seed=UNSEEN)
    other = baseline(recipe.env, recipe.baseline, episodes)
    both = driven["success"] & other["success"]
    ratio = float(np.mean(driven["time"][both]) / np.mean(other["time"][both]))
    success = float(np.mean(driven["success"]))
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"steps": result["runs"][0]["steps"], "cpu": spent, "success": success, "time": ratio}


def trained(seed: int, name: str, episodes: int) -> dict[str, Any]:
    """Return a training by its name in `RECIPES`."""
    return {"seed": seed, "name": name, "episodes": episodes, **ours(RECIPES[name], seed, episodes)}


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the trainings by name, and a table: medians of CPU seconds, and the worst success and time."""
    about, begun = ("seed", "name", "episodes"), machine()
    units = [(seed, name, config.episodes) for seed in range(config.seeds) for name in config.only]
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    done = list(each(finished(trained, units, config.kept, about, pool), "trainings", len(units)))
    table = Table("training", "steps", "CPU s", "success", "time")
    rows: dict[str, dict[str, Any]] = {}
    for name in config.only:
        runs = [run for run in done if run["name"] == name]
        row = {"success": min(run["success"] for run in runs), "time": max(run["time"] for run in runs)}
        rows[name] = {"trainings": len(runs), "steps": runs[0]["steps"], "total": median(run["cpu"] for run in runs), **row}
        table.add_row(
            name, f"{runs[0]['steps']:,}", f"{rows[name]['total']:.2f}", f"{row['success']:.1%}", f"{row['time']:.3f}"
        )
    return {"machine": {**begun, "load_after": os.getloadavg()[0]}, "recipes": rows}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
