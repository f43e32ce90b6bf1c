"""Measurements that are exact, or almost: rounding does not make the filter diverge."""

from __future__ import annotations

import math

import numpy as np
import pytest

from turtlebot_gym.estimation import ekf, update
from turtlebot_gym.estimation.update import Projection, innovation_variance
from turtlebot_gym.models.unicycle import INTEGRATORS, advance
from turtlebot_gym.parameters import FilterTuning, Kalman
from turtlebot_gym.values import Command, Odometry, Pose, Senses, State

EULER = INTEGRATORS["euler"]
COLUMN = State(0.0, 0.0, 0.0, 0.0, 0.0)
ZERO = (0.0, 0.0, 0.0)
DRIVES = {  # Q, R, P0 and the control interval, s; the last ones diverge without the floors
    "exact": ((0.0,) * 5, ZERO, (1e9,) * 5, 0.1),
    "nearly": ((0.0,) * 5, (1e-100, 1e-15, 0.0), (1e9, 1.0, 1e3, 1e6, 1.0), 0.1),
    "motion unknown": ((1e9, 0.0, 1e-100, 1e6, 1.0), ZERO, (0.1, 0.1, 0.1, 1.0, 1.0), 0.1),
    "one exact": ((0.0, 0.0, 0.0, 1.0, 1.0), (0.0, 1.0, 1e-6), (1e6, 1e6, 1e3, 1e3, 1e3), 0.1),
    "turning unknown": ((0.1, 1e3, 1e-100, 1e-15, 1e-15), (1e-15, 1e-100, 1e-15), (0.0, 1e-3, 1e-100, 1e6, 1e9), 10.0),
    "heading unknown": ((1e-100, 0.0, 1e9, 0.0, 1e9), (0.0, 1e-100, 0.0), (1e6, 1.0, 0.1, 1e6, 1e3), 0.1),
    "speeds unknown": ((1e-6, 1e-12, 1e9, 1e9, 1.0), (1e-12, 1e-12, 1e-12), (0.0, 1e9, 1.0, 1e-6, 1e6), 10.0),
}


def error_of(name, *, steps=60):
    """Return the greatest error of position, m, of a drive without noise, after the first steps; infinity where it diverges."""
    Q, R, P0, dt = DRIVES[name]
    tuning = FilterTuning(Q=Q, R=R, P0=P0, from_origin=True, kind=Kalman(remember_velocity=True))
    pose, twist = Pose(0.5, -0.3, 0.2), Command(0.0, 0.0)
    estimate, senses, worst = ekf.initialize(pose, tuning), Senses(Odometry(pose, twist, True)), 0.0
    for k in range(steps):
        pose = advance(pose, twist.v, twist.omega, dt, EULER)
        twist = Command(0.2 * math.cos(k), 2.0 * math.sin(3.0 * k))
        before, senses = senses, Senses(Odometry(pose, twist, True))
        try:
            estimate = ekf.step(estimate, before, senses, tuning, dt, EULER)
        except (ValueError, OverflowError):  # a heading that is not finite cannot be wrapped in plain Python
            return math.inf
        mean, P = estimate.belief
        if not np.isfinite([*mean, *P]).all():
            return math.inf
        worst = max(worst, math.hypot(mean.x - pose.x, mean.y - pose.y)) if k > 5 else worst
    return worst


@pytest.mark.parametrize("name", DRIVES)
def test_the_estimate_stays_where_it_is_measured(name):
    assert error_of(name) < 0.5


def test_without_the_floors_it_does_not(monkeypatch):
    monkeypatch.setattr(update, "LEAST_SHARE", 0.0)
    monkeypatch.setattr(update, "LEAST_VARIANCE", 0.0)
    assert max(map(error_of, list(DRIVES)[-3:])) > 1e3


@pytest.mark.parametrize("r", [1e-12, 1e-6, 0.05, 1e9, math.inf])
@pytest.mark.parametrize("variance", [0.0, 1e-9, 0.3, 1.0])
def test_a_measurement_of_usual_accuracy_counts_as_it_is(variance, r):
    assert innovation_variance(Projection(COLUMN, variance), r) == variance + r


def test_an_exact_measurement_leaves_a_millionth_of_the_deviation():
    belief = ekf.initialize(Pose(0.0, 0.0, 0.0), FilterTuning(Q=(0.0,) * 5, R=ZERO, from_origin=True, P0=(1e9,) * 5)).belief
    posterior, _ = update.update(belief, update.of_x(belief.covariance), 1.0, 0.0)
    assert posterior.mean.x == pytest.approx(1.0, abs=1e-9)
    assert math.sqrt(posterior.covariance.xx / belief.covariance.xx) == pytest.approx(1e-6, rel=1e-3)
