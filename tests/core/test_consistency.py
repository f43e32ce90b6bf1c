"""The statistics that judge filters."""

import math

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import FilterTuning, Noise, OdometryNoise, ProcessNoise
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
