"""Filters in the study of transfer: their tunings, their results on the same drives, and the drift of wheel odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import FilterTuning, make_filter, make_noise
from turtlebot_gym.estimation.consistency import difference, nees
from turtlebot_gym.estimation.filters import filter_of, matrix
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.values import Pose, Senses
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.metrics import Interval

BY_NAME = ("matched", "gated", "mixture", "slip", "scale")
"""Filters by name, matched to the true noise."""
CREEP = 0.3
"""Relative standard deviation of the executed twist in the noise model of filters informed of a slippery floor. Chosen: more
than the mean loss of a tenth, since losses are correlated from step to step."""
SLIPS = ProcessNoise(slip=0.1, slip_start=0.02, slip_end=0.02)
"""Slip model of the filter `slip`: a tenth is lost, half of the time, for 5 s at once."""


class Drive(NamedTuple):
    """A drive of T steps with its odometry."""

    truth: NDArray[np.float64]
    """Shape (T + 1, 5)."""
    senses: list[Senses]
    """Odometry at each time, T + 1 entries."""


def tunings(noise: str) -> dict[str, FilterTuning]:
    """Return the filters by name, including some with more information than the preset."""
    model = make_noise(noise)
    creeping = replace(model, process=replace(model.process, alpha1=CREEP**2, alpha4=CREEP**2))
    return {
        **{name: make_filter(name, model) for name in BY_NAME},
        "matched, told of creep": make_filter("matched", creeping),
        "scale, told of creep": make_filter("scale", creeping),
        "slip, told of slip": make_filter("slip", replace(model, process=SLIPS)),
    }


def filtered(drives: Sequence[Drive], tuning: FilterTuning, dt: float = 0.1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Run a filter over drives; return errors of the pose, shape (n, T + 1, 3), and its NEES, shape (n, T + 1)."""
    begin, step, *_ = filter_of(tuning)
    errors, consistency = [], []
    for truth, senses in drives:
        estimate = begin(senses[0], tuning)
        beliefs = [estimate.belief]
        for before, now in pairwise(senses):
            estimate = step(estimate, before, now, tuning, dt, INTEGRATORS["euler"])
            beliefs.append(estimate.belief)
        means = np.array([belief.mean for belief in beliefs])
        covariances = np.array([matrix(belief.covariance) for belief in beliefs])
        errors.append(difference(means, truth)[:, :3])
        consistency.append(nees(means, truth, covariances, components=3))
    return np.array(errors), np.array(consistency)


def compared(drives: Sequence[Drive], noise: str) -> list[dict[str, Any]]:
    """Return the results of each filter on the same drives."""
    rows: list[dict[str, Any]] = []
    reference = np.zeros(len(drives))
    for name, tuning in tunings(noise).items():
        errors, consistency = filtered(drives, tuning)
        position, heading = (errors[..., :2] ** 2).sum(axis=2).mean(axis=1), (errors[..., 2] ** 2).mean(axis=1)
        reference = position if name == "matched" else reference
        row = {"filter": name, "position": root(position), "heading": root(heading)}
        rows.append({**row, "over_matched": ratio(position, reference), "nees": metrics.mean(consistency.mean(axis=1))})
    return rows


def root(squared: NDArray[np.float64]) -> Interval:
    """Return the root of a mean square."""
    return Interval(*(float(np.sqrt(max(number, 0.0))) for number in metrics.mean(squared)))


def ratio(one: NDArray[np.float64], other: NDArray[np.float64], samples: int = 2000) -> Interval:
    """Return the ratio of two root mean squares over the same drives, with a bootstrap interval over drives."""
    rows = np.random.default_rng(0).integers(len(one), size=(samples, len(one)))
    low, high = np.quantile(np.sqrt(one[rows].mean(axis=1) / other[rows].mean(axis=1)), [0.025, 0.975])
    return Interval(float(np.sqrt(one.mean() / other.mean())), float(low), float(high))


def drift(floor: str, drives: Sequence[Drive]) -> dict[str, Any]:
    """Return the error of odometry after each metre, relative to the start of that metre; m, rad."""
    errors = []
    for truth, senses in drives:
        way = np.concatenate([[0.0], np.hypot(*np.diff(truth[:, :2], axis=0).T).cumsum()])
        ends = np.searchsorted(way, np.arange(0.0, way[-1], 1.0))
        for begin, end in pairwise(ends.tolist()):
            start, before, after = Pose(*truth[begin, :3].tolist()), senses[begin].odometry.pose, senses[end].odometry.pose
            moved = increment(start, before, after, sincos(start.theta - before.theta))
            off = difference(np.array(moved), truth[end, :3])
            errors.append((math.hypot(off[0], off[1]), abs(off[2])))
    position, heading = np.array(errors).T
    return {"floor": floor, "metres": len(errors), "position": root(position**2), "heading": root(heading**2)}
