"""Filters beside the bound: good filters reach it, and the comparison distinguishes a wrong filter from a right one."""

import json
import math

import numpy as np
import pytest

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, make_filter
from turtlebot_gym.parameters import DeadReckoning
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_lab.evaluation import estimation
from turtlebot_gym_lab.evaluation.bound import cramer_rao_bound, heading_information, true_tuning
from turtlebot_gym_lab.evaluation.estimation import estimate, innovations

pytestmark = pytest.mark.touched("lab", "tests/lab")


@pytest.mark.nightly
def test_a_matched_filter_reaches_the_bound_and_is_consistent_and_a_wrong_one_is_not():
    result = estimate(["matched", "tutorial"], noise="tutorial", runs=1500)
    right, wrong = result.filters["matched"], result.filters["tutorial"]
    low, high = result.band
    assert (low, high) == pytest.approx((2.877, 3.125), abs=0.002)  # chi-square with 4500 degrees of freedom, over 1500
    assert low < right.nees.value < high
    assert not low < wrong.nees.value < high
    assert right.nis.value == pytest.approx(3.0, abs=0.2)
    assert right.outside == pytest.approx(0.008, abs=0.003)
    assert max(map(abs, right.correlation)) < 0.05
    assert max(map(abs, wrong.correlation)) > 0.15
    for ratio in right.ratio:
        assert 0.93 < ratio.value < 1.05
        assert ratio.low < ratio.value < ratio.high
    assert min(ratio.value for ratio in wrong.ratio) > 2.0
    assert result.time[-1] == pytest.approx(3.0)
    assert right.rmse.shape == result.bound.shape == (31, 3)
    assert right.ratio[0].value == pytest.approx(right.rmse[-1, 0] / result.bound[-1, 0])


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


@pytest.mark.nightly
def test_drives_depend_neither_on_the_filter_nor_on_the_batch(monkeypatch):
    alone = estimate(["matched"], runs=30, seconds=1.0)
    both = estimate(["gated", "matched"], runs=30, seconds=1.0)
    np.testing.assert_array_equal(alone.bound, both.bound)
    np.testing.assert_array_equal(alone.filters["matched"].rmse, both.filters["matched"].rmse)
    monkeypatch.setattr(estimation, "BATCH", 10)
    ended = []
    several = estimate(["matched", "gated"], runs=30, seconds=1.0, progress=ended.append)
    assert ended == [5, 10, 15, 20, 25, 30]
    assert several.bound[0] == pytest.approx(alone.bound[0])


def test_a_bound_of_zero_gives_an_infinite_ratio(tmp_path):
    result = estimate(["matched"], noise="clean", runs=5, seconds=0.5)
    assert (result.bound == 0.0).all()
    assert result.filters["matched"].ratio[0].value == math.inf


def test_innovations_are_measured_minus_predicted():
    noise = Noise(odometry=OdometryNoise(R=(0.01, 0.01, 0.01), dropout_probability=0.3))
    drives = estimation.drive(3, 20, 7, noise=noise, filter=make_filter("matched", noise))
    measured = innovations(drives, 0.1, 0.0)
    lost = ~drives.measured[:, 1:]
    assert 5 < lost.sum() < 40
    assert np.isnan(measured[lost]).all()
    run, k = np.argwhere(~lost)[10]
    x, y, theta, v, omega = drives.estimate[run, k]
    z = drives.odometry[run, k + 1]
    turn = (z[2] - theta - 0.1 * omega + math.pi) % (2.0 * math.pi) - math.pi
    expected = (z[0] - x - 0.1 * v * math.cos(theta), z[1] - y - 0.1 * v * math.sin(theta), turn)
    np.testing.assert_allclose(measured[run, k], expected, atol=1e-12)


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
    assert 0.03 < tuning.R[2] < 0.03 + 0.1 * 0.36
    assert (tuning.process.alpha1, tuning.process.scale, tuning.process.slip) == (0.01, 1.0, 0.0)
    assert true_tuning(Noise()).R == (0.0, 0.0, 0.0)
    assert true_tuning(Noise(odometry=OdometryNoise(wheel=True))).kind == DeadReckoning()


def test_the_command_line_prints_a_table_and_writes_files(capsys, tmp_path):
    files = tmp_path / "result.json", tmp_path / "result.png"
    argv = ["estimate", "--noise", "rough", "--filter", "matched", "gated", "--runs", "40", "--no-bias"]
    assert main([*argv, "--json", str(files[0]), "--plot", str(files[1])]) == 0
    shown = capsys.readouterr().out
    assert "matched" in shown
    assert "bound" in shown
    written = json.loads(files[0].read_text())
    assert written["config"]["bias"] is False
    assert set(written["filters"]) == {"matched", "gated"}
    assert len(written["bound"]) == 31
    assert written["band"][0] < 3.0 < written["band"][1]
    assert files[1].stat().st_size > 10_000
