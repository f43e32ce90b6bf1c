"""Accuracy of filters against the best possible, and their consistency, from many short drives on the compiled loop.

All filters see the same drives: commands that do not depend on the estimate, and the same noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import FilterTuning, Noise, make_filter, make_noise, make_robot
from turtlebot_gym.config import POSITIVE, as_int, choose
from turtlebot_gym.estimation.consistency import difference, mean_bounds, nees
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.models.unicycle import INTEGRATORS, motion
from turtlebot_gym.systems.parameters import DT
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.consistency import pose_nees
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_lab.evaluation.bound import cramer_rao_bound, true_tuning

SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
"""Environment of the drives; switched by time, it never terminates."""
BATCH = 1000
"""Number of drives held in memory at once."""
HOLD = 10
"""Steps for which a command is held."""
FORWARD, TURN = (0.3, 1.0), (-0.35, 0.35)
"""Ranges of the random actions, shares of the robot's limits."""
WHITE = 1000
"""Most drives whose innovations are examined."""


class _Drives(NamedTuple):
    """Record of n drives of T steps with one filter."""

    truth: NDArray[np.float64]
    """Shape (n, T + 1, 5)."""
    estimate: NDArray[np.float64]
    """Shape (n, T + 1, 5)."""
    covariance: NDArray[np.float64]
    """Shape (n, T + 1, 5, 5)."""
    odometry: NDArray[np.float64]
    """Shape (n, T + 1, 3)."""
    command: NDArray[np.float64]
    """Command executed up to each time, without its noise, shape (n, T + 1, 2)."""
    measured: NDArray[np.bool_]
    """Shape (n, T + 1)."""
    nis: NDArray[np.float64]
    """Shape (n, T + 1)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _FilterResult:
    """Results of a filter, with T + 1 times."""

    rmse: NDArray[np.float64] = field(repr=False)
    """RMSE of x, y and heading, shape (T + 1, 3); m, m, rad."""
    ratio: tuple[Interval, Interval, Interval]
    """Ratio of RMSE to bound at the end, for x, y and heading; infinite where the bound is 0."""
    nees: Interval
    """Mean NEES of the pose at the end: 3 for a consistent filter."""
    nis: Interval
    """Mean NIS of the last measurement: 3 for a consistent filter without spikes."""
    outside: float
    """Share of the time beyond three standard deviations: 0.8 % for a consistent filter."""
    correlation: tuple[float, float, float]
    """Correlation of successive innovations: 0 for an optimal filter."""
    nees_by_time: NDArray[np.float64] = field(repr=False)
    """Mean NEES of the pose, shape (T + 1,); NaN where the filter states that it has none."""
    nis_by_time: NDArray[np.float64] = field(repr=False)
    """Mean NIS, shape (T + 1,); NaN at the start, and where nothing was measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimation:
    """Filters and the bound, on the same drives."""

    config: dict[str, Any]
    time: NDArray[np.float64] = field(repr=False)
    """Shape (T + 1,), s."""
    bound: NDArray[np.float64] = field(repr=False)
    """Least RMSE of x, y and heading that any filter can have, shape (T + 1, 3); m, m, rad."""
    filters: dict[str, _FilterResult]
    band: tuple[float, float]
    """Interval that contains the mean NEES of a consistent filter in 19 of 20 cases."""


