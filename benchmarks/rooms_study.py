"""The study of rooms: policies, worlds, LiDARs and pose estimates; it also makes `ppo-rooms`.

PPO begins with VFH+ and is trained with several seeds, on worlds, LiDARs and noise that differ between environments. The best
training on the trainings' own evaluation seeds is the policy shipped with the package. Every policy drives the same held-out
rooms of each setting, on seeds that neither trainings nor tunings use. The baselines have their defaults, which were tuned for
`dense`. All trainings together form one row, whose intervals include the variance between trainings. With ``--seeds 0`` nothing
is trained, and the package's own `ppo-rooms` drives.

Trainings and drives are kept in a folder, so an interrupted run resumes; another commit needs another folder.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import chain
from multiprocessing import get_context
from pathlib import Path
from shutil import copyfile, rmtree
from typing import Any

import numpy as np
import tyro

from harness.study import each, finished, publish
from turtlebot_gym.files import load
from turtlebot_gym.rooms.grid import OCCUPIED, GridMap
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.maps import FAR_ENOUGH
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS as WORLDS
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.named import SAFETY
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train

MAP = "map"
"""Setting whose world is the map of a hall, see `hall`."""
ELSEWHERE = ("office", "cellular", "corridor", "crowd")
"""Worlds besides "dense" that are driven with other LiDARs too."""
TURNS = ("lds02", {"beams": 261, "rate": 9.1}), ("a1", {"beams": 720, "rate": 1.0 / 0.135})
"""LiDARs as they turned on recorded robots."""
SETTINGS: dict[str, dict[str, Any]] = {
    **{world: {"world": world} for world in WORLDS},
    MAP: {},
    **{f"dense, {lidar}": {"world": "dense", "lidar": lidar} for lidar in ("lds02", "a1", "urg04lx", "ideal")},
    **{f"{world}, {lidar}": {"world": world, "lidar": lidar} for world in ELSEWHERE for lidar in ("lds02", "a1", "ideal")},
    **{f"dense, {lidar} as recorded": {"world": "dense", "lidar": replace(LIDARS[lidar], **turns)} for lidar, turns in TURNS},
    **{
        f"dense, {observation}, noise {noise}": {"world": "dense", "observation": observation, "noise": noise}
        for noise in ("documented", "rough")
        for observation in ("truth", "ekf", "odometry")
    },
    **{f"{world}, noise wheel": {"world": world, "noise": "wheel"} for world in ("dense", "office", "cellular", "corridor")},
}
"""Settings by name: arguments of the environment that differ from its defaults."""
COMPARED_WITH, SHIPPED = "vfh", "ppo-rooms"


def hall(seed: int = 0) -> FloorPlan:
    """Return a map of 20 m by 20 m at 5 cm: walls around, shelves and pillars."""
    random, cells = np.random.default_rng(seed), np.zeros((400, 400), np.int8)
    for _ in range(120):
        i, j, height, width = *random.integers(0, 390, 2), *random.integers(2, 25, 2)
        cells[i : i + height, j : j + width] = OCCUPIED
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    grid = GridMap(cells=cells, resolution=0.05)
    return FloorPlan(walls=grid.walls(), map=grid, max_distance=FAR_ENOUGH)


def trained(seed: int, steps: int | None, out: str) -> dict[str, Any]:
    """Return a training's policy, and its return on the trainings' own evaluation seeds."""
    run = Path(out) / f"ppo-{seed}"
    rmtree(run, ignore_errors=True)  # of an interrupted training
    train(TrainingConfig(steps=steps, seed=seed, randomize=True, env=ROOMS), run, progress=False)
    best = load(run / "result.json")["best"]
    return {"seed": seed, "steps": steps, "out": out, "policy": str(run / "policy.onnx"), "return": best["return"]}


def drive(policy: str, setting: str, episodes: int, seed: int) -> dict[str, Any]:
    """Return how a policy's episodes in a setting end, and after what time, s."""
    options = {"world": hall()} if setting == MAP else SETTINGS[setting]
    # Some settings show another pose than a bundle was trained on: how much that matters is what they measure.
    run = evaluate(policy, env=ROOMS, episodes=episodes, seed=seed, allow_mismatch=True, **options)
    ends = {"success": run.episodes.success, "collision": run.episodes.collision, "time": run.times()}
    return {"policy": policy, "setting": setting, "episodes": episodes, "seed": seed, **ends}


