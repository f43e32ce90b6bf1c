"""The gate for the whole pose: no kind of spike costs a filter much, and nothing locks it out for ever."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from spiky import SPIKES, by_filter, by_peer, errors, spiky_drive

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
DRIVES = 6


@pytest.fixture(scope="module")
def drives():
    return {spike: [spiky_drive(NOISE, spike, seed, steps=200) for seed in range(DRIVES)] for spike in SPIKES}


def measured(run, drives):
    """Return position and heading RMSE and the mean NEES over drives; m, rad."""
    squares = np.mean([errors(truth, *run(twists, poses)) for twists, truth, poses in drives], axis=0)
    return math.sqrt(squares[0]), math.sqrt(squares[1]), squares[2]


@pytest.fixture(scope="module")
def peers(drives):
    """The better of two gates of the peer, by position and by heading."""
    tuning, found = make_filter("matched", NOISE), {}
    for spike in SPIKES:
        both = [measured(lambda *drive, at=at: by_peer(tuning, *drive, confidence=at), drives[spike]) for at in (0.99, 0.999)]
        found[spike] = np.min(both, axis=0)
    return found


def holds(name, spike, drives, peers, **rules):
    """Return whether a filter is as good as the peer under a kind of spike, and honest."""
    tuning = make_filter(name, NOISE)
    tuning = replace(tuning, kind=replace(tuning.kind, **rules))
    position, heading, nees = measured(lambda *drive: by_filter(tuning, *drive), drives[spike])
    return position <= 1.1 * peers[spike][0] and heading <= 1.1 * peers[spike][1] and nees <= 4.0


@pytest.mark.sample(4)
@pytest.mark.parametrize("spike", SPIKES)
@pytest.mark.parametrize("name", FILTERS)
def test_a_spike_costs_no_more_than_a_plain_gated_filter_of_filterpy(name, spike, drives, peers):
    assert holds(name, spike, drives, peers)


@pytest.mark.sample(3)
@pytest.mark.parametrize("spike", SPIKES)
def test_without_the_gate_for_the_pose_it_does(spike, drives, peers):
    assert not holds("matched", spike, drives, peers, gate=math.inf)


def steps_until_back(name, dt, away, **rules):
    """Return how many steps a filter stays away from poses that have leapt for good; None for ever."""
    tuning = make_filter(name, NOISE)
    kf = KalmanFilter(replace(tuning, kind=replace(tuning.kind, **rules)), dt=dt)
    kf.start(Pose(0.0, 0.0, 0.0))
    for _ in range(20):
        kf.step(Command(0.0, 0.0), Pose(0.0, 0.0, 0.0))
    for step in range(200):
        kf.step(Command(0.0, 0.0), away)
        if (
            math.hypot(kf.state[0] - away.x, kf.state[1] - away.y) + abs(math.remainder(kf.state[2] - away.theta, math.tau))
            < 0.02
        ):
            return step + 1
    return None


@pytest.mark.parametrize("away", [Pose(3.0, -1.0, 0.5), Pose(0.0, 0.0, math.pi - 1e-3)])
@pytest.mark.parametrize("dt", [0.02, 0.1, 0.5, 1.0])
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
    assert abs(kf.state[0]) < 0.01
    assert kf.rejections == 0
    kf.step(Command(0.0, 0.0), Pose(0.01, 0.0, 0.0))
    kf.step(Command(0.0, 0.0), Pose(0.5, 0.0, 0.0))  # one spike later it is refused
    assert abs(kf.state[0]) < 0.01
    assert kf.rejections == 1
