"""The statistics that judge filters, and the bound on how good one can be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation.consistency import cramer_rao_bound, heading_information, mean_bounds, nees, normalized
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import FilterTuning, Kalman, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import DOCUMENTED, TUTORIAL
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import Task
from turtlebot_gym.values import Pose

RNG_SEED = 11


def gaussian(n, seed=RNG_SEED):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5))
    P = root @ root.T + 0.1 * np.eye(5)
    return rng.multivariate_normal(np.zeros(5), P, n), P


def test_nees_is_chi_square():
    # Kolmogorov and Smirnov: a right one fails for one seed in 10^4.
    error, P = gaussian(4000)
    error[:, 2] = np.clip(error[:, 2], -3.0, 3.0)  # beyond pi the heading's error would be wrapped
    values = nees(error, np.zeros(5), P, components=2)
    assert stats.kstest(values, "chi2", args=(2,)).pvalue > 1e-4
    assert stats.kstest(1.1 * values, "chi2", args=(2,)).pvalue < 1e-4


def test_nees_is_the_quadratic_form_with_the_heading_wrapped():
    P = np.diag([1.0, 4.0, 0.25, 9.0, 16.0])
    estimate, truth = np.array([1.0, 2.0, 3.0, 3.0, 4.0]), np.array([0.0, 0.0, -3.0, 0.0, 0.0])
    heading = (6.0 - 2.0 * math.pi) ** 2 / 0.25
    assert nees(estimate, truth, P) == pytest.approx(1.0 + 1.0 + heading + 1.0 + 1.0)
    assert nees(estimate, truth, P, components=3) == pytest.approx(2.0 + heading)
    assert estimate[2] == 3.0  # the caller's
    many = nees(np.stack([estimate] * 6).reshape(2, 3, 5), truth, np.stack([P] * 6).reshape(2, 3, 5, 5))
    assert many.shape == (2, 3)
    # [[2, 1], [1, 2]]^-1 = [[2, -1], [-1, 2]] / 3: (2 * 9 - 2 * 3 * 5 + 2 * 25) / 3
    assert normalized([3.0, 5.0], [[2.0, 1.0], [1.0, 2.0]]) == pytest.approx(38.0 / 3.0)


def test_heading_information_without_spikes_is_one_over_the_variance():
    for variance in (1e-8, 0.01, 4.0):
        assert heading_information(OdometryNoise(R=(0.0, 0.0, variance))) == pytest.approx(1.0 / variance, rel=1e-10)
        unused = OdometryNoise(R=(0.0, 0.0, variance), spike=0.3)
        assert heading_information(unused) == pytest.approx(1.0 / variance, rel=1e-10)


def test_heading_information_of_the_presets():
    assert heading_information(TUTORIAL.odometry) * 0.1 == pytest.approx(0.982, abs=5e-4)
    assert heading_information(DOCUMENTED.odometry) * 0.1**2 == pytest.approx(0.908, abs=5e-4)


def test_heading_information_equals_the_integral():
    s, a, e = 0.05, 0.2, 0.1

    def integrand(x):
        parts = [(1.0 - e, 0.0), (0.5 * e, a), (0.5 * e, -a)]
        p = sum(w * stats.norm.pdf(x, m, s) for w, m in parts)
        return sum(w * stats.norm.pdf(x, m, s) * (m - x) / s**2 for w, m in parts) ** 2 / p

    expected, _ = integrate.quad(integrand, -0.7, 0.7, points=[-a, 0.0, a], epsabs=0.0, epsrel=1e-10)
    noise = OdometryNoise(R=(0.0, 0.0, s**2), spike_probability=e, spike=a)
    assert heading_information(noise) == pytest.approx(expected, rel=1e-8)
    assert 1.0 / (s**2 + e * a**2) < heading_information(noise) < 1.0 / s**2


def test_far_spikes_cost_only_their_share():
    noise = OdometryNoise(R=(0.0, 0.0, 0.01**2), spike_probability=0.1, spike=3.0)
    assert heading_information(noise) * 0.01**2 == pytest.approx(1.0, rel=1e-9)  # told apart for certain, they cost nothing


def test_heading_information_needs_white_noise():
    with pytest.raises(ValueError, match=r"OdometryNoise\.R must have a positive heading variance for this, got 0\.0\."):
        heading_information(OdometryNoise(R=(1.0, 1.0, 0.0)))


def test_bounds_of_a_mean_are_those_of_the_tables():
    # Tables of chi-square, 2.5 % on each side, for 5, 10 and 12 degrees of freedom; then 5 % on each side for 1.
    assert mean_bounds(5, 1, false_alarm=0.05) == pytest.approx((0.831212, 12.832502), rel=1e-6)
    assert mean_bounds(5, 2, false_alarm=0.05) == pytest.approx((3.246973 / 2.0, 20.483177 / 2.0), rel=1e-6)
    assert mean_bounds(3, 4, false_alarm=0.05) == pytest.approx((4.403789 / 4.0, 23.336664 / 4.0), rel=1e-6)
    assert mean_bounds(1, 1, false_alarm=0.1) == pytest.approx((0.003932, 3.841459), rel=1e-4)


@pytest.mark.parametrize(
    ("degrees", "runs", "false_alarm", "message"),
    [
        (0, 5, 0.1, "degrees and runs must be at least 1, got 0 and 5."),
        (5, 0, 0.1, "degrees and runs must be at least 1, got 5 and 0."),
        (5, 5, 0.0, "false_alarm must be between 0 and 1, got 0.0."),
        (5, 5, 1.0, "false_alarm must be between 0 and 1, got 1.0."),
        (5, 5, math.nan, "false_alarm must be between 0 and 1, got nan."),
    ],
)
def test_bounds_refuse_nonsense(degrees, runs, false_alarm, message):
    with pytest.raises(ValueError, match="must be") as caught:
        mean_bounds(degrees, runs, false_alarm=false_alarm)
    assert str(caught.value) == message


# Many independent runs of the compiled loop, all judged at one time, since errors along a run are correlated.

RUNS, FALSE_ALARM = 600, 1e-4
EXECUTION = ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.1, alpha4=0.02)
TRUE_NOISE = Noise(process=EXECUTION, odometry=OdometryNoise(R=(0.05**2, 0.04**2, 0.1**2)))
TRUE_TUNING = FilterTuning(Q=(0.0,) * 5, R=TRUE_NOISE.odometry.R, process=EXECUTION)


def drive(tuning, *, noise=TRUE_NOISE, runs=RUNS, steps=60, integrator="midpoint", seed=0):
    """Run many robots along gentle curves; return the batch, with all true states and limited commands."""
    endless = Task(random=False, radius=1e-9, max_steps=math.inf)
    batch = Batch(runs, make_parameters(endless, noise=noise, filter=tuning, integrator=integrator), [Pose(99.0, 99.0, 0.0)])
    batch.seeds[:] = seed + np.arange(runs)
    batch.reset(np.ones(runs, np.bool_), *batch.empty())
    rng = np.random.default_rng(seed)
    states, commands = [batch.numbers("body.true_state")], []
    for _ in range(steps):
        batch.step(rng.uniform([0.5, -0.3], [1.0, 0.3], (runs, 2)).astype(np.float32))
        states.append(batch.numbers("body.true_state"))
        commands.append(batch.numbers("body.command"))
    return batch, np.stack(states, axis=1), np.stack(commands, axis=1)


def simulate(tuning, **options):
    """Return each run's NEES and NIS at the end of a drive, and the states."""
    batch, states, _ = drive(tuning, **options)
    worlds = [batch.world(i) for i in range(RUNS)]
    estimate = np.array([world.estimate.belief.mean for world in worlds])
    P = np.array([matrix(world.estimate.belief.covariance) for world in worlds])
    return nees(estimate, states[:, -1], P), np.array([world.estimate.nis for world in worlds]), estimate, states[:, -1]


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


def position_share(tuning, *, runs=250, steps=30):
    """Return the filter's mean squared position error at the end of a drive, as a share of the bound."""
    batch, states, commands = drive(tuning, runs=runs, steps=steps)
    bound = cramer_rao_bound(states, commands, TRUE_TUNING, integrator="midpoint")
    assert bound.shape == (steps + 1, 5, 5)
    errors = np.array([batch.world(i).estimate.belief.mean for i in range(runs)]) - states[:, -1]
    # Of two components with nearly equal variances: 2 runs times the share is about chi2(2 runs).
    low, high = mean_bounds(2, runs, false_alarm=FALSE_ALARM)
    return (errors[:, :2] ** 2).sum(axis=1).mean() / np.trace(bound[-1, :2, :2]), low / 2.0, high / 2.0


def test_a_right_filter_reaches_the_bound_and_a_wrong_one_does_not():
    share, low, high = position_share(TRUE_TUNING)
    assert low < share < high  # fails for one seed in 10^4
    assert position_share(replace(TRUE_TUNING, Q=(0.05, 0.05, 0.05, 0.1, 0.1)))[0] > high