def figures(runs: Sequence[dict[str, Any]], reference: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of a policy; for several trainings, with their variance in the intervals."""
    success, collision, time = (np.array([run[part] for run in runs]) for part in ("success", "collision", "time"))
    others = np.array(reference["success"])
    if len(runs) == 1:
        figures = {
            "success": metrics.share(success[0]),
            "collision": metrics.share(collision[0]),
            "time": metrics.mean(time[0]),
        }
        return {**figures, "success_difference": metrics.paired_share_difference(success[0], others)}
    together = comparison.share(success)
    return {
        "success": together,
        "collision": comparison.share(collision),
        "time": comparison.spread(time).interval(),
        "success_difference": metrics.share_difference(together, metrics.share(others)),
    }


def later(protected: dict[str, Any], bare: dict[str, Any]) -> metrics.Interval:
    """Return by how much the safety layer delays the arrival in rooms that the policy crosses with and without it, s."""
    both = np.array(protected["success"]) & np.array(bare["success"])
    return metrics.mean((np.array(protected["time"]) - np.array(bare["time"]))[both])


def main(
    *,
    policy: tuple[str, ...] = ("bearing", "bearing+safety", "vfh", "vfh+safety", "planner", "planner+safety", "oracle"),
    seeds: int = 3,
    steps: int | None = None,
    only: tuple[str, ...] = tuple(SETTINGS),
    episodes: int = 1000,
    first_seed: int = 1_000_000,
    processes: int = 2,
    out: Path = Path("out/rooms"),
    json: Path = Path("benchmarks/rooms_study.json"),
) -> None:
    """Train, drive, print, and write results, and the best policy into the folder.

    Args:
        policy: As for `turtlebot-gym evaluate`.
        seeds: Number of trainings, with seeds from 0; 0 for none.
        steps: Steps of each training; by default those of the configuration.
        only: Settings by name.
        episodes: Number of rooms of each setting.
        first_seed: First seed of the rooms, which are the first episodes of these seeds.
        processes: Number of parallel processes, each on one core.
        out: Folder of finished work.
        json: File for the results.
    """
    options, rows = {**locals()}, []
    os.environ.update(TURTLEBOT_GYM_THREADS="1", OMP_NUM_THREADS="1")  # of the processes

    def all_of(judge: Any, units: list[tuple[Any, ...]], names: str) -> list[dict[str, Any]]:
        pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
        return [*each(finished(judge, units, out / f"{judge.__name__}.jsonl", names, pool), judge.__name__, len(units))]

    runs = all_of(trained, [(seed, steps, str(out)) for seed in range(seeds)], "seed steps out")
    best = max(runs, key=lambda run: run["return"])["policy"] if runs else SHIPPED
    kinds = {name: [name] for name in (*policy, COMPARED_WITH)} | {SHIPPED: [best], SHIPPED + SAFETY: [best + SAFETY]}
    if runs:
        kinds[f"ppo, {seeds} trainings"] = [run["policy"] for run in runs]
        copyfile(best, out / f"{SHIPPED}.onnx")
    units = [(name, place, episodes, first_seed) for place in only for name in dict.fromkeys(chain(*kinds.values()))]
    driven = {(run["policy"], run["setting"]): run for run in all_of(drive, units, "policy setting episodes seed")}
    for place in only:
        for kind, names in kinds.items():
            line = figures([driven[name, place] for name in names], driven[COMPARED_WITH, place])
            bare = names[0].removesuffix(SAFETY), place
            if names[0].endswith(SAFETY) and bare in driven:
                line["later"] = later(driven[names[0], place], driven[bare])
            rows.append({"setting": place, "policy": kind, **line})
    publish(json, {"rows": rows}, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
