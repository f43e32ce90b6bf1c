"""The filter: its algebra against an oracle, its Jacobian, its covariance, its gate, and whether it is consistent."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.consistency import mean_bounds, nees
from turtlebot_gym.estimation.filters import entries, jacobian, matrix, reference_filter
from turtlebot_gym.estimation.interface import filter_of
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import INTEGRATORS, advance
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Kalman, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import DOCUMENTED, NOISES, ROUGH, TUTORIAL_FILTER, matched
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import Task
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
def test_jacobian_equals_differences(integrator):
    rng = np.random.default_rng(2)
    tuning = FilterTuning(Q=(0.0,) * 5, R=(1.0,) * 3)
    h = 1e-6

    def f(state):
        return np.array(
            ekf.predict(Belief(State(*state), NOWHERE), Command(0.2, 1.0), tuning, DT, INTEGRATORS[integrator]).mean
        )

    for _ in range(200):
        state = np.array(random_belief(rng).mean)
        differences = np.zeros((5, 5))
        for k in range(5):
            ahead, behind = f((state + h * np.eye(5)[k]).tolist()), f((state - h * np.eye(5)[k]).tolist())
            change = ahead - behind
            change[2] = wrap(change[2])
            differences[:, k] = change / (2.0 * h)
        np.testing.assert_allclose(jacobian(State(*state), dt=DT, integrator=integrator), differences, atol=1e-8)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("remember", [False, True])
def test_prediction_is_the_textbook_product(integrator, remember):
    rng = np.random.default_rng(3)
    tuning = FilterTuning(Q=(1e-3, 2e-3, 3e-3, 1e-4, 9.0), R=(1.0,) * 3, process=EXECUTION)
    for dt in (0.02, 0.1, 0.5):
        belief, command = random_belief(rng), Command(0.2, -1.5)
        F = jacobian(belief.mean, dt=dt, integrator=integrator)
        F[3, 3] = F[4, 4] = remember
        v2, omega2 = command.v**2, command.omega**2
        executed = np.array([0.02 * v2 + 0.002 * omega2, 0.1 * v2 + 0.02 * omega2]) * 0.1 / dt
        Q = np.diag(tuning.Q) * dt / 0.1
        Q[3, 3], Q[4, 4] = max(Q[3, 3], executed[0]), max(Q[4, 4], executed[1])
        assert Q[3, 3] == executed[0], "the assumed execution should count for the speed ..."
        assert Q[4, 4] == pytest.approx(9.0 * dt / 0.1), "... and the floor for the turning rate"
        moved = ekf.predict(belief, command, tuning, dt, INTEGRATORS[integrator], remember)
        expected = F @ matrix(belief.covariance) @ F.T + Q
        np.testing.assert_allclose(matrix(moved.covariance), expected, rtol=1e-12, atol=1e-12)
        assert moved.mean[3:] == command


def test_update_is_the_textbook_one():
    """Three scalar updates equal the joint one in Joseph's form, whatever the correlations."""
    rng = np.random.default_rng(4)
    H = np.eye(3, 5)
    for _ in range(500):
        belief = random_belief(rng, rank=int(rng.integers(1, 6)))
        tuning = FilterTuning(Q=(0.0,) * 5, R=tuple(rng.uniform(0.01, 2.0, 3).tolist()))
        z = Pose(*rng.uniform(-3.0, 3.0, 3).tolist())
        P, R = matrix(belief.covariance), np.diag(tuning.R)
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        nu = np.array(z) - H @ belief.mean
        nu[2] = wrap(nu[2])
        I_KH = np.eye(5) - K @ H
        posterior, nis = ekf.correct(belief, z, tuning.R)
        change = np.array(posterior.mean) - belief.mean
        change[2] -= (K @ nu)[2]
        assert abs(wrap(change[2])) < 1e-9
        np.testing.assert_allclose(np.delete(change, 2), np.delete(K @ nu, 2), atol=1e-9)
        np.testing.assert_allclose(matrix(posterior.covariance), I_KH @ P @ I_KH.T + K @ R @ K.T, atol=1e-9)
        assert nis == pytest.approx(nu @ np.linalg.inv(S) @ nu, rel=1e-9)


