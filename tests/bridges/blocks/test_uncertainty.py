"""What the simulated odometry states of its error is what its error is."""

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.models.angles import wrap
from turtlebot_gym.presets import NOISES
from turtlebot_gym.values import Command, Odometry, Pose
from turtlebot_gym_ros.blocks import TurtlebotSimulator
from turtlebot_gym_ros.blocks.uncertainty import OdometryUncertainty

STEPS, RUNS = 60, 150
ALARM = 1e-4
"""Rate of false alarms of each statistical test here; seeds are fixed."""


def simulator(**parameters):
    return TurtlebotSimulator(TurtlebotSimulator.Params(**parameters))


def error_and_covariance(plant, command):
    """Return the error of the pose after a drive, shape (3,), and its stated covariance, shape (3, 3)."""
    for _ in range(STEPS):
        values = plant.step(0.1, command)
    truth, pose = values["truth"], values["odometry"].pose
    P = plant.outputs["odometry"].covariance()
    stated = np.array([[P.xx, P.xy, P.xt], [P.xy, P.yy, P.yt], [P.xt, P.yt, P.tt]])
    return np.array([pose.x - truth.x, pose.y - truth.y, wrap(pose.theta - truth.theta)]), stated


def normalized(noise, factor=1.0):
    """Return the sum of the squared errors of many drives, each by its stated covariance times a factor."""
    total, plant = 0.0, simulator(noise=noise, seed=4)
    for _ in range(RUNS):
        plant.reset()
        error, P = error_and_covariance(plant, Command(0.2, 0.3))
        total += error @ np.linalg.solve(factor * P, error)
    return total


@pytest.mark.sample(1)
@pytest.mark.parametrize("noise", ["tutorial", "wheel"])
def test_errors_are_as_large_as_stated(noise):
    """White noise, and drift that grows: the sum is chi-square with 3 degrees of freedom for each drive."""
    low, high = stats.chi2.interval(1.0 - ALARM, 3 * RUNS)
    assert low < normalized(noise) < high


@pytest.mark.sample(1)
@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_a_covariance_of_another_size_would_be_noticed(factor):
    low, high = stats.chi2.interval(1.0 - ALARM, 3 * RUNS)
    assert not low < normalized("wheel", factor) < high


@pytest.mark.parametrize("noise", NOISES)
def test_nothing_is_stated_to_be_certain(noise):
    plant = simulator(noise=noise)
    for _ in range(3):
        plant.step(0.1, None)
        P = plant.outputs["odometry"].covariance()
        assert min(P.xx, P.yy, P.tt, P.vv, P.ww) > 0.0


def test_the_twists_variances_by_hand():
    """At 0.1 m/s and 0.5 rad/s with the alphas of a Wifibot, per step of 0.1 s."""
    plant = simulator(noise="wheel")
    plant.step(0.1, None)
    plant.step(0.1, Command(0.1, 0.5))
    P = plant.outputs["odometry"].covariance()
    assert P.vv == pytest.approx(0.0029 * 0.01 + 0.0064 * 0.25)
    assert P.ww == pytest.approx(0.0062 * 0.01 + 0.0049 * 0.25)


def test_a_drift_grows_and_an_episode_begins_without_it():
    plant = simulator(noise="wheel")
    _, early = error_and_covariance(plant, Command(0.2, 0.0))
    _, late = error_and_covariance(plant, Command(0.2, 0.0))
    assert (np.diag(late) > 2.0 * np.diag(early)).all()
    assert late[1, 2] > 0.0  # a robot that has turned left has strayed to the left
    plant.reset()
    plant.step(0.1, None)
    assert plant.outputs["odometry"].covariance().xx == 1e-6  # (1 mm)^2


@pytest.mark.parametrize("dt", [0.05, 0.1, 0.2])
def test_white_noise_by_hand(dt):
    """What a wheel's error leaves below the filter's floors, 5 mm/s and 0.01 rad/s a step of 0.1 s, is stated as those."""
    uncertainty = OdometryUncertainty(NOISES["clean"], dt=dt, integrator=0.0)
    uncertainty.hear(Odometry(Pose(1.0, 2.0, 0.3), Command(0.1, 0.5), True))
    P = uncertainty.covariance()
    assert (P.vv, P.ww) == pytest.approx((2.5e-5 * dt / 0.1, 1e-4 * dt / 0.1))
    assert [P.xy, P.xt, P.yt] == [0.0] * 3
