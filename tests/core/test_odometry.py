"""Odometry: each of its errors on its own."""

import math
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment, measure, quantize
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym.values import Pose

POSE, WHEELS = Pose(1.0, -2.0, 3.0), Pose(0.5, -1.5, 2.5)


def read(noise, *, pose=POSE, position=(0.0, 0.0), heading=0.0, event=0.5):
    return measure(pose, WHEELS, noise, position, heading, event)


def test_headings_are_wrapped():
    assert read(OdometryNoise(bias=(0.0, 0.0, 0.5))).theta == pytest.approx(3.5 - 2.0 * math.pi)
    assert -math.pi <= read(OdometryNoise(quantization=(0.0, 1.0)), pose=Pose(0.0, 0.0, -3.1)).theta < math.pi


def test_quantization_rounds_to_the_nearest_multiple():
    for value in np.random.default_rng(0).uniform(-5.0, 5.0, 500).tolist():
        rounded = quantize(value, 0.01)
        assert abs(rounded - value) <= 0.005 + 1e-12
        assert rounded / 0.01 == pytest.approx(round(rounded / 0.01), abs=1e-9)
        assert quantize(value, 0.0) == value


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


# Numbers worked out by hand; nothing is symmetric in x, y and theta.

SPIKED = {"R": (0.04, 0.04, 0.04), "bias": (0.3, 0.3, 0.0), "spike_probability": 0.4, "spike": 0.6, "quantization": (0.5, 0.5)}


@pytest.mark.parametrize(
    ("noise", "pose", "draws", "expected"),
    [
        ({}, POSE, ((0.7, 0.7), 0.7, 0.7), POSE),
        # 1 + 0.1 + 0.2 * 0.5; 2 + 0.2 - 0.3 * 2; 0.5 + 0.3 + 0.4 * 0.25
        ({"R": (0.04, 0.09, 0.16), "bias": (0.1, 0.2, 0.3)}, (1.0, 2.0, 0.5), ((0.5, -2.0), 0.25, 0.7), (1.2, 1.6, 0.9)),
        ({"quantization": (0.25, 0.1)}, (1.3, -0.7, 0.44), ((0.0, 0.0), 0.0, 0.7), (1.25, -0.75, 0.4)),
        # Noise, bias and spike come before the rounding: 1.5 -> 1.5, 1.1 -> 1.0, 1.6 -> 1.5.
        (SPIKED, (1.0, 1.0, 1.0), ((1.0, -1.0), 0.0, 0.1), (1.5, 1.0, 1.5)),
        ({"wheel": True}, POSE, ((0.0, 0.0), 0.0, 0.5), WHEELS),
        ({"wheel": True, "R": (0.01,) * 3}, POSE, ((1.0, 0.0), 0.0, 0.5), (0.6, -1.5, 2.5)),
    ],
    ids=["none", "variances and biases", "resolutions", "in order", "wheels", "noise of wheels"],
)
def test_each_number_has_its_own_error(noise, pose, draws, expected):
    assert measure(Pose(*pose), WHEELS, OdometryNoise(**noise), *draws) == pytest.approx(expected, rel=1e-12)


def test_half_of_the_spikes_go_each_way():
    # With 0.4 in all: below 0.2 up, from 0.2 to below 0.4 down.
    noise = OdometryNoise(spike_probability=0.4, spike=0.7)
    turns = [read(noise, pose=Pose(0.0, 0.0, 0.0), event=event).theta for event in (0.01, 0.19, 0.2, 0.21, 0.39, 0.4, 0.41)]
    assert turns == [0.7, 0.7, -0.7, -0.7, -0.7, 0.0, 0.0]


def test_an_increment_by_hand():
    # The odometry goes 2 ahead and 1 to its left and turns by 0.3; the pose's frame is turned by 90 degrees against it.
    got = increment(Pose(5.0, 6.0, 2.0), Pose(1.0, 1.0, 0.4), Pose(3.0, 2.0, 0.7), (1.0, 0.0))
    assert got == pytest.approx((4.0, 8.0, 2.3), rel=1e-12)
    wrapped = increment(Pose(0.0, 0.0, 3.0), Pose(0.0, 0.0, 3.0), Pose(0.0, 0.0, 3.5), (0.0, 1.0))
    assert wrapped.theta == pytest.approx(3.5 - 6.283185307179586)


# Drop-outs, in the environment: whoever reads the odometry then has the last one, all of it.


def drive(noise, *, steps=40):
    """Return what the odometry was after each step, and the true poses, of a robot that drives in a circle."""
    world = gym.make("turtlebot_gym/TurtleBotSquare-v0", noise=noise)
    _, info = world.reset(seed=3)
    measured, true = [info["odometry"]], [info["true_state"]]
    for _ in range(steps):
        *_, info = world.step(np.array([0.5, 0.3], np.float32))
        measured.append(info["odometry"])
        true.append(info["true_state"])
    world.close()
    return np.array(measured), np.array(true)[:, :3]


def test_measurements_are_lost_whole_or_not_at_all_and_as_often_as_stated():
    # Without other noise what arrives is the true pose, and what does not is the one of the step before.
    measured, true = drive(Noise(odometry=OdometryNoise(dropout_probability=0.3)), steps=500)
    measured, true = measured[1:], true[1:]  # in the first step the robot has not moved yet
    kept = (measured[1:] == measured[:-1]).all(axis=1)
    np.testing.assert_array_equal(measured[1:][~kept], true[1:][~kept])
    assert (np.ptp(true, axis=0) > 0.1).all()  # else keeping and measuring were the same
    # binomial(499, 0.3): this fails for one seed in 10^4
    assert stats.binomtest(int(kept.sum()), 499, 0.3).pvalue > 1e-4
    assert stats.binomtest(int(kept.sum()), 499, 0.45).pvalue < 1e-4
