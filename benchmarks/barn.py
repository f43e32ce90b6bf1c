"""Drive a Burger that was never trained on them through the 200 worlds of the BARN challenge.

A robot starts in front of each world's field of cylinders and must reach a goal behind it, 10 m further on. A world counts
once, with the mean over its episodes, which differ in their noise; intervals are over worlds. The score is like that of the
challenge's later years: success times T* / clip(T, 2 T*, 8 T*), at most 0.5, where T* is the time for the shortest path at
full speed.

    python benchmarks/barn.py ../shared/data/barn/worlds.npz --json benchmarks/barn.json

Finished drives are kept under `out/`, by commit, so an interrupted run resumes. A policy can be added to earlier results with
``--policy NAME --add-to benchmarks/barn.json``; each policy's commit is in the file.

References:
    Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020: the worlds.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from rich.table import Table

from harness.study import Study, run
from scenarios import kept, name_of, results_folder, run_all, slug
from turtlebot_gym.rooms.gazebo import enclosed
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, drive
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.provenance import plain, provenance, settings_of

AT_ONCE = 20
"""Number of worlds driven and stored together."""
FIGURES = ("success", "collision", "timeout", "barn", "spl", "time_to_goal")


Worlds = list[dict[str, float]]
"""A policy's figures in each world."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive policies through the worlds of the BARN challenge."""

    worlds: tyro.conf.Positional[Path]
    """The worlds as numbers: a NumPy archive with circles, their count in each world, start and goal."""
    policy: tuple[str, ...] = (
        "bearing", "bearing+safety", "gap", "gap+safety", "dwa", "dwa+safety", "vfh", "vfh+safety", "ppo-rooms",
        "ppo-rooms+safety", "oracle",
    )  # fmt: skip
    """As for `turtlebot-gym evaluate`."""
    lidar: str = "lds01"
    """LiDAR preset."""
    noise: str = "tutorial"
    """Noise preset."""
    episodes: int = 5
    """Episodes per world; episode i has the seed SEED + i."""
    seed: int = 1_000_000
    """The first seed."""
    limit: int = 5000
    """Longest episode, steps: 8 times the shortest."""
    first: int | None = None
    """Number of worlds to drive, from the first."""
    processes: int = 1
    """Number of parallel processes, each on one core; with 1 all runs in this one."""
    runs: Path | None = None
    """Folder of finished drives; by default out/barn/COMMIT."""
    add_to: tuple[Path, ...] = ()
    """Earlier results with the same settings, whose other policies are included in the new result."""


def read(path: Path) -> list[FloorPlan]:
    """Return the worlds of an archive."""
    held = np.load(path)
    start, goal = Pose(*held["start"].tolist()), Pose(*held["goal"].tolist(), math.pi / 2.0)
    worlds = np.split(held["circles"], np.cumsum(held["count"])[:-1])
    return [enclosed([tuple(circle) for circle in circles.tolist()], [], start=start, goal=goal) for circles in worlds]


def figures(policy: str, plan: FloorPlan, config: Config) -> dict[str, float]:
    """Return a policy's figures in a world."""
    envs = gym.make_vec(
        ROOMS,
        num_envs=config.episodes,
        vectorization_mode="vector_entry_point",
        info="full",
        world=plan,
        lidar=config.lidar,
        noise=config.noise,
        max_episode_steps=config.limit,
    )
    episodes, trajectory, p = drive(envs, policy, config.seed)
    envs.close()
    evaluation = Evaluation(
        config={}, limit=config.limit * p.dt, max_linear=p.robot.max_linear, episodes=episodes, trajectory=trajectory
    )
    return {name: interval.value for name, interval in evaluation.summary().items() if name in FIGURES}


def several(policy: str, plans: Sequence[FloorPlan], config: Config) -> Worlds:
    """Return a policy's figures in some worlds."""
    return [figures(policy, plan, config) for plan in plans]


def driven(folder: Path, policy: str, first: int, plans: Sequence[FloorPlan], config: Config) -> Worlds:
    """Return a policy's figures in consecutive worlds from a first number; missing ones are driven."""
    name = slug(
        policy=name_of(policy), worlds=f"{first}-{len(plans)}", lidar=config.lidar, noise=config.noise, n=config.episodes,
        seed=config.seed, limit=config.limit,
    )  # fmt: skip
    return kept(folder / f"{name}.pickle", several, policy, plans, config)


def settings(config: Config, policies: Iterable[str]) -> dict[str, Any]:
    """Return the settings of a result."""
    merged = settings_of(replace(config, policy=tuple(policies)))
    del merged["processes"]  # does not affect results
    return merged


def read_results(path: Path, config: Config) -> tuple[dict[str, Worlds], dict[str, str]]:
    """Read each policy's figures in all worlds, and the commit of its drives, from a file.

    Raises:
        ValueError: If the file's drives had other settings.
    """
    results = json.loads(path.read_text(encoding="utf-8"))
    policies = results["config"]["policy"]
    if results["config"] != plain(settings(config, policies)):
        raise ValueError(f"{path} has other settings, {results['config']}: drive its policies again.")
    nan = {None: math.nan}
    rows = {
        policy: [{name: nan.get(x, x) for name, x in world[policy].items()} for world in results["worlds"]]
        for policy in policies
    }
    return rows, results.get("commits") or dict.fromkeys(policies, results["commit"])


def drive_all(config: Config) -> dict[str, Worlds]:
    """Return the figures of all requested policies in all worlds."""
    plans, folder = read(config.worlds)[: config.first], config.runs or results_folder("barn")
    firsts = range(0, len(plans), AT_ONCE)
    jobs = [
        partial(driven, folder, policy, first, plans[first : first + AT_ONCE], config)
        for policy in config.policy for first in firsts
    ]  # fmt: skip
    results = iter(run_all(jobs, "policies and worlds", config.processes))
    return {policy: [world for _ in firsts for world in next(results)] for policy in config.policy}


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the figures of all policies, those of earlier results too, and their table."""
    rows, commits = {}, {}
    for path in config.add_to:
        more, at = read_results(path, config)
        rows, commits = rows | more, commits | at
    rows |= drive_all(config)
    commits |= dict.fromkeys(config.policy, provenance()["commit"])
    mean: dict[str, Any] = {
        policy: {name: metrics.mean([world[name] for world in worlds]) for name in FIGURES} for policy, worlds in rows.items()
    }
    count = len(next(iter(rows.values())))
    table = Table("", *FIGURES, title=f"{count} worlds of the BARN challenge, {config.episodes} episodes each")
    for policy, scores in mean.items():
        cells = (f"{interval.value:.3f} ± {0.5 * (interval.high - interval.low):.3f}" for interval in scores.values())
        table.add_row(policy, *cells)
    worlds = [dict(zip(rows, figures, strict=True)) for figures in zip(*rows.values(), strict=True)]
    return {"config": settings(config, rows), "mean": mean, "worlds": worlds, "commits": commits}, [table]


if __name__ == "__main__":
    run(Config, measure)
