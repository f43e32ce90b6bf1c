"""Check the intervals of `turtlebot-gym calibrate` against a simulator that shares no code with the package.

The simulator is plain NumPy: two wheels with their own radii and a track, noise on the twist, marker and clock of the truth. It
drives with {Euler, midpoint} x {measured poses, wheel odometry} x {exact truth, truth with noise of 1 mm and 1 mrad}, at 5 to
100 rows a second in turn. It counts how often the 95 % intervals contain the known values.
"""

from __future__ import annotations

import itertools
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core; threads within would wait for each other

import numpy as np
import tyro
from numpy.typing import NDArray

from harness.study import each, finished, publish
from turtlebot_gym.drive import Drive
from turtlebot_gym_lab.calibration import calibrate

SETTINGS = tuple(itertools.product(("euler", "midpoint"), ("pose", "wheel"), ("exact", "noisy")))
"""Integrator, kind of odometry, and truth."""
LENGTHS = {5: 240.0, 10: 120.0, 20: 60.0, 50: 40.0, 100: 30.0}
"""Length of a drive by its rate, s: 1200 rows or more."""
TRUTH = np.array((1e-3, 1e-3, 1e-3))  # standard deviations of a noisy truth; m, m, rad
CERTAIN = 2e-5
"""Error below which a parameter is certain, m or rad: that of a marker in an exact truth, which has no noise to the side."""
RADIUS, TRACK = 0.033, 0.16  # assumed, of the wheels, m


def drawn(random: np.random.Generator, kind: str) -> dict[str, float]:
    """Return the true parameters of a drive."""
    alphas = np.exp(random.uniform(np.log(0.002), np.log(0.012), 4))
    values = {f"alpha{k}": float(alpha) for k, alpha in enumerate(alphas, start=1)}
    values |= {"left": RADIUS * random.uniform(0.95, 1.05), "right": RADIUS * random.uniform(0.95, 1.05)}
    values |= {"track": TRACK * random.uniform(0.8, 1.7), "drift": random.choice((0.0, random.uniform(-0.02, 0.02)))}
    if kind == "wheel":
        values |= {"marker_x": random.uniform(-0.06, 0.06), "marker_y": random.uniform(-0.04, 0.04)}
        values |= {"marker_theta": random.uniform(-0.1, 0.1)}
    else:
        values |= {name: random.uniform(0.02, 0.08) ** 2 for name in ("R_x", "R_y", "R_theta")}
        values |= {name: random.uniform(-0.05, 0.05) for name in ("bias_x", "bias_y", "bias_theta")}
        values |= {"spike_probability": random.uniform(0.01, 0.04), "dropout_probability": random.uniform(0.0, 0.1)}
        values |= {"spike": float(np.sqrt(values["R_theta"]) * random.uniform(4.0, 6.0))}
    return {name: float(value) for name, value in values.items()}


def true_values(p: dict[str, float]) -> dict[str, float]:
    """Return what a calibration should find."""
    share, off = (p["left"] + p["right"]) / (2.0 * RADIUS), (p["right"] - p["left"]) / RADIUS
    values = {name: value for name, value in p.items() if name not in ("left", "right", "track")}
    values |= {"scale": share, "turn_scale": TRACK / p["track"], "veer": off / p["track"] / share}
    return {"marker_x": 0.0, "marker_y": 0.0, "marker_theta": 0.0} | values


def twists(random: np.random.Generator, rows: int, dt: float) -> NDArray[np.float64]:
    """Return the reported twists: straight ahead, on the spot and in arcs, 1.5 s each; shape (rows, 2)."""
    twist, hold = np.zeros((rows, 2)), round(1.5 / dt)
    for first in range(1, rows, hold):
        straight = (random.uniform(0.12, 0.22), 0.0)
        spin = (0.0, random.uniform(0.3, 1.0) * random.choice((-1.0, 1.0)))
        arc = (random.uniform(0.06, 0.18), random.uniform(-0.6, 0.6))
        twist[first : first + hold] = (straight, spin, arc)[random.integers(3)]
    return twist


