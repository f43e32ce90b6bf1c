"""Filters beside the bound: good filters reach it, and the comparison distinguishes a wrong filter from a right one."""

import math

import numpy as np
import pytest

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.parameters import DeadReckoning
from turtlebot_gym_lab.evaluation import estimation
from turtlebot_gym_lab.evaluation.bound import cramer_rao_bound, heading_information, true_tuning
from turtlebot_gym_lab.evaluation.estimation import estimate

pytestmark = pytest.mark.touched("lab", "tests/lab")


@pytest.mark.nightly
def test_a_matched_filter_reaches_the_bound_and_is_consistent_and_a_wrong_one_is_not():
    result = estimate(["matched", "tutorial"], noise="tutorial", runs=1500)
    right, wrong = result.filters["matched"], result.filters["tutorial"]
    low, high = result.band
    assert (low, high) == pytest.approx((2.877, 3.125), abs=0.002)  # chi-square with 4500 degrees of freedom, over 1500
    assert low < right.nees.value < high
    assert not low < wrong.nees.value < high
    assert all(0.93 < ratio.value < 1.05 for ratio in right.ratio)
    assert min(ratio.value for ratio in wrong.ratio) > 2.0


def test_a_bias_can_be_left_out():
    both = (estimate(["matched"], noise="documented", runs=300, bias=bias) for bias in (True, False))
    with_bias, without = (result.filters["matched"] for result in both)
    assert with_bias.ratio[0].value > 1.8
    assert without.ratio[0].value < 1.15
    assert with_bias.ratio[1].value == pytest.approx(without.ratio[1].value, rel=0.02)


def test_wheels_alone_drift_as_the_filter_says():
    result = estimate(["matched"], noise="wheel", runs=1000)
    matched, (low, high) = result.filters["matched"], result.band
    assert low < matched.nees.value < high
    assert all(0.9 < ratio.value < 1.1 for ratio in matched.ratio)
    assert (np.diff(result.bound[2:], axis=0) > 0.0).all()  # nothing corrects it


def test_drives_do_not_depend_on_the_batch_and_a_bound_of_zero_gives_an_infinite_ratio(monkeypatch):
    together = estimate(["matched"], noise="clean", runs=20)
    assert (together.bound == 0.0).all()
    assert together.filters["matched"].ratio[0].value == math.inf
    alone = estimate(["matched"], runs=20)
    monkeypatch.setattr(estimation, "BATCH", 10)
    assert estimate(["gated", "matched"], runs=20).bound[0] == pytest.approx(alone.bound[0])


def test_missing_measurements_widen_the_bound():
    states, commands = np.zeros((4, 11, 5)), np.tile([0.2, 0.1], (4, 10, 1))
    tuning = true_tuning(Noise(process=ProcessNoise(alpha1=0.02, alpha4=0.02), odometry=OdometryNoise(R=(0.01, 0.01, 0.01))))
    always = cramer_rao_bound(states, commands, tuning)
    never = cramer_rao_bound(states, commands, tuning, measured=np.zeros((4, 10), bool))
    half = cramer_rao_bound(states, commands, tuning, measured=np.arange(40).reshape(4, 10) % 2 == 0)
    for k in range(3):
        assert always[-1, k, k] < half[-1, k, k] < never[-1, k, k]
    np.testing.assert_array_equal(always[0], never[0])


def test_the_true_noise_has_no_floors():
    noise = Noise(
        process=ProcessNoise(alpha1=0.01, scale=1.02, slip=0.5, slip_start=0.1, slip_end=0.3),
        odometry=OdometryNoise(
            R=(0.01, 0.02, 0.03), bias=(1.0, 1.0, 1.0), spike_probability=0.1, spike=0.6, quantization=(0.12, 0.06)
        ),
    )
    tuning = true_tuning(noise)
    assert tuning.Q == (0.0,) * 5
    assert tuning.R[:2] == pytest.approx((0.01 + 0.0012, 0.02 + 0.0012))
    assert tuning.R[2] == pytest.approx(1.0 / heading_information(noise.odometry) + 0.0003)
    assert (tuning.process.alpha1, tuning.process.scale, tuning.process.slip) == (0.01, 1.0, 0.0)
    assert true_tuning(Noise()).R == (0.0, 0.0, 0.0)
    assert true_tuning(Noise(odometry=OdometryNoise(wheel=True))).kind == DeadReckoning()