def test_known_component_measured_without_noise():
    """P = 0 and R = 0: nothing is learned, and nothing divides by zero; R counts as (1 um)^2."""
    belief = Belief(State(1.0, 2.0, 0.5, 0.1, 0.2), NOWHERE)
    tuning = FilterTuning(Q=(0.0,) * 5, R=(0.0,) * 3)
    posterior, nis = ekf.correct(belief, Pose(1.5, 2.0, 0.5), tuning.R)
    assert posterior == belief
    assert nis == pytest.approx(0.25e12)


def test_innovation_wraps_unless_told_otherwise():
    mean = State(0.0, 0.0, 3.1, 0.0, 0.0)
    tuning = FilterTuning(Q=(0.0,) * 5, R=(1.0,) * 3)
    assert ekf.innovation(mean, Pose(0.0, 0.0, -3.1), tuning).theta == pytest.approx(2.0 * math.pi - 6.2)
    assert ekf.innovation(mean, Pose(0.0, 0.0, -3.1), False).theta == pytest.approx(-6.2)


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


def test_prediction_only_when_a_measurement_drops_out():
    tuning = TUNINGS["documented"]
    estimate = ekf.initialize(Pose(1.0, 2.0, 0.3), tuning)._replace(nis=4.0)
    z, command = Pose(9.0, 9.0, 2.0), Command(0.2, 0.5)
    after = step(estimate, command, z, z, False, tuning, DT, 0.0)
    assert after.belief == ekf.predict(estimate.belief, command, tuning, DT, 0.0)
    assert after.nis == 4.0  # still that of the last one


GATED = FilterTuning(Q=(0.0, 0.0, 0.0, 1e-4, 1e-4), R=(0.01, 0.01, 0.01), kind=Kalman(gate=16.3, max_rejections=4))
"""chi2.ppf(0.999, 3) = 16.27."""


def test_gate_refuses_outliers_and_nothing_else():
    estimate = ekf.initialize(Pose(0.0, 0.0, 0.0), GATED)
    command = Command(0.0, 0.0)
    prior = ekf.predict(estimate.belief, command, GATED, DT, 0.0)
    near, far = Pose(0.1, 0.0, 0.0), Pose(2.0, 0.0, 0.0)
    refused = step(estimate, command, near, far, True, GATED, DT, 0.0)
    assert refused == ekf.Estimate(prior, ekf.correct(prior, far, GATED.R)[1], 1.0)
    assert refused.nis > GATED.kind.gate
    taken = step(refused, command, far, near, True, GATED, DT, 0.0)
    assert taken.rejections == 0.0
    assert taken.belief.mean.x > 0.0


def test_a_lost_filter_recovers_from_a_locked_gate():
    estimate = ekf.initialize(Pose(0.0, 0.0, 0.0), GATED)
    there, command = Pose(5.0, -3.0, 2.0), Command(0.1, 0.2)
    for count in (1.0, 2.0, 3.0):
        estimate = step(estimate, command, there, there, True, GATED, DT, 0.0)
        assert estimate.rejections == count
        assert estimate.belief.mean.x < 1.0
        dropped = step(estimate, command, there, there, False, GATED, DT, 0.0)
        assert dropped.rejections == count  # a lost measurement says nothing
    estimate = step(estimate, command, there, there, True, GATED, DT, 0.0)
    assert estimate.rejections == 0.0
    assert estimate.belief.mean == State(*there, *command)
    assert np.diag(matrix(estimate.belief.covariance))[:3].tolist() == list(GATED.R)


def test_odometry_as_input_moves_the_belief_and_does_not_correct_it():
    tuning = replace(GATED, kind=DeadReckoning(), process=EXECUTION)
    estimate = ekf.initialize(Pose(1.0, 1.0, math.pi / 2.0), tuning)
    command = Command(0.2, 0.1)
    # The odometry's frame is turned against the belief's by 90 degrees, and moves 0.5 m ahead, turning by 0.2.
    after = step(estimate, command, Pose(0.0, 0.0, 0.0), Pose(0.5, 0.0, 0.2), True, tuning, DT, 0.0)
    assert after.belief.mean[:3] == pytest.approx((1.0, 1.5, math.pi / 2.0 + 0.2))
    assert after.belief.covariance == ekf.predict(estimate.belief, command, tuning, DT, 0.0).covariance
    later = after
    for _ in range(20):
        later = step(later, command, Pose(0.5, 0.0, 0.2), Pose(0.5, 0.0, 0.2), True, tuning, DT, 0.0)
    assert later.belief.covariance.xx + later.belief.covariance.yy > 1.01 * (
        after.belief.covariance.xx + after.belief.covariance.yy
    )


