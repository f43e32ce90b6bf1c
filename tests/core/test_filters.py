"""Tunings by name, and the filter as an object; algebra: `test_textbook_filter`."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.estimation.filters import KalmanFilter, covariance_of, filter_of, matrix
from turtlebot_gym.parameters import Gated, Kalman
from turtlebot_gym.presets import DOCUMENTED, POSE_GATE, ROUGH, make_filter, matched
from turtlebot_gym.values import STOP, Command, Covariance, Odometry, Pose, Senses

TUNING = matched(DOCUMENTED)


@pytest.mark.parametrize("name", ["matched", "gated", "tutorial"])
def test_steps_of_the_object_are_those_of_the_function(name):
    tuning, z, command = make_filter(name, ROUGH), Pose(0.3, 0.2, 0.1), Command(0.2, 0.5)
    kf, (start, step, *_) = KalmanFilter(tuning, integrator="midpoint", dt=0.05), filter_of(tuning)
    kf.start(z)
    estimate = start(Senses(Odometry(z, STOP, True)), tuning)
    for k in range(20):
        before, z = z, z if k % 4 == 2 else Pose(0.01 * k, 0.2, 0.3)
        kf.step(command, None if k % 4 == 2 else z)
        senses = (Senses(Odometry(pose, command, k % 4 != 2)) for pose in (before, z))
        estimate = step(estimate, *senses, tuning, 0.05, 0.5)
        assert kf.estimate == estimate
        assert (kf.belief, kf.nis) == (estimate.belief, estimate.nis)
    for name, value in (("dt", 0.0), ("dt", float("nan")), ("integrator", "rk4")):
        with pytest.raises(ValueError, match=name):
            KalmanFilter(tuning, **{name: value})


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
