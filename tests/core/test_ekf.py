"""The filter: its algebra against an oracle, its Jacobian, its covariance, its gate, and whether it is consistent."""

from __future__ import annotations

import math

import numpy as np
import pytest

from turtlebot_gym.estimation import ekf, update
from turtlebot_gym.estimation.filters import entries, filter_of, jacobian, matrix, reference_filter
from turtlebot_gym.estimation.update import Projection, innovation_variance
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import INTEGRATORS, advance
from turtlebot_gym.parameters import FilterTuning, Kalman, ProcessNoise
from turtlebot_gym.presets import DOCUMENTED, NOISES, ROUGH, TUTORIAL_FILTER, matched
from turtlebot_gym.values import Belief, Command, Covariance, Odometry, Pose, Senses, State

DT = 0.1
NOWHERE = Covariance(*[0.0] * 15)
EXECUTION = ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.1, alpha4=0.02)
TUNINGS = {
    "tutorial": TUTORIAL_FILTER,
    "documented": matched(DOCUMENTED),
    "rough": matched(ROUGH),
    "clean": matched(NOISES["clean"]),
    "every term": FilterTuning(
        Q=(1e-3, 2e-3, 3e-3, 1e-4, 2e-4), R=(0.01, 0.02, 0.03), process=EXECUTION, kind=Kalman(remember_velocity=True)
    ),
}


def step(estimate, command, before, z, measured, tuning, dt, middle):
    """Run the filter that the tuning is for: the odometry said ``before``, and then ``z``."""
    senses = Senses(Odometry(before, command, True)), Senses(Odometry(z, command, measured))
    return filter_of(tuning).step(estimate, *senses, tuning, dt, middle)


def random_belief(rng: np.random.Generator, *, scale: float = 1.0, rank: int = 5) -> Belief:
    """Draw a mean anywhere, and a covariance of the given rank."""
    root = rng.normal(size=(5, rank)) * scale
    x, y, v, omega = rng.uniform(-3.0, 3.0, 4).tolist()
    return Belief(State(x, y, rng.uniform(-math.pi, math.pi), v, omega), entries(root @ root.T))


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", TUNINGS)
def test_filter_equals_filterpy(name, integrator):
    """Random steps with spikes and drop-outs, 10,000 of them for the presets: mean to 1e-9, covariance to 1e-8 of its scale."""
    tuning, middle = TUNINGS[name], INTEGRATORS[integrator]
    rng = np.random.default_rng(1)
    reference = reference_filter(tuning, dt=DT, integrator=integrator)
    estimate = ekf.initialize(Pose(0.4, -0.2, 3.0), tuning)
    reference.x, reference.P = np.array(estimate.belief.mean), matrix(estimate.belief.covariance)
    truth, twist, before = Pose(0.0, 0.0, 3.0), Command(0.0, 0.0), Pose(0.0, 0.0, 3.0)
    deviation = np.sqrt(tuning.R)
    for k in range(10_000 if name in ("tutorial", "documented") else 2_000):
        command = Command(*rng.uniform([-0.3, -2.0], [0.3, 2.0]).tolist())
        truth, twist = advance(truth, *twist, DT, middle), command
        spike = rng.choice([0.0, 0.3, -0.3], p=[0.9, 0.05, 0.05])
        error = rng.normal(0.0, deviation)
        z = Pose(truth.x + error[0], truth.y + error[1], wrap(truth.theta + error[2] + spike))
        measured = bool(rng.random() > 0.1)
        estimate = step(estimate, command, before, z if measured else before, measured, tuning, DT, middle)
        before = z if measured else before
        reference.predict(command)
        reference.update(z if measured else None)

        difference = np.array(estimate.belief.mean) - reference.x
        difference[2] = wrap(difference[2])
        assert np.abs(difference).max() < 1e-9, f"mean, step {k}"
        deviations = np.sqrt(np.diag(reference.P))
        allowed = 1e-8 * np.outer(deviations, deviations) + 1e-300
        assert (np.abs(matrix(estimate.belief.covariance) - reference.P) <= allowed).all(), f"covariance, step {k}"
        if measured:
            assert estimate.nis == pytest.approx(reference.mahalanobis**2, rel=1e-7, abs=1e-12)
    assert np.abs(reference.x[:2]).max() > 0.1, "the drive went nowhere: the test saw too little"


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("dt", [DT, 0.25])
def test_jacobian_equals_differences(integrator, dt):
    rng = np.random.default_rng(2)
    tuning = FilterTuning(Q=(0.0,) * 5, R=(1.0,) * 3)
    h = 1e-6

    def f(state):
        return np.array(
            ekf.predict(Belief(State(*state), NOWHERE), Command(0.2, 1.0), tuning, dt, INTEGRATORS[integrator]).mean
        )

    for _ in range(200):
        state = np.array(random_belief(rng).mean)
        differences = np.zeros((5, 5))
        for k in range(5):
            ahead, behind = f((state + h * np.eye(5)[k]).tolist()), f((state - h * np.eye(5)[k]).tolist())
            change = ahead - behind
            change[2] = wrap(change[2])
            differences[:, k] = change / (2.0 * h)
        np.testing.assert_allclose(jacobian(State(*state), dt=dt, integrator=integrator), differences, atol=1e-8)


