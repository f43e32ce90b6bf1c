"""Check the wheels that `turtlebot-gym calibrate` finds in recorded drives of a real robot, and the files that it writes.

Each log is resampled to several rates, and the wheels found are compared with total least squares over whole windows, without a
model of errors. Each file then drives the other log: the drift of dead reckoning beside raw odometry, and a filter's NEES.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from harness.study import Results, Study, each, run
from turtlebot_gym.drive import Drive
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym_lab.calibration import calibrate
from turtlebot_gym_lab.calibration.alphas import pieces_of
from turtlebot_gym_lab.calibration.windows import path_of
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.evaluation.calibration import judge
from turtlebot_gym_lab.evaluation.replay import replay

RATES = (5.0, 10.0, 25.0, 50.0)
"""Rows per second."""
LENGTHS = (2.0, 5.0)
"""Lengths of the pieces whose drift is measured, m."""
SECONDS = 4.0
"""Length of a whole window, s."""


@dataclass(frozen=True, kw_only=True)
class Recorded(Study):
    """Calibrate recorded drives at several rates, and drive the others with the files."""

    logs: tuple[Path, Path] = (Path("../shared/data/wifibot1.txt"), Path("../shared/data/wifibot2.txt"))
    """Two logs of a robot, with truth."""
    seeds: int = 20
    """Seeds of the measured poses of the filter."""


def resampled(drive: Drive, rate: float) -> Drive:
    """Return a log at another rate: its rows at least so far apart, with the mean twist since the row before."""
    rows = np.unique(np.searchsorted(drive.time, np.arange(drive.time[0], drive.time[-1], 1.0 / rate)))
    path, dt = path_of(drive), np.diff(drive.time[rows])
    twist = np.column_stack([np.diff(column[rows]) / dt for column in (path.way, path.turn)])
    return Drive(time=drive.time[rows], twist=np.concatenate([np.zeros((1, 2)), twist]), true_state=drive.true_state[rows])


def whole(drive: Drive, delay: float) -> NDArray[np.float64]:
    """Return the way and the turn of a drive by total least squares over whole windows, with the delay of its motion."""
    heading = np.unwrap(drive.truth[:, 2])
    ahead = np.diff(drive.truth[:, 0] + 1j * drive.truth[:, 1]) * np.exp(-0.5j * (heading[1:] + heading[:-1]))
    path, begin = path_of(drive), np.arange(drive.time[0] + 0.5, drive.time[-1] - 0.5 - SECONDS, 0.1)
    found = []
    for told, true in ((path.way, np.concatenate([[0.0], np.cumsum(ahead.real)])), (path.turn, heading)):
        pairs = [
            np.interp(begin + SECONDS - lag, drive.time, column) - np.interp(begin - lag, drive.time, column)
            for column, lag in ((told, delay), (true, 0.0))
        ]
        direction = np.linalg.svd(np.column_stack(pairs), full_matrices=False)[2][0]
        found.append(direction[1] / direction[0])
    return np.array(found)


def drift(drive: Drive, wheels: ProcessNoise, length: float) -> float:
    """Return the root mean square of dead reckoning's error after some way, m."""
    parameters = np.array([wheels.scale, wheels.turn_scale, wheels.veer, 0.0, 0.0, 0.0, 0.0, 0.0])
    off = pieces_of(path_of(drive), drive.truth, parameters, 0.5, length, overlap=4, by_way=True).off
    return math.sqrt(float((off[:, :2] ** 2).sum(axis=1).mean()))


def measure(options: Recorded) -> tuple[Results, list[Table]]:
    """Calibrate both logs, and judge the files on the other one."""
    drives = {path.name: read(path) for path in options.logs}
    wheels, filters = [], {}
    for name, drive in drives.items():
        (other,) = (each_drive for each_name, each_drive in drives.items() if each_name != name)
        for rate in each(RATES, name):
            wheels.append({"log": name, "rate": rate} | _wheels(resampled(drive, rate), drive, other))
        measured = replay(drive, noise="documented", seed=1000, rate=np.inf).odometry
        fitted = calibrate(replace(drive, odometry=measured)).noise
        unbiased = replace(fitted, odometry=replace(fitted.odometry, bias=(0.0, 0.0, 0.0)))
        arms = {"matched, uncalibrated": None, "calibrated": fitted, "calibrated, its bias not taken off": unbiased}
        (onto,) = (each_name for each_name in drives if each_name != name)
        filters[f"{name} -> {onto}"] = {"judged": {arm: _judged(other, noise, options.seeds) for arm, noise in arms.items()}}
    table = Table("log", "rows/s", "way", "95 %", "true", "turn", "true", "2 m raw, m", "file", "5 m raw, m", "file")
    for row in wheels:
        way = f"{row['low']:.4f} to {row['high']:.4f}"
        found = [f"{row[key]:.4f}" for key in ("way", "true_way", "turn", "true_turn")]
        pieces = [f"{piece[key]:.3f}" for piece in row["pieces"] for key in ("raw", "file")]
        table.add_row(row["log"], f"{row['rate']:g}", found[0], way, *found[1:], *pieces)
    return {"wheels": wheels, "recorded": filters}, [table]


def _wheels(drive: Drive, source: Drive, other: Drive) -> dict[str, Any]:
    fitted = calibrate(drive)
    true, process = whole(source, fitted.delay.value), fitted.noise.process
    scale, turn = fitted.estimates["scale"], fitted.estimates["turn_scale"]
    return {
        "way": scale.value,
        "low": scale.low,
        "high": scale.high,
        "true_way": float(true[0]),
        "turn": scale.value * turn.value,
        "turn_scale": [turn.low, turn.high],
        "true_turn": float(true[1]),
        "delay": fitted.delay.value,
        "is_good": fitted.verdict.is_good,
        "pieces": [
            {"length": length, "raw": drift(other, ProcessNoise(), length), "file": drift(other, process, length)}
            for length in LENGTHS
        ],
        "held": [held._asdict() for held in fitted.verdict.held],
    }


def _judged(drive: Drive, noise: Any, seeds: int) -> dict[str, float]:
    judged = judge(drive, noise, range(seeds))
    return {name: float(getattr(judged, name).mean()) for name in ("nees", "position", "heading")}


if __name__ == "__main__":
    run(Recorded, measure, beside=__file__)
