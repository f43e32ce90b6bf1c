"""Check whether a calibration's intervals contain the truth, and what it gains on recorded drives.

`make bench-calibration` runs both parts. The first fits the noise model to five-minute drives of the environment with random
known noise, from the innovations alone, and counts how often the 95 % intervals contain the known values. (From the truth:
`calibration_intervals.py`.) It takes a quarter of an hour of one core; finished fits are kept in ``--kept``, and an interrupted
run resumes. The second
calibrates on one recorded drive and evaluates on the other.
"""

from __future__ import annotations

import math
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from scipy import stats

from harness.study import each, finished
from turtlebot_gym import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.calibration import calibrate
from turtlebot_gym.calibration.coordinates import PARAMETERS, value_of
from turtlebot_gym.drives import read
from turtlebot_gym_agents.evaluation.calibration import judge, simulated_log
from turtlebot_gym_agents.evaluation.replay import replay
from turtlebot_gym_agents.provenance import provenance, settings_of, write_json

RESULTS = {"coverage": "calibration.json", "recorded": "calibration_recorded.json"}
"""File for each part's results."""
RECORDED = ("wifibot1.txt", "wifibot2.txt")
VIEW = "innovations"


@dataclass(frozen=True, kw_only=True)
class Config:
    """Calibrate drives with known noise, and recorded ones."""

    part: Literal["coverage", "recorded"] = "coverage"
    """Part to run: coverage of intervals, or gain of a calibration on recorded drives."""
    drives: int = 200
    """Number of drives of five minutes, each with its own noise."""
    seed: int = 0
    """Seed of the first drive."""
    data: Path = Path("../shared/data")
    """Folder with the recorded drives."""
    seeds: int = 20
    """Number of seeds for the measured poses on recorded drives."""
    results: Path | None = Path(__file__).parent
    """Folder for the results."""
    kept: Path = Path("out/calibration")
    """Folder for finished fits."""
    seconds: float = float("inf")
    """Time limit of this run, s; the next run resumes."""


def random_noise(seed: int) -> Noise:
    """Return a random noise model: sensors from good to poor, execution noise around that of a real robot."""
    random = np.random.default_rng([seed, 7])
    x, y, heading = random.uniform((0.02, 0.02, 0.03), (0.08, 0.08, 0.12))
    alphas = np.exp(random.uniform(np.log(0.002), np.log(0.012), 4))
    return Noise(
        process=ProcessNoise(
            **{f"alpha{k}": float(alpha) for k, alpha in enumerate(alphas, start=1)}, scale=float(random.uniform(0.95, 1.05))
        ),
        odometry=OdometryNoise(
            R=(x * x, y * y, heading * heading),
            bias=tuple(random.uniform(-0.05, 0.05, 3).tolist()),
            spike_probability=float(random.uniform(0.01, 0.04)),
            spike=float(heading * random.uniform(3.0, 6.0)),
            dropout_probability=float(random.uniform(0.0, 0.1)),
        ),
    )


def true_value(noise: Noise, name: str) -> float:
    """Return a parameter of a noise model."""
    return value_of(noise, name) if name in PARAMETERS else noise.odometry.dropout_probability


def calibrated(seed: int) -> dict[str, Any]:
    """Return the fit to one drive with the true values."""
    noise = random_noise(seed)
    log = simulated_log(noise, seed=seed)
    began = time.process_time()
    calibration = calibrate(log, use_truth=False)
    names = ("value", "low", "high", "unit", "is_profile", "is_determined")
    rows = {
        name: {"true": true_value(noise, name)} | {key: getattr(estimate, key) for key in names}
        for name, estimate in calibration.estimates.items()
    }
    return {"seed": seed, "view": VIEW, "seconds": time.process_time() - began, "estimates": rows}