def test_known_component_measured_without_noise():
    """P = 0 and R = 0: nothing is learned, and nothing divides by zero; R counts as (1 um)^2."""
    belief = Belief(State(1.0, 2.0, 0.5, 0.1, 0.2), NOWHERE)
    tuning = FilterTuning(Q=(0.0,) * 5, R=(0.0,) * 3)
    posterior, nis = ekf.correct(belief, Pose(1.5, 2.0, 0.5), tuning.R)
    assert posterior == belief
    assert nis == pytest.approx(0.25e12)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_covariance_stays_positive_under_fuzzing(integrator):
    """Scales over twelve decades, missing ranks, drop-outs, gates and restarts: never a negative variance or eigenvalue.

    "Never" is up to the rounding of the largest covariance on the way: what a good measurement leaves of a large one is a small
    difference of large numbers, in any filter but a square-root one.
    """
    rng = np.random.default_rng(5)
    for _ in range(150):
        scale = 10.0 ** rng.uniform(-6.0, 3.0)
        R = tuple((10.0 ** rng.uniform(-12.0, 2.0, 3) * (rng.random(3) > 0.1)).tolist())
        Q = tuple((10.0 ** rng.uniform(-12.0, 1.0, 5) * (rng.random(5) > 0.3)).tolist())
        gate = float(rng.choice([math.inf, 3.0]))
        tuning = FilterTuning(Q=Q, R=R, kind=Kalman(gate=gate, max_rejections=3, remember_velocity=bool(rng.integers(2))))
        belief = random_belief(rng, scale=scale, rank=int(rng.integers(0, 6)))
        estimate = ekf.Estimate(belief, 0.0, 0.0)
        largest = max(belief.covariance)
        dt = float(10.0 ** rng.uniform(-3.0, 0.0))
        for _ in range(40):
            z = Pose(*rng.uniform([-5.0, -5.0, -math.pi], [5.0, 5.0, math.pi]).tolist())
            command = Command(*rng.uniform(-3.0, 3.0, 2).tolist())
            measured = bool(rng.random() < 0.8)
            prior = ekf.predict(estimate.belief, command, tuning, dt, INTEGRATORS[integrator])
            largest = max(largest, *prior.covariance)
            estimate = step(estimate, command, z, z, measured, tuning, dt, INTEGRATORS[integrator])
            P = matrix(estimate.belief.covariance)
            assert np.isfinite(P).all()
            assert np.isfinite(estimate.belief.mean).all()
            assert -math.pi <= estimate.belief.mean.theta < math.pi
            assert estimate.nis >= 0.0
            assert (np.diag(P) >= 0.0).all()
            assert np.linalg.eigvalsh(P)[0] >= -1e-12 * largest, (Q, R, P)
            deviations = np.sqrt(np.diag(P) + 1e-12 * largest + 1e-300)
            assert np.abs(P / np.outer(deviations, deviations)).max() <= 1.0 + 1e-9, (Q, R, P)


# Measurements that are exact, or almost: rounding does not make the filter diverge.

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
