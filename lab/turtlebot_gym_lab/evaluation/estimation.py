"""Accuracy of filters against the best possible, and their consistency, from many short drives on the compiled loop.

All filters see the same drives: commands that do not depend on the estimate, and the same noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import FilterTuning, Noise, make_filter, make_noise
from turtlebot_gym.config import as_int
from turtlebot_gym.estimation.consistency import difference, mean_bounds, nees
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_lab.evaluation.bound import cramer_rao_bound, true_tuning

SQUARE = "turtlebot_gym/TurtleBotSquare-v0"
"""Environment of the drives; switched by time, it never terminates."""
STEPS, DT = 30, 0.1
"""Number of steps of a drive, and the control interval, s."""
BATCH = 1000
"""Number of drives held in memory at once."""
HOLD = 10
"""Steps for which a command is held."""
FORWARD, TURN = (0.3, 1.0), (-0.35, 0.35)
"""Ranges of the random actions, shares of the robot's limits."""


class _Drives(NamedTuple):
    """Record of n drives of T steps with one filter."""

    truth: NDArray[np.float64]
    """Shape (n, T + 1, 5)."""
    estimate: NDArray[np.float64]
    """Shape (n, T + 1, 5)."""
    covariance: NDArray[np.float64]
    """Shape (n, T + 1, 3, 3)."""
    command: NDArray[np.float64]
    """Command executed up to each time, without its noise, shape (n, T + 1, 2)."""
    measured: NDArray[np.bool_]
    """Shape (n, T + 1)."""


class FilterResult(NamedTuple):
    """Results of a filter at the end of the drives."""

    ratio: tuple[Interval, ...]
    """Ratio of RMSE to bound, for x, y and heading; infinite where the bound is 0."""
    nees: Interval
    """Mean NEES of the pose: 3 for a consistent filter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimation:
    """Filters and the bound, on the same drives."""

    bound: NDArray[np.float64] = field(repr=False)
    """Least RMSE of x, y and heading that any filter can have, shape (T + 1, 3); m, m, rad."""
    filters: dict[str, FilterResult]
    band: tuple[float, float]
    """Interval that contains the mean NEES of a consistent filter in 19 of 20 cases."""


def estimate(
    filters: Sequence[str] | Mapping[str, FilterTuning],
    *,
    noise: str | Noise = "tutorial",
    runs: int = 2000,
    seed: int = 0,
    bias: bool = True,
    slip: bool = True,
) -> Estimation:
    """Drive, and compare each filter's error with the posterior Cramer-Rao bound and with the filter's stated uncertainty.

    The bound assumes that a constant bias and the times of slip are known, which no filter knows.

    Args:
        filters: Names in `turtlebot_gym.presets.FILTERS`, or tunings by custom names.
        noise: True noise.
        runs: Number of drives; drive i has the seed ``seed + i``.
        seed: The first seed.
        bias: Whether odometry has the bias of the noise model.
        slip: Whether the wheels slip as in the noise model.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    as_int("runs", runs, 1)
    as_int("seed", seed, 0, MAX_SEED + 1 - runs)
    model = in_force(noise, bias=bias, slip=slip)
    tunings = dict(filters) if isinstance(filters, Mapping) else {name: make_filter(name, model) for name in filters}
    squares: dict[str, list[NDArray[np.float64]]] = {name: [] for name in tunings}
    all_nees: dict[str, list[NDArray[np.float64]]] = {name: [] for name in tunings}
    bounds: list[NDArray[np.float64]] = []
    for first in range(0, runs, BATCH):
        count = min(BATCH, runs - first)
        for name, tuning in tunings.items():
            drives = drive(count, STEPS, seed + first, filter=tuning, noise=model, dt=DT)
            if name == next(iter(tunings)):
                bound = cramer_rao_bound(
                    drives.truth, drives.command[:, 1:], true_tuning(model), measured=drives.measured[:, 1:], dt=DT
                )
                bounds.append(count * np.diagonal(bound, axis1=1, axis2=2)[:, :3])
            truth, last, covariance = drives.truth[:, -1], drives.estimate[:, -1], drives.covariance[:, -1]
            squares[name].append(difference(last[:, :3], truth[:, :3]) ** 2)
            all_nees[name].append(nees(last, truth, covariance))
    bound = np.sqrt(np.sum(bounds, axis=0) / runs)
    results = {}
    for name in tunings:
        squared = np.concatenate(squares[name])
        ratio = tuple(_over(metrics.mean(squared[:, k]), float(bound[-1, k])) for k in range(3))
        results[name] = FilterResult(ratio, metrics.mean(np.concatenate(all_nees[name])))
    return Estimation(bound=bound, filters=results, band=mean_bounds(3, runs, false_alarm=0.05))


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
    names = ("true_state", "estimate", "covariance", "command", "measured")
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


def _over(squared: Interval, bound: float) -> Interval:
    """Return the root of a mean square as a multiple of a bound."""
    if not bound > 0.0:
        return Interval(math.inf, math.inf, math.inf)
    return Interval(*(math.sqrt(max(number, 0.0)) / bound for number in squared))
