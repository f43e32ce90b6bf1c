"""Check the intervals of wheels and mount that `turtlebot-gym calibrate` finds from odometry and scans alone.

Each drive is a simulated tour of an office or of a room with obstacles, with wheels, alphas and a mount of its own; every
fourth LiDAR is turned by about half a turn, and taken to look ahead. Ranges have noise, but no common scale.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core; threads within would wait for each other

import numpy as np
import tyro
from scipy import stats

from harness.study import each, finished, write_summary
from harness.tables import table
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.evaluation.tours import simulated_tour
from turtlebot_gym_lab.scans.calibrating import by_scans, estimates_of
from turtlebot_gym_lab.scans.fit import NAMES

WORLDS = ("office", "dense")
TAKEN = Pose(-0.032, 0.0, 0.0)
"""Mount that is taken for granted."""


def judged(seed: int, world: str) -> dict[str, Any]:
    """Return for each parameter of a drive its error, its deviation, and whether the interval contains the truth."""
    random = np.random.default_rng([7, seed])
    alphas = {f"alpha{k}": float(np.exp(random.uniform(np.log(0.002), np.log(0.008)))) for k in range(1, 5)}
    scale, turn_scale, veer = random.uniform((0.9, 0.7, -0.1), (1.1, 1.3, 0.1)).tolist()
    x, y, yaw = random.uniform((-0.1, -0.05, -0.3), (0.1, 0.05, 0.3)).tolist()
    yaw = float(wrap(yaw + (np.pi if seed % 4 == 3 else 0.0)))
    lidar = replace(LIDARS["lds01"], x=x, y=y, yaw=yaw, accuracy=0.0)
    wheels = ProcessNoise(**alphas, scale=scale, turn_scale=turn_scale, veer=veer)
    drive = simulated_tour(world, seed=seed, wheels=wheels, lidar=lidar, time=300.0).drive
    found = by_scans(replace(drive, scans=tuple(seen._replace(mount=TAKEN) for seen in drive.scans)))
    rows = {}
    true = dict(zip(NAMES, (scale, turn_scale, veer, x, y, yaw, 0.0), strict=True)) | alphas
    for name, estimate in estimates_of(found).items():
        error = estimate.value - true[name]
        error = float(wrap(error)) if name == "mount_yaw" else error
        holds = estimate.low - estimate.value <= -error <= estimate.high - estimate.value
        half = 0.5 * (estimate.high - estimate.low) if estimate.is_determined else None
        rows[name] = {"error": error, "holds": bool(holds), "half": half, "is_determined": estimate.is_determined}
    return {"seed": seed, "world": world, "estimates": rows}


def summary(drives: list[dict[str, Any]]) -> dict[str, Any]:
    """Return coverage with its 95 % interval, bias and spread of each parameter, and the coverage of all together."""
    parameters, hits, count = {}, 0, 0
    for name in drives[0]["estimates"]:
        estimates = [drive["estimates"][name] for drive in drives if drive["estimates"][name]["is_determined"]]
        if not estimates:
            continue
        errors, held = np.array([estimate["error"] for estimate in estimates]), sum(e["holds"] for e in estimates)
        interval = stats.binomtest(held, len(estimates)).proportion_ci(0.95)
        parameters[name] = {
            "drives": len(estimates),
            "coverage": held / len(estimates),
            "interval": [float(interval.low), float(interval.high)],
            "bias": float(errors.mean()),
            "spread": float(errors.std()),
            "worst": float(np.abs(errors).max()),
            "half": float(np.median([estimate["half"] for estimate in estimates])),
        }
        hits, count = hits + held, count + len(estimates)
    return {"drives": len(drives), "all": hits / count, "parameters": parameters}


@dataclass(frozen=True, kw_only=True)
class Config:
    """Count how often intervals contain the truth."""

    drives: int = 100
    """Number of drives in each of the two worlds."""
    seed: int = 0
    """Seed of the first drive."""
    processes: int = 2
    """Number of processes."""
    kept: Path = Path("out/calibration_by_scans.jsonl")
    """File for finished drives; an interrupted run resumes."""
    results: Path | None = Path(__file__).parent / "calibration_by_scans.json"
    """File for the results."""


def main() -> None:
    """Judge all drives, print, and write the results."""
    config = tyro.cli(Config, description=__doc__)
    wanted = [(seed, world) for seed in range(config.seed, config.seed + config.drives) for world in WORLDS]
    with ProcessPoolExecutor(config.processes) as pool:
        drives = list(each(finished(judged, wanted, config.kept, ("seed", "world"), pool), "drives", len(wanted)))
    result = summary(drives)
    parameters = [{"name": key, **parameter} for key, parameter in result["parameters"].items()]
    print(f"\nall: {result['all']:.4f}\n")
    columns = {
        "parameter": "{name}",
        "held": "{coverage:.3f}",
        "bias": "{bias:.5f}",
        "spread": "{spread:.5f}",
        "drives": "{drives}",
    }
    print(table(parameters, columns))
    if config.results is not None:
        write_summary(config.results, {"coverage": result}, config)


if __name__ == "__main__":
    main()