def estimate(
    filters: Sequence[str] | Mapping[str, FilterTuning],
    *,
    noise: str | Noise = "tutorial",
    runs: int = 2000,
    seconds: float = 3.0,
    seed: int = 0,
    robot: str = "burger",
    dt: float = 0.1,
    integrator: str = "euler",
    bias: bool = True,
    slip: bool = True,
    progress: Callable[[int], None] = lambda done: None,
) -> Estimation:
    """Drive, and compare each filter's error with the posterior Cramer-Rao bound and with the filter's stated uncertainty.

    The bound assumes that a constant bias and the times of slip are known, which no filter knows.

    Args:
        filters: Names in `turtlebot_gym.presets.FILTERS`, or tunings by custom names.
        noise: True noise.
        runs: Number of drives; drive i has the seed ``seed + i``.
        seconds: Length of a drive.
        seed: The first seed.
        robot: Name of the robot.
        dt: Control interval, s.
        integrator: "euler" or "midpoint".
        bias: Whether odometry has the bias of the noise model.
        slip: Whether the wheels slip as in the noise model.
        progress: Called with the number of drives that have ended so far.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    as_int("runs", runs, 1)
    as_int("seed", seed, 0, MAX_SEED + 1 - runs)
    POSITIVE.check("seconds", seconds)
    DT.check("dt", dt)
    model, steps = in_force(noise, bias=bias, slip=slip), max(1, round(seconds / dt))
    tunings = dict(filters) if isinstance(filters, Mapping) else {name: make_filter(name, model) for name in filters}
    truly, rule = true_tuning(model), choose("integrator", integrator, INTEGRATORS)
    options = {"robot": make_robot(robot), "noise": model, "dt": dt, "integrator": integrator}
    measures: dict[str, list[tuple[NDArray[np.float64], ...]]] = {name: [] for name in tunings}
    bounds, done = [], 0
    for first in range(0, runs, BATCH):
        count = min(BATCH, runs - first)
        for name, tuning in tunings.items():
            drives = drive(count, steps, seed + first, filter=tuning, **options)
            if name == next(iter(tunings)):
                bound = cramer_rao_bound(
                    drives.truth, drives.command[:, 1:], truly, measured=drives.measured[:, 1:], dt=dt, integrator=integrator
                )
                bounds.append(count * np.diagonal(bound, axis1=1, axis2=2)[:, :3])
            error = difference(drives.estimate[..., :3], drives.truth[..., :3])
            deviations = np.sqrt(np.diagonal(drives.covariance, axis1=2, axis2=3)[..., :3])
            outside = (np.abs(error) > 3.0 * deviations).any(axis=2).mean(axis=1)
            all_nees = pose_nees(drives.estimate, drives.truth, drives.covariance)
            last = nees(drives.estimate[:, -1], drives.truth[:, -1], drives.covariance[:, -1], components=3)
            all_nis = np.where(drives.measured & (np.arange(steps + 1) > 0), drives.nis, np.nan)
            white = innovations(drives, dt, rule) if first < WHITE else np.zeros((0, steps, 3))
            measures[name].append((error, last, drives.nis[:, -1], outside, white, all_nees, all_nis))
            done += count
            progress(done // len(tunings))
    bound = np.sqrt(np.sum(bounds, axis=0) / runs)
    results = {}
    for name in tunings:
        error, last, nis, outside, white, all_nees, all_nis = (
            np.concatenate(parts) for parts in zip(*measures[name], strict=True)
        )
        squared = error**2
        results[name] = _FilterResult(
            rmse=np.sqrt(squared.mean(axis=0)),
            ratio=tuple(_over(metrics.mean(squared[:, -1, k]), bound[-1, k]) for k in range(3)),  # type: ignore[arg-type]
            nees=metrics.mean(last),
            nis=metrics.mean(nis),
            outside=float(outside.mean()),
            correlation=tuple(_correlation(white[..., k]) for k in range(3)),  # type: ignore[arg-type]
            nees_by_time=_mean_of_known(all_nees),
            nis_by_time=_mean_of_known(all_nis),
        )
    config = {
        "filters": list(tunings),
        "noise": noise,
        "runs": runs,
        "seconds": steps * dt,
        "seed": seed,
        "robot": robot,
        "dt": dt,
        "integrator": integrator,
        "bias": bias,
        "slip": slip,
    }
    band = mean_bounds(3, runs, false_alarm=0.05)
    return Estimation(config=config, time=np.linspace(0.0, steps * dt, steps + 1), bound=bound, filters=results, band=band)


def in_force(noise: str | Noise, *, bias: bool = True, slip: bool = True) -> Noise:
    """Return a noise model with or without its bias and its slip."""
    model = make_noise(noise)
    odometry = model.odometry if bias else replace(model.odometry, bias=(0.0, 0.0, 0.0))
    return Noise(process=model.process if slip else replace(model.process, slip=0.0), odometry=odometry)


def drive(count: int, steps: int, seed: int, **options: Any) -> _Drives:
    """Drive with random commands, each held for a second, and record.

    Args:
        count: Number of drives.
        steps: Number of steps of each.
        seed: Seed of the first drive.
        **options: Arguments of the environment.
    """
    random = np.random.default_rng(seed)
    envs = gym.make_vec(SQUARE, num_envs=count, info="full", switch="time", max_episode_steps=steps + 1, **options)
    process = options["noise"].process
    names = ("true_state", "estimate", "covariance", "odometry", "command", "measured", "nis")
    record: dict[str, list[NDArray[Any]]] = {name: [] for name in names}

    def note(info: dict[str, Any]) -> None:
        share = process.scale * np.where(info["slipping"], 1.0 - process.slip, 1.0)
        executed = info["command"] @ np.array([[1.0, process.veer], [0.0, process.turn_scale]]) * share[:, None]
        for name in names:
            record[name].append(executed if name == "command" else info[name])

    note(envs.reset(seed=seed)[1])
    for first in range(0, steps, HOLD):
        actions = np.stack([random.uniform(*FORWARD, count), random.uniform(*TURN, count)], axis=1).astype(np.float32)
        for _ in range(min(HOLD, steps - first)):
            note(envs.step(actions)[4])
    envs.close()
    return _Drives(*(np.stack(record[name], axis=1) for name in names))


def innovations(drives: _Drives, dt: float, rule: float) -> NDArray[np.float64]:
    """Return measured minus predicted poses, (n, T, 3); m, m, rad; NaN without a measurement."""
    before = drives.estimate[:, :-1]
    twists = before[..., 2:].reshape(-1, 3).tolist()
    moved = np.array([motion(theta, v, omega, dt, rule)[:3] for theta, v, omega in twists])
    innovation = difference(drives.odometry[:, 1:], before[..., :3] + moved.reshape(*before.shape[:2], 3))
    innovation[~drives.measured[:, 1:]] = np.nan
    return innovation


def _mean_of_known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean over drives (n, T) of what is known; NaN where nothing is."""
    count = np.isfinite(values).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)


def _over(squared: Interval, bound: float) -> Interval:
    """Return the root of a mean square as a multiple of a bound."""
    if not bound > 0.0:
        return Interval(math.inf, math.inf, math.inf)
    return Interval(*(math.sqrt(max(number, 0.0)) / bound for number in squared))


def _correlation(series: NDArray[np.float64]) -> float:
    """Return the correlation of successive numbers over drives (n, T)."""
    products = series[:, 1:] * series[:, :-1]
    products, squares = (part[np.isfinite(part)] for part in (products, series**2))
    return float(products.mean() / squares.mean()) if products.size and squares.any() else 0.0
