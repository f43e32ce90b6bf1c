"""The gate for the whole pose: a leap is refused, and nothing locks the filter out for ever."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from turtlebot_gym import make_filter
from turtlebot_gym.estimation.filters import KalmanFilter, filter_of
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym.presets import POSE_GATE, WHEEL
from turtlebot_gym.systems.imu import IMUS, Imu
from turtlebot_gym.values import STOP, Command, Odometry, Pose, senses_of

Read = senses_of(("odometry", "imu"))

NOISE = Noise(process=WHEEL.process, odometry=OdometryNoise(R=(0.05**2, 0.05**2, 0.05**2)))
"""Wheels as recorded, and a sensor of the pose."""
FILTERS = ("matched", "calibrated", "gated")


def steps_until_back(name, dt, away, **rules):
    """Return how many steps a filter stays away from poses that have leapt for good; None for ever."""
    tuning = make_filter(name, NOISE)
    kf = KalmanFilter(replace(tuning, kind=replace(tuning.kind, **rules)), dt=dt)
    kf.start(Pose(0.0, 0.0, 0.0))
    for _ in range(20):
        kf.step(Command(0.0, 0.0), Pose(0.0, 0.0, 0.0))
    for step in range(200):
        kf.step(Command(0.0, 0.0), away)
        x, y, theta, *_ = kf.belief.mean
        if math.hypot(x - away.x, y - away.y) + abs(math.remainder(theta - away.theta, math.tau)) < 0.02:
            return step + 1
    return None


@pytest.mark.parametrize("away", [Pose(3.0, -1.0, 0.5), Pose(0.0, 0.0, math.pi - 1e-3)])
@pytest.mark.parametrize("dt", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("name", FILTERS)
def test_a_leap_that_stays_is_believed_after_a_second_or_three_measurements(name, dt, away):
    assert steps_until_back(name, dt, away) == pytest.approx(max(3, POSE_GATE["lockout"] / dt), abs=1)


@pytest.mark.parametrize("gate", [POSE_GATE["gate"], math.inf])
def test_the_filter_of_a_gyro_refuses_a_leap_too(gate):
    tuning = make_filter("gyro", NOISE, imu=IMUS["calibrated"])
    tuning = replace(tuning, kind=replace(tuning.kind, gate=gate))
    start, step, *_ = filter_of(tuning)
    senses = [Read(Odometry(Pose(x, 0.0, 0.0), STOP, True), Imu(0.0, 0.0)) for x in (0.0, 0.0, 0.0, 0.5)]
    estimate = start(senses[0], tuning)
    for before, now in pairwise(senses):
        estimate = step(estimate, before, now, tuning, 0.1, 0.0)
    assert (abs(estimate.belief.mean.x) < 1e-6) == (gate < math.inf)
    for _ in range(10):
        estimate = step(estimate, senses[-1], senses[-1], tuning, 0.1, 0.0)
    assert abs(estimate.belief.mean.x - 0.5) < 0.15


def test_a_filter_that_may_refuse_for_ever_does():
    assert steps_until_back("matched", 0.1, Pose(3.0, -1.0, 0.5), max_rejections=10**6) is None


@pytest.mark.parametrize("name", FILTERS)
def test_a_spike_in_the_first_measurement_is_given_up_for_the_second(name):
    kf = KalmanFilter(make_filter(name, NOISE))
    kf.start(Pose(0.5, 0.0, 0.0))
    kf.step(Command(0.0, 0.0), Pose(0.0, 0.0, 0.0))
    assert abs(kf.belief.mean[0]) < 0.01
    assert kf.estimate.rejections <= 0
    kf.step(Command(0.0, 0.0), Pose(0.01, 0.0, 0.0))
    kf.step(Command(0.0, 0.0), Pose(0.5, 0.0, 0.0))  # one spike later it is refused
    assert abs(kf.belief.mean[0]) < 0.01
    assert kf.estimate.rejections == 1
