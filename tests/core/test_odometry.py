"""Odometry: each of its errors on its own."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment, measure, quantize
from turtlebot_gym.parameters import OdometryNoise
from turtlebot_gym.values import Pose

POSE, WHEELS = Pose(1.0, -2.0, 3.0), Pose(0.5, -1.5, 2.5)


def read(noise, *, pose=POSE, position=(0.0, 0.0), heading=0.0, event=0.5):
    return measure(pose, WHEELS, noise, position, heading, event)


def test_without_noise_it_is_the_pose():
    assert read(OdometryNoise()) == POSE


def test_white_noise_has_the_stated_variances():
    assert read(OdometryNoise(R=(0.04, 0.09, 0.01)), position=(1.0, -1.0), heading=1.0) == pytest.approx((1.2, -2.3, 3.1))


def test_bias_is_added():
    assert read(OdometryNoise(bias=(0.02, -0.01, 0.1))) == pytest.approx((1.02, -2.01, 3.1))


@pytest.mark.parametrize(("event", "expected"), [(0.009, 0.3), (0.011, -0.3), (0.019, -0.3), (0.021, 0.0), (0.99, 0.0)])
def test_spikes_come_with_their_probability_and_equal_signs(event, expected):
    noise = OdometryNoise(spike_probability=0.02, spike=0.3)
    assert read(noise, pose=Pose(0.0, 0.0, 0.0), event=event).theta == pytest.approx(expected)


def test_headings_are_wrapped():
    theta = read(OdometryNoise(bias=(0.0, 0.0, 0.5))).theta
    assert theta == pytest.approx(3.5 - 2.0 * math.pi)
    assert -math.pi <= read(OdometryNoise(quantization=(0.0, 1.0)), pose=Pose(0.0, 0.0, -3.1)).theta < math.pi


def test_quantization_rounds_to_the_nearest_multiple():
    for value in np.random.default_rng(0).uniform(-5.0, 5.0, 500).tolist():
        rounded = quantize(value, 0.01)
        assert abs(rounded - value) <= 0.005 + 1e-12
        assert rounded / 0.01 == pytest.approx(round(rounded / 0.01), abs=1e-9)
        assert quantize(value, 0.0) == value
    assert read(OdometryNoise(quantization=(0.5, 0.25)), pose=Pose(1.2, -2.3, 1.1)) == pytest.approx((1.0, -2.5, 1.0))


def test_wheels_are_read_instead_of_the_pose():
    assert read(OdometryNoise(wheel=True)) == WHEELS
    assert read(OdometryNoise(wheel=True, R=(0.01,) * 3), position=(1.0, 0.0)) == pytest.approx((0.6, -1.5, 2.5))


def test_increments_carry_a_pose_along_whatever_the_frame():
    """Moving by increments equals moving in the frame of the odometry, for any offset between the frames."""
    rng = np.random.default_rng(1)
    offset = Pose(0.7, -0.4, 2.0)
    path = [Pose(*row) for row in np.cumsum(rng.uniform(-0.3, 0.3, (50, 3)), axis=0).tolist()]

    def placed(pose):
        sine, cosine = sincos(offset.theta)
        x, y = cosine * pose.x - sine * pose.y, sine * pose.x + cosine * pose.y
        return Pose(offset.x + x, offset.y + y, offset.theta + pose.theta)

    pose = placed(path[0])
    for before, after in pairwise(path):
        pose = increment(pose, before, after, sincos(pose.theta - before.theta))
        expected = placed(after)
        assert pose[:2] == pytest.approx(expected[:2], abs=1e-12)
        assert math.remainder(pose.theta - expected.theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
