"""Presets: the tuning that is matched to a noise, by hand."""

import numpy as np
import pytest

from turtlebot_gym.parameters import DeadReckoning, Kalman, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import NOISES, ODOMETRY_LEAP, POSE_GATE, matched


def alphas(process):
    return process.alpha1, process.alpha2, process.alpha3, process.alpha4


@pytest.mark.parametrize("name", NOISES)
def test_the_matched_filter_knows_what_a_filter_can_know(name):
    tuning = matched(NOISES[name])
    assert list(tuning.Q) == pytest.approx([0.0, 0.0, 0.0, 2.5e-5, 1e-4], rel=1e-12)  # floors: 5 mm/s and 0.01 rad/s
    assert (tuning.process.slip, tuning.process.scale) == (0.0, 1.0)  # slip is in the alphas, a speed error is not known
    assert tuning.kind == (DeadReckoning(**ODOMETRY_LEAP) if NOISES[name].odometry.wheel else Kalman(**POSE_GATE))
    assert not tuning.from_origin


def test_the_matched_filter_counts_quantization_as_a_uniform_error_and_has_a_floor_for_each_number():
    # A step of 0.12 m: 0.12^2 / 12 = 0.0012 m^2. A step of 0.06 rad: 0.06^2 / 12 = 0.0003 rad^2. Spikes: 0.1 * 0.2^2 = 0.004.
    odometry = OdometryNoise(R=(0.01, 0.02, 0.03), quantization=(0.12, 0.06), spike_probability=0.1, spike=0.2)
    assert list(matched(Noise(odometry=odometry)).R) == pytest.approx([0.0112, 0.0212, 0.0343], rel=1e-12)
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
    assert alphas(matched(Noise(process=process)).process) == pytest.approx(counted, rel=1e-6)
