"""Drive a square on robots that are not as assumed: policies trained on the calibrated noise file, and on the truth.

Each robot is driven for two minutes by the simulator of `calibration_intervals.py`, which shares no code with the package. The
commands ``calibrate`` and ``train`` make a noise file of that drive and policies of the file. These drive the true robot with
the file's filter, beside policies trained on the true parameters with the true filter. `make bench-calibration-policy` runs it.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration_intervals import RADIUS, TRACK, simulated
from harness.study import Study, run
from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, write_parameters
from turtlebot_gym.drives import Drive
from turtlebot_gym.files import read_parameters
from turtlebot_gym.presets import make_filter
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval

SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
USUAL = {"left": RADIUS, "right": RADIUS, "drift": 0.0, "spike_probability": 0.02, "spike": 0.3, "dropout_probability": 0.03}
USUAL |= {"alpha1": 0.004, "alpha2": 0.003, "alpha3": 0.006, "alpha4": 0.005}
USUAL |= {"R_x": 0.03**2, "R_y": 0.03**2, "R_theta": 0.06**2, "bias_x": 0.0, "bias_y": 0.0, "bias_theta": 0.0}
ROBOTS = {"track 10 % too wide": 1.1 * TRACK, "turn scale 0.62": TRACK / 0.62}
"""Tracks, m."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Train on the calibrated file and on the truth, and drive the true robot."""

    seeds: int = 3
    """Number of trainings on each side, in pairs with the same seed."""
    first: int = 0
    """Seed of the first pair."""
    episodes: int = 500
    """Episodes of each policy, with the same seeds."""
    steps: int = 3_000_000
    """Steps of each training."""
    kept: Path = Path("out/calibration_policy")
    """Folder for logs, files and policies; finished trainings are kept."""


def command(*arguments: object) -> None:
    """Run a command of turtlebot-gym."""
    subprocess.run([sys.executable, "-m", "turtlebot_gym_agents", *map(str, arguments)], check=True)


def true_noise(values: dict[str, float]) -> Noise:
    """Return the noise model of a simulated drive."""
    names = ("alpha1", "alpha2", "alpha3", "alpha4", "scale", "turn_scale", "veer")
    odometry: dict[str, Any] = {name: values[name] for name in ("spike_probability", "spike", "dropout_probability")}
    odometry |= {name: tuple(values[f"{name}_{axis}"] for axis in ("x", "y", "theta")) for name in ("R", "bias")}
    return Noise(process=ProcessNoise(**{name: values[name] for name in names}), odometry=OdometryNoise(**odometry))


def write_log(drive: Drive, path: Path) -> None:
    """Write a drive as a table."""
    names = "t,v,omega,x,y,theta,true_x,true_y,true_theta"
    table = np.column_stack([drive.time, drive.twist, drive.odometry, drive.truth])
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.9f")


def judged(track: float, folder: Path, config: Config) -> dict[str, Any]:
    """Return what is found of a robot, and the times of its square after either training."""
    folder.mkdir(parents=True, exist_ok=True)
    given: dict[str, Any] = USUAL | {"track": track}
    drive, values = simulated(0, "euler", "pose", "noisy", rate=10, **given)
    files = {"truth": folder / "truth.yaml", "calibrated": folder / "calibrated.yaml"}
    write_parameters(true_noise(values), files["truth"])
    write_log(drive, folder / "log.csv")
    files["calibrated"].unlink(missing_ok=True)
    command("calibrate", folder / "log.csv", "--out", files["calibrated"])
    turn_scale = read_parameters(Noise, files["calibrated"]).process.turn_scale
    times = {}
    for side, file in files.items():
        times[side], own = [], make_filter("calibrated", read_parameters(Noise, file))
        for seed in range(config.first, config.first + config.seeds):
            run = folder / f"{side}-{seed}"
            if not (run / "policy.onnx").is_file():
                training = ("--noise", file, "--filter", "calibrated", "--steps", config.steps, "--seed", seed)
                command("train", "--env", SQUARE, *training, "--out", run, "--force")
            driven = evaluate(
                str(run / "policy.onnx"), env=SQUARE, episodes=config.episodes, noise=str(files["truth"]), filter=own
            )
            summary = driven.summary()
            times[side].append({"time": float(driven.times().mean()), "success": summary["success"].value})
    means = {side: float(np.mean([row["time"] for row in rows])) for side, rows in times.items()}
    return {
        "turn_scale": values["turn_scale"],
        "found": turn_scale,
        "error": turn_scale / values["turn_scale"] - 1.0,
        "times": times,
        "mean": means,
        "ratio": means["calibrated"] / means["truth"],
    }


def lost(robots: Mapping[str, Any]) -> Interval:
    """Return the share of its time that a policy trained on a file loses, over the pairs of all robots."""
    sides = ([drive["time"] for row in robots.values() for drive in row["times"][side]] for side in ("calibrated", "truth"))
    on_file, on_truth = map(np.array, sides)
    return metrics.mean(on_file / on_truth - 1.0)


def measure(config: Config) -> tuple[dict[str, Any], list[Any]]:
    """Return the results of both robots, and print them."""
    robots = {}
    for name, track in ROBOTS.items():
        row = robots[name] = judged(track, config.kept / name.replace(" ", "_").replace("%", "percent"), config)
        print(f"{name}: found {row['found']:.4f} for {row['turn_scale']:.4f}; times {row['mean']}, ratio {row['ratio']:.4f}")
    print("All pairs: {:+.2%} [{:+.2%}, {:+.2%}]".format(*lost(robots)))
    return {"robots": robots, "lost": lost(robots)}, []


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
