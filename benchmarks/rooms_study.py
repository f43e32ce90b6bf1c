"""The study of rooms: policies, worlds, LiDARs and pose estimates; it also makes `ppo-rooms`.

PPO begins with VFH+ and is trained with several seeds, on worlds, LiDARs and noise that differ between environments. The best
training on the trainings' own evaluation seeds is the policy shipped with the package. Every policy drives the same held-out
rooms of each setting, on seeds that neither trainings nor tunings use. The baselines have their defaults, which were tuned for
`dense`. All trainings together form one row, whose intervals include the variance between trainings. With ``--keep`` the
package keeps the policy that it has, and that one drives.

Trainings and drives are kept under `out/`, by commit, so an interrupted run resumes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
import tyro

from harness.study import write_summary
from harness.tables import table
from scenarios import best_of_trainings, kept, name_of, results_folder, run_all, slug, trainings
from turtlebot_gym.rooms.grid import OCCUPIED, GridMap
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.maps import FAR_ENOUGH
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS as WORLDS
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.evaluation.result import Evaluation
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.named import SAFETY
from turtlebot_gym_agents.provenance import plain, settings_of, write_json

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
COMPARED_WITH = "vfh"
"""Baseline with whose success the others are compared."""
SHIPPED = "ppo-rooms"
UNREAD = ("barn", "clearance_5th", "collision_difference", "spl", "timeout")
"""Parts of the results that no page shows."""
COLUMNS = {
    "setting": "{setting}",
    "policy": "{policy}",
    "success, %": "{success:.1%}",
    f"minus {COMPARED_WITH}, points": "{success_difference:.1%}",
    "collisions, %": "{collision:.1%}",
    "time, s": "{time.value:.2f}",
}


@dataclass(frozen=True, kw_only=True)
class Config:
    """Train and drive all policies."""

    policy: tuple[str, ...] = (
        "bearing",
        "bearing+safety",
        "vfh",
        "vfh+safety",
        "planner",
        "planner+safety",
        "oracle",
    )
    """As for `turtlebot-gym evaluate`."""
    seeds: int = 3
    """Number of trainings, with seeds from 0; 0 for none."""
    steps: int | None = None
    """Steps of each training; by default those of the configuration."""
    keep: bool = False
    """Whether `ppo-rooms` stays the policy that is in the package; by default the best of these trainings replaces it."""
    only: tuple[str, ...] = ()
    """Settings by name; by default all."""
    episodes: int = 1000
    """Number of rooms of each setting."""
    first_seed: int = 1_000_000
    """First seed of the rooms, which are the first episodes of these seeds."""
    processes: int = 2
    """Number of parallel processes, each on one core; with 1 all runs in this one."""
    runs: Path | None = None
    """Folder of trainings and drives; by default out/pretrained/COMMIT."""
    out: Path = Path("out/rooms")
    """Folder for the policy and all results."""
    json: Path = Path("benchmarks/rooms_study.json")
    """File for their summary."""


def hall(seed: int = 0) -> GridMap:
    """Return a map of 20 m by 20 m at 5 cm: walls around, shelves and pillars."""
    random, cells = np.random.default_rng(seed), np.zeros((400, 400), np.int8)
    for _ in range(120):
        i, j, height, width = *random.integers(0, 390, 2), *random.integers(2, 25, 2)
        cells[i : i + height, j : j + width] = OCCUPIED
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    return GridMap(cells=cells, resolution=0.05)


def drive(folder: Path, policy: str, name: str, config: Config) -> Evaluation:
    """Return a policy's episodes in a setting, which are driven if missing; a bundle is identified by its bytes."""
    stem = slug(policy=name_of(policy), setting=name, n=config.episodes, seed=config.first_seed)
    return kept(folder / "drives" / f"{stem}.pickle", evaluation_of, policy, name, config)


def evaluation_of(policy: str, name: str, config: Config) -> Evaluation:
    """Drive a policy in a setting."""
    options = SETTINGS[name]
    if name == MAP:
        grid = hall()
        options = {"world": FloorPlan(walls=grid.walls(), map=grid, max_distance=FAR_ENOUGH)}
    # Some settings show another pose than a bundle was trained on: how much that matters is what they measure.
    return evaluate(policy, env=ROOMS, episodes=config.episodes, seed=config.first_seed, allow_mismatch=True, **options)


