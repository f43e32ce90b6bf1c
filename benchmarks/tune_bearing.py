"""Tune `BearingPolicy`: try all combinations of its parameters on the same episodes, and rank them by mean time to the goal.

The seeds are not those that policies are evaluated with. A failure counts as the time limit.

    python benchmarks/tune_bearing.py
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from turtlebot_gym.robots import ROBOTS
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import BearingPolicy
from turtlebot_gym_agents.provenance import write_json


@dataclass(frozen=True)
class Config:
    """Tune the geometric baseline."""

    gain: tuple[float, ...] = (3.0, 4.0, 6.0, 8.0)
    """Values to try, 1/s."""
    focus: tuple[float, ...] = (0.5, 1.0, 2.0)
    """Values to try."""
    tolerance: tuple[float, ...] = (0.0, 0.02, 0.03, 0.045)
    """Values to try, m."""
    robot: tuple[str, ...] = ("burger", "tutorial")
    """Robots over which the time is averaged ..."""
    noise: tuple[str, ...] = ("tutorial", "documented")
    """... and noise presets."""
    episodes: int = 1000
    """Episodes for each."""
    seed: int = 1_000_000
    """The first seed."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the results here too."""


def main() -> None:
    """Try all, and print the best ten."""
    config = tyro.cli(Config, description=__doc__)
    settings = list(itertools.product(config.robot, config.noise))
    results = []
    grid = list(itertools.product(config.gain, config.focus, config.tolerance))
    for gain, focus, tolerance in track(grid, console=Console(stderr=True)):
        times = []
        for robot, noise in settings:
            policy = BearingPolicy(ROBOTS[robot], gain=gain, focus=focus, tolerance=tolerance)
            run = evaluate(policy, episodes=config.episodes, seed=config.seed, robot=robot, noise=noise)
            times.append(run.summary()["time"].value)
        results.append({"gain": gain, "focus": focus, "tolerance": tolerance, "time": float(np.mean(times)), "times": times})
    results.sort(key=lambda result: result["time"])
    table = Table("gain", "focus", "tolerance", "mean time, s", *(", ".join(setting) for setting in settings))
    for result in results[:10]:
        numbers = (result["gain"], result["focus"], result["tolerance"])
        table.add_row(*map(str, numbers), f"{result['time']:.3f}", *(f"{time:.3f}" for time in result["times"]))
    Console(width=120).print(table)
    if config.json is not None:
        write_json(config.json, {"results": results}, config=vars(config))


if __name__ == "__main__":
    main()
