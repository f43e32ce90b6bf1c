"""The filter as an object, and tunings; algebra: `test_textbook_filter`."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.estimation.filters import KalmanFilter, covariance_of, filter_of, matrix
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import (
    DeadReckoning,
    Gated,
    Kalman,
)
from turtlebot_gym.presets import DOCUMENTED, POSE_GATE, ROUGH, TUTORIAL_FILTER, make_filter, matched
from turtlebot_gym.values import STOP, Command, Covariance, Odometry, Pose, Senses

TUNING = replace(matched(DOCUMENTED), kind=Kalman())
GATED = replace(TUNING, kind=Kalman(gate=9.0, max_rejections=2))


def drive(seed, steps=300):
    """Draw commands and odometry; None for what drops out."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        command = Command(*rng.uniform([-0.2, -1.0], [0.2, 1.0]).tolist())
        odometry = Pose(*rng.normal(0.0, [0.3, 0.3, 1.0]).tolist())
        yield command, odometry if rng.random() > 0.2 else None


TUNINGS = [TUNING, GATED, TUTORIAL_FILTER, replace(TUNING, kind=DeadReckoning()), make_filter("gated", ROUGH)]


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("tuning", TUNINGS)
def test_steps_are_those_of_the_function(tuning, integrator):
    kf = KalmanFilter(tuning, integrator=integrator, dt=0.05)
    before = Pose(0.3, 0.2, 0.1)
    kf.start(before)
    estimate = filter_of(tuning).start(Senses(Odometry(before, STOP, True)), tuning)
    for command, odometry in drive(0):
        kf.step(command, odometry)
        z = odometry or before
        senses = Senses(Odometry(before, command, True)), Senses(Odometry(z, command, odometry is not None))
        estimate = filter_of(tuning).step(estimate, *senses, tuning, 0.05, INTEGRATORS[integrator])
        before = z
        assert kf.estimate == estimate
        assert (kf.belief, kf.nis) == (estimate.belief, estimate.nis)


@pytest.mark.parametrize(("name", "value"), [("integrator", "rk4"), *(("dt", dt) for dt in (0.0, -0.1, math.nan, math.inf))])
def test_bad_arguments_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        KalmanFilter(TUNING, **{name: value})


def test_a_covariance_is_that_of_the_pose_and_the_variances_of_the_twist():
    full = [[1, 2, 3, 0, 0], [2, 4, 5, 0, 0], [3, 5, 6, 0, 0], [0, 0, 0, 7, 0], [0, 0, 0, 0, 8]]
    assert matrix(Covariance(*range(1, 9))).tolist() == np.array(full)[:3, :3].tolist()
    assert covariance_of(np.array(full)) == tuple(range(1, 9))


def test_tunings_by_name():
    """Numbers of the preset rough: 0.02 rad, spikes of 0.3 rad in 2 %, half of the motion lost in slip."""
    known, gated = make_filter("matched", ROUGH), make_filter("gated", ROUGH)
    assert (known.kind, gated.kind) == (Kalman(**POSE_GATE), Gated(heading_gate=6.635, **POSE_GATE))
    assert known.R[2] == pytest.approx(0.02**2 + 0.02 * 0.3**2)
    assert gated.R[2] == 0.02**2
    assert gated.process == known.process
    assert known.process.alpha1 > 0.05  # what slip adds in the mean


def test_a_tuning_of_no_filter_is_refused():
    with pytest.raises(ValueError, match=r"FilterTuning\.kind must be one of"):
        filter_of(replace(TUNING, kind=ROUGH))
    with pytest.raises(ValueError, match="FilterTuning has no gate; it has Q, R"):
        make_filter({"Q": (0.0,) * 5, "R": (1.0,) * 3, "gate": 9.0}, ROUGH)