def row(name: str, policy: str, driven: Sequence[Evaluation], reference: Evaluation) -> dict[str, Any]:
    """Return the figures of one policy, or of several trainings of one kind, in a setting."""
    content = {"setting": name, "policy": policy, **figures(driven)}
    differences = {}
    for part in ("success", "collision"):
        others = getattr(reference.episodes, part)
        if len(driven) == 1:
            differences[f"{part}_difference"] = metrics.paired_share_difference(getattr(driven[0].episodes, part), others)
        else:
            differences[f"{part}_difference"] = metrics.share_difference(content[part], metrics.share(others))
    return {**content, **differences}


def figures(driven: Sequence[Evaluation]) -> dict[str, Interval]:
    """Return the figures of a policy; for several trainings, with their variance in the intervals."""
    if len(driven) == 1:
        summary = driven[0].summary()
        return {key: summary[key] for key in ("success", "collision", "timeout", "spl", "barn", "clearance_5th", "time")}
    e = [evaluation.episodes for evaluation in driven]
    success, collision = (np.array([getattr(evaluation, key) for evaluation in e]) for key in ("success", "collision"))
    return {
        "success": comparison.share(success),
        "collision": comparison.share(collision),
        "timeout": comparison.share(~success & ~collision),
        "spl": comparison.spread([evaluation.spl() for evaluation in driven]).interval(),
        "clearance_5th": metrics.mean([metrics.quantile(evaluation.clearance, 0.05).value for evaluation in e]),
        "time": comparison.spread([evaluation.times() for evaluation in driven]).interval(),
    }


def study(config: Config, folder: Path, runs: Sequence[Path], shipped: str | None) -> list[dict[str, Any]]:
    """Drive all policies in all settings, each once, and return the rows."""
    bundles = [str(run / "policy.onnx") for run in runs]
    kinds = {policy: [policy] for policy in (*config.policy, COMPARED_WITH)}
    if shipped is not None:
        kinds |= {SHIPPED: [shipped], SHIPPED + SAFETY: [shipped + SAFETY]}
    if len(bundles) > 1:
        kinds[f"ppo, {len(bundles)} trainings"] = bundles
    names = config.only or tuple(SETTINGS)
    pairs = [(policy, name) for name in names for policy in dict.fromkeys(driver for kind in kinds.values() for driver in kind)]
    evaluations = run_all([partial(drive, folder, *pair, config) for pair in pairs], "settings and policies", config.processes)
    by_pair: Mapping[tuple[str, str], Evaluation] = dict(zip(pairs, evaluations, strict=True))
    rows = []
    for name in names:
        for kind, policies in kinds.items():
            line = row(name, kind, [by_pair[policy, name] for policy in policies], by_pair[COMPARED_WITH, name])
            bare = policies[0].removesuffix(SAFETY), name
            if policies[0].endswith(SAFETY) and bare in by_pair:
                line["later"] = later(by_pair[policies[0], name], by_pair[bare])
            rows.append(line)
    return rows


def later(protected: Evaluation, bare: Evaluation) -> Interval:
    """Return by how much the safety layer delays the arrival in rooms that the policy crosses with and without it, s."""
    with_layer, without = protected.episodes, bare.episodes
    return metrics.mean((with_layer.time - without.time)[with_layer.success & without.success])


def main() -> None:
    """Train, drive, print a table, and write policy, card and results."""
    config = tyro.cli(Config, description=__doc__)
    folder = config.runs or results_folder("pretrained")
    jobs = trainings(folder, config.steps, config.seeds, env=ROOMS)
    runs = run_all(jobs, "trainings", config.processes)
    shipped = SHIPPED if config.keep else (str(best_of_trainings(runs) / "policy.onnx") if runs else None)
    rows = study(config, folder, runs, shipped)
    print(table(plain(rows), COLUMNS))
    if shipped is not None and not config.keep:
        config.out.mkdir(parents=True, exist_ok=True)
        copyfile(shipped, config.out / f"{SHIPPED}.onnx")
    write_json(config.out / "rooms_study.json", {"rows": rows}, config=settings_of(config))
    write_summary(config.json, {"rows": rows}, config, UNREAD)


if __name__ == "__main__":
    main()
