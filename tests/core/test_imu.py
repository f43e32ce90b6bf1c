"""The gyro's numbers, what it is worth on wheels; its filter: `test_filters`."""

import math

import numpy as np
import pytest
from textbook import difference

from turtlebot_gym import Episode, make_parameters
from turtlebot_gym.systems.sensors import ImuNoise
from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP


def test_readings_have_the_stated_noise_bias_and_drift():
    """Standard errors are 7 % for 100 seeds: 36 % is more than five of them, a false alarm in a million."""
    for noise, first, last in (
        ({"variance": 0.04}, 0.2, 0.2),
        ({"bias_deviation": 0.3}, 0.3, 0.3),
        ({"bias_walk": 0.5}, 0.0, 0.5 * math.sqrt(2.0)),
    ):
        rows = []
        for seed in range(100):
            episode = Episode(make_parameters(imu=ImuNoise(**noise)), seed=seed)
            start = episode.world.senses.imu.omega
            for _ in range(20):
                episode.step(STOP)
            rows.append((start, episode.world.senses.imu.omega))
        assert np.std(rows, axis=0) == pytest.approx((first, last), rel=0.36)


def test_with_wheel_odometry_the_gyro_keeps_the_heading():
    """The wheels' heading drifts by slip of the turning rate, which the gyro measures; its bias was taken off before."""
    errors = []
    for options in ({}, {"filter": "gyro", "imu": ImuNoise(variance=1e-6, bias_deviation=1e-4)}):
        p, off = make_parameters("square", noise="wheel", **options), []
        for seed in range(10):
            episode = Episode(p, SQUARE_WAYPOINTS, seed=seed)
            for k in range(200):
                episode.act((0.9, 0.4 * math.sin(0.05 * k)))
            off.append(difference(episode.world.estimate.belief.mean.theta - episode.world.body.true_state.theta))
        errors.append(np.sqrt(np.mean(np.square(off))))
    assert errors[1] < 0.35 * errors[0]