def coverage(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how often the intervals of each parameter contain the truth, among all drives and those that determine it."""
    content = {}
    for name in (*PARAMETERS, "dropout_probability"):
        ones = [row["estimates"][name] for row in rows if name in row["estimates"]]
        if not ones:
            continue
        holds = np.array([row["low"] <= row["true"] <= (np.inf if row["high"] is None else row["high"]) for row in ones])
        clear = np.array([row["is_determined"] for row in ones])
        error = np.array([row["value"] / row["true"] - 1.0 for row in ones])
        content[name] = {
            "drives": len(ones),
            "determined": int(clear.sum()),
            "coverage": float(holds.mean()),
            "coverage_where_determined": float(holds[clear].mean()) if clear.any() else None,
            "band_where_determined": band(int(clear.sum())) if clear.any() else None,
            "profile": float(np.mean([row["is_profile"] for row in ones])),
            "median_relative_error": float(np.median(np.abs(error))),
        }
    return content


def band(drives: int) -> tuple[float, float]:
    """Return the range of 95 % of the shares if each interval contains the truth in 95 % of all drives."""
    low, high = stats.binom.interval(0.95, drives, 0.95)
    return float(low / drives), float(high / drives)


def recorded(config: Config) -> dict[str, Any]:
    """Return the results of a filter calibrated on one recorded drive on the other, with those of the uncalibrated one."""
    drives = {name: read(config.data / name) for name in RECORDED}
    rows = {}
    for name, other in (RECORDED, RECORDED[::-1]):
        measured = replay(drives[name], noise="documented", seed=1000, rate=math.inf).odometry
        calibration = calibrate(replace(drives[name], odometry=measured))
        unbiased = replace(calibration.noise, odometry=replace(calibration.noise.odometry, bias=(0.0, 0.0, 0.0)))
        seeds = range(config.seed, config.seed + config.seeds)
        results = {
            "matched, uncalibrated": judge(drives[other], None, seeds),
            "calibrated": judge(drives[other], calibration.noise, seeds),
            "calibrated, its bias not taken off": judge(drives[other], unbiased, seeds),
        }
        rows[f"{name} -> {other}"] = {
            "segment": calibration.segment,
            "segments": calibration.segments,
            "remarks": calibration.remarks,
            "noise": asdict(calibration.noise),
            "estimates": {key: asdict(result) for key, result in calibration.estimates.items()},
            "judged": {
                key: {part: float(np.mean(numbers)) for part, numbers in result._asdict().items()}
                for key, result in results.items()
            },
        }
    return rows


def covered(config: Config) -> dict[str, Any] | None:
    """Return the coverage over simulated drives, or None if time ran out; the next run resumes."""
    kept, began, rows = config.kept / f"{provenance()['commit']}.jsonl", time.monotonic(), []
    with ProcessPoolExecutor(1) as pool:
        fits = finished(calibrated, zip(range(config.seed, config.seed + config.drives)), kept, ("seed",), pool)
        for row in each(fits, "fits", config.drives):
            rows.append(row)
            if time.monotonic() - began > config.seconds and len(rows) < config.drives:
                print(f"{len(rows)} of {config.drives} fits are done; run again to go on.")
                return None
    seconds = {VIEW: float(np.mean([row["seconds"] for row in rows]))}
    return {"coverage": {VIEW: coverage(rows)}, "seconds_per_drive": seconds}


def main() -> None:
    """Calibrate, count, print, and write the results."""
    config = tyro.cli(Config, description=__doc__)
    if config.part == "coverage":
        result = covered(config)
        if result is None:
            return
        for view, names in result["coverage"].items():
            for name, row in names.items():
                print(view, name, row)
    else:
        result = {"recorded": recorded(config)}
        for name, row in result["recorded"].items():
            print(name, row["segment"], row["segments"], row["remarks"])
            for what, numbers in row["judged"].items():
                print("  ", what, numbers)
    if config.results is not None:
        write_json(config.results / RESULTS[config.part], result, config=settings_of(config))


if __name__ == "__main__":
    main()