def simulated(
    seed: int, integrator: str, kind: str, truth: str, *, rate: float | None = None, tails: int = 0, **given: float
) -> tuple[Drive, dict[str, float]]:
    """Return a drive in one of `SETTINGS`, at a rate, rows per second, and what a calibration of it should find.

    Some parameters may be given; ``tails`` are the degrees of freedom of Student's noise of the execution, 0 for normal noise.
    """
    random = np.random.default_rng([seed, SETTINGS.index((integrator, kind, truth))])
    rate = tuple(LENGTHS)[seed % len(LENGTHS)] if rate is None else rate
    dt, p = 1.0 / rate, drawn(random, kind) | given
    rows = round(LENGTHS.get(int(rate), 90.0) * rate)
    twist = twists(random, rows, dt)
    v, omega = twist.T
    normal = random.standard_normal((2, rows))
    if tails:
        normal = random.standard_t(tails, (2, rows)) * np.sqrt((tails - 2.0) / tails)
    deviations = [np.sqrt((p[f"alpha{k}"] * v**2 + p[f"alpha{k + 1}"] * omega**2) * 0.1 / dt) for k in (1, 3)]
    values = true_values(p)
    # The point of the axle that does not advance when the robot turns; between unequal wheels it is not the middle.
    right, left = p["right"] / RADIUS * (v + 0.5 * TRACK * omega), p["left"] / RADIUS * (v - 0.5 * TRACK * omega)
    done_v = values["scale"] * (v + deviations[0] * normal[0])
    done_omega = (right - left) / p["track"] - p["drift"]
    done_omega += values["scale"] * values["turn_scale"] * deviations[1] * normal[1]
    done_v[0] = done_omega[0] = 0.0
    robot = _integrated(done_v, done_omega, dt, integrator)
    marker = robot.copy()
    if kind == "wheel":
        cosine, sine = np.cos(robot[:, 2]), np.sin(robot[:, 2])
        marker[:, 0] += p["marker_x"] * cosine - p["marker_y"] * sine
        marker[:, 1] += p["marker_x"] * sine + p["marker_y"] * cosine
        marker[:, 2] += p["marker_theta"]
        odometry = _integrated(v, omega, dt, integrator)
    else:
        sizes = np.sqrt([p["R_x"], p["R_y"], p["R_theta"]])
        odometry = robot + [p["bias_x"], p["bias_y"], p["bias_theta"]] + sizes * random.standard_normal((rows, 3))
        spikes = p["spike"] * random.choice((-1.0, 1.0), rows)
        odometry[:, 2] += np.where(random.random(rows) < p["spike_probability"], spikes, 0.0)
        lost = random.random(rows) < p["dropout_probability"]
        lost[[0, -1]] = False
        odometry[lost] = np.nan
    if truth == "noisy":
        marker += TRUTH * random.standard_normal((rows, 3))
    for poses in (odometry, marker):
        poses[:, 2] = np.remainder(poses[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return Drive(time=np.asarray(dt * np.arange(rows), np.float64), twist=twist, odometry=odometry, true_state=marker), values


def _integrated(v: NDArray[np.float64], omega: NDArray[np.float64], dt: float, integrator: str) -> NDArray[np.float64]:
    theta = np.cumsum(omega * dt)
    middle = np.concatenate([[0.0], theta[:-1]]) + (0.5 if integrator == "midpoint" else 0.0) * omega * dt
    return np.column_stack([np.cumsum(v * np.cos(middle) * dt), np.cumsum(v * np.sin(middle) * dt), theta])


def judged(seed: int, setting: str) -> dict[str, Any]:
    """Return for each parameter of a drive its error, and whether the interval contains the truth."""
    drive, values = simulated(seed, *setting.split("-"))
    rows = {}
    for name, estimate in calibrate(drive).estimates.items():
        true = values[name]
        rows[name] = {"error": estimate.value - true, "holds": estimate.low <= true <= estimate.high}
    return {"seed": seed, "setting": setting, "estimates": rows}


def summary(drives: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the coverage of each parameter that is not certain, and of all together."""
    held: dict[str, list[bool]] = {}
    for name in dict.fromkeys(name for drive in drives for name in drive["estimates"]):
        estimates = [drive["estimates"][name] for drive in drives if name in drive["estimates"]]
        if max(abs(estimate["error"]) for estimate in estimates) >= CERTAIN:
            held[name] = [estimate["holds"] for estimate in estimates]
    together = sum(map(sum, held.values())) / sum(map(len, held.values()))
    return {"drives": len(drives), "all": together, "parameters": {name: sum(each) / len(each) for name, each in held.items()}}


def main(
    *,
    drives: int = 200,
    seed: int = 0,
    processes: int = 2,
    only: str = "",
    kept: Path = Path("out/calibration_intervals.jsonl"),
    json: Path = Path("benchmarks/calibration_intervals.json"),
) -> None:
    """Judge some drives for each setting, or for those that contain a text, such as euler-pose-exact; print and write."""
    options = {**locals()}
    chosen = ["-".join(setting) for setting in SETTINGS if only in "-".join(setting)]
    units = [(number, name) for number in range(seed, seed + drives) for name in chosen]
    pool = ProcessPoolExecutor(processes)
    done = list(each(finished(judged, units, kept, "seed setting", pool), "drives", len(units)))
    result = {name: summary([drive for drive in done if drive["setting"] == name]) for name in chosen}
    publish(json, {"coverage": result}, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