# Consistency: many independent runs of the compiled loop, all judged at one time, since errors along a run are correlated.

RUNS, FALSE_ALARM = 600, 1e-4
TRUE_NOISE = Noise(process=EXECUTION, odometry=OdometryNoise(R=(0.05**2, 0.04**2, 0.1**2)))
TRUE_TUNING = FilterTuning(Q=(0.0,) * 5, R=TRUE_NOISE.odometry.R, process=EXECUTION)


def simulate(tuning, *, noise=TRUE_NOISE, steps=60, integrator="midpoint", seed=0):
    """Run many robots along gentle curves; return each run's NEES and NIS at the end, and the states."""
    endless = Task(random=False, radius=1e-9, max_steps=math.inf)
    batch = Batch(RUNS, make_parameters(endless, noise=noise, filter=tuning, integrator=integrator), [Pose(99.0, 99.0, 0.0)])
    batch.seeds[:] = seed + np.arange(RUNS)
    batch.reset(np.ones(RUNS, np.bool_), *batch.empty())
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        batch.step(rng.uniform([0.5, -0.3], [1.0, 0.3], (RUNS, 2)).astype(np.float32))
    worlds = [batch.world(i) for i in range(RUNS)]
    truth = np.array([world.body.true_state for world in worlds])
    estimate = np.array([world.estimate.belief.mean for world in worlds])
    P = np.array([matrix(world.estimate.belief.covariance) for world in worlds])
    return nees(estimate, truth, P), np.array([world.estimate.nis for world in worlds]), estimate, truth


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_filter_is_consistent(integrator):
    # RUNS * mean ~ chi2(5 RUNS) and chi2(3 RUNS): a correct filter fails either for one seed in 10^4.
    error, innovation, _, _ = simulate(TRUE_TUNING, integrator=integrator)
    low, high = mean_bounds(5, RUNS, false_alarm=FALSE_ALARM)
    assert low < error.mean() < high
    low, high = mean_bounds(3, RUNS, false_alarm=FALSE_ALARM)
    assert low < innovation.mean() < high


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("what", ["R", "process"])
def test_consistency_notices_a_wrong_model(what, factor):
    if what == "R":
        wrong = replace(TRUE_TUNING, R=tuple(factor * variance for variance in TRUE_TUNING.R))
    else:
        alphas = {name: factor * getattr(EXECUTION, name) for name in ("alpha1", "alpha2", "alpha3", "alpha4")}
        wrong = replace(TRUE_TUNING, process=replace(EXECUTION, **alphas))
    error, innovation, _, _ = simulate(wrong)
    low, high = mean_bounds(5, RUNS, false_alarm=FALSE_ALARM)
    assert not low < error.mean() < high
    if what == "R":
        low, high = mean_bounds(3, RUNS, false_alarm=FALSE_ALARM)
        assert not low < innovation.mean() < high


def test_consistency_notices_a_jacobian_that_remembers_the_twist():
    error, _, _, _ = simulate(replace(TRUE_TUNING, kind=Kalman(remember_velocity=True)))
    low, high = mean_bounds(5, RUNS, false_alarm=FALSE_ALARM)
    assert not low < error.mean() < high


def test_no_filter_can_see_a_bias_and_the_test_does():
    biased = replace(TRUE_NOISE, odometry=replace(TRUE_NOISE.odometry, bias=(0.02, 0.0, 0.0)))
    error, _, _, _ = simulate(TRUE_TUNING, noise=biased)
    assert error.mean() > mean_bounds(5, RUNS, false_alarm=FALSE_ALARM)[1]


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_no_noise_means_no_error(integrator):
    _, innovation, estimate, truth = simulate("matched", noise=Noise(), steps=200, integrator=integrator)
    np.testing.assert_allclose(estimate, truth, atol=1e-12)
    np.testing.assert_allclose(innovation, 0.0, atol=1e-12)
