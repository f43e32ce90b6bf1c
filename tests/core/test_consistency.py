"""The statistics that judge filters, and the tuning that is matched to a noise, by hand."""

import math

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Kalman, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import NOISES, ODOMETRY_LEAP, POSE_GATE, matched
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import Task
from turtlebot_gym.values import Pose


def test_nees_is_the_quadratic_form_with_the_heading_wrapped():
    P = np.diag([1.0, 4.0, 0.25])
    estimate, truth = np.array([1.0, 2.0, 3.0, 3.0, 4.0]), np.array([0.0, 0.0, -3.0, 0.0, 0.0])
    heading = (6.0 - 2.0 * math.pi) ** 2 / 0.25
    assert nees(estimate, truth, P) == pytest.approx(2.0 + heading)
    assert estimate[2] == 3.0  # the caller's
    assert nees(np.tile(estimate, (2, 3, 1)), truth, np.tile(P, (2, 3, 1, 1))).shape == (2, 3)
    # [[2, 1], [1, 2]]^-1 = [[2, -1], [-1, 2]] / 3: (2 * 9 - 2 * 3 * 5 + 2 * 25) / 3
    P[:2, :2] = [[2.0, 1.0], [1.0, 2.0]]
    assert nees(np.array([3.0, 5.0, 0.0]), np.zeros(3), P) == pytest.approx(38.0 / 3.0)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_filter_is_consistent(integrator):
    """600 runs along gentle curves, judged at one time, since errors along a run are correlated."""
    runs, execution = 600, ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.1, alpha4=0.02)
    noise = Noise(process=execution, odometry=OdometryNoise(R=(0.05**2, 0.04**2, 0.1**2)))
    tuning = FilterTuning(Q=(0.0,) * 5, R=noise.odometry.R, process=execution)
    endless = Task(random=False, radius=1e-9, max_steps=math.inf)
    batch = Batch(runs, make_parameters(endless, noise=noise, filter=tuning, integrator=integrator), [Pose(99.0, 99.0, 0.0)])
    batch.seeds[:], rng = np.arange(runs), np.random.default_rng(0)
    batch.reset(np.ones(runs, np.bool_), *batch.empty())
    for _ in range(60):
        batch.step(rng.uniform([0.5, -0.3], [1.0, 0.3], (runs, 2)).astype(np.float32))
    estimates = [batch.world(i).estimate for i in range(runs)]
    P = np.array([matrix(estimate.belief.covariance) for estimate in estimates])
    errors = nees([estimate.belief.mean for estimate in estimates], batch.numbers("body.true_state"), P)
    low, high = stats.chi2.interval(1.0 - 1e-4, 3 * runs)  # each sum is outside for one seed in 10^4
    assert low < errors.sum() < high
    assert low < sum(estimate.nis for estimate in estimates) < high


@pytest.mark.parametrize("name", NOISES)
def test_the_matched_filter_knows_what_a_filter_can_know(name):
    tuning = matched(NOISES[name])
    assert list(tuning.Q) == pytest.approx([0.0, 0.0, 0.0, 2.5e-5, 1e-4], rel=1e-12)  # floors: 5 mm/s and 0.01 rad/s
    assert (tuning.process.slip, tuning.process.scale) == (0.0, 1.0)  # slip is in the alphas, a speed error is not known
    assert tuning.kind == (DeadReckoning(**ODOMETRY_LEAP) if NOISES[name].odometry.wheel else Kalman(**POSE_GATE))
    assert not tuning.from_origin


def test_the_matched_filter_counts_spikes_and_has_a_floor_for_each_number():
    odometry = OdometryNoise(R=(0.01, 0.02, 0.03), spike_probability=0.1, spike=0.2)  # 0.1 * 0.2^2 = 0.004
    assert list(matched(Noise(odometry=odometry)).R) == pytest.approx([0.01, 0.02, 0.034], rel=1e-12)
    assert list(matched(Noise(odometry=OdometryNoise(R=(0.04, 0.0, 2e-6)))).R) == pytest.approx([0.04, 1e-6, 2e-6], rel=1e-12)


@pytest.mark.parametrize(("slip", "start", "end"), [(0.5, 0.01, 0.2), (1.0, 0.5, 0.5), (0.5, 0.3, 0.0), (0.5, 0.0, 0.3)])
def test_the_matched_filter_counts_slip_by_its_long_run_variance(slip, start, end):
    """All autocovariances of the two-state chain, added up; a chain that never changes has no variance."""
    process = ProcessNoise(alpha1=0.001, alpha2=0.002, alpha3=0.003, alpha4=0.004, slip=slip, slip_start=start, slip_end=end)
    steps = np.array([[1.0 - start, start], [end, 1.0 - end]])
    stationary = np.array([end, start]) / (start + end)
    lost = np.array([0.0, slip])
    lags = [stationary * lost @ np.linalg.matrix_power(steps, k) @ lost - (stationary @ lost) ** 2 for k in range(400)]
    added = lags[0] + 2.0 * sum(lags[1:])
    counted = (0.001 + added, 0.002, 0.003, 0.004 + added)
    alphas = matched(Noise(process=process)).process
    assert (alphas.alpha1, alphas.alpha2, alphas.alpha3, alphas.alpha4) == pytest.approx(counted, rel=1e-6)
