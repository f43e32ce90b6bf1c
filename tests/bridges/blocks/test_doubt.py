"""Ten faults of a filter's model are named within ten seconds of driving, and simulated noise is never taken for one."""

import math
import random
from dataclasses import replace

import pytest

from turtlebot_gym import write_parameters
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.estimation.doubt import INNOVATIONS, WINDOW, Doubt
from turtlebot_gym.estimation.filters import KalmanFilter
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.parameters import DeadReckoning
from turtlebot_gym.presets import make_filter, make_noise
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import STOP, Command, Pose
from turtlebot_gym_ros.blocks import TurtlebotSimulator

BURGER, DT = ROBOTS["burger"], 0.1


def world(odometry, history):
    (_, _, theta), (v, omega) = odometry.pose, odometry.twist
    return odometry._replace(twist=Command(v * math.cos(theta), omega))


def twisted(change):
    return lambda odometry, history: odometry._replace(twist=Command(*change(*odometry.twist)))


def posed(change):
    return lambda odometry, history: odometry._replace(pose=Pose(*change(*odometry.pose)))


def second(odometry, history):
    return posed(lambda x, y, theta: (x + 1.0, y, theta))(odometry, history) if len(history) % 2 else odometry


FAULTS = {
    "frame": (world, "the twist is in the world's frame"),
    "sign": (twisted(lambda v, omega: (v, -omega)), "sign"),
    "unit": (twisted(lambda v, omega: (v, math.degrees(omega))), "in degrees/s?"),
    "scale": (twisted(lambda v, omega: (1.2 * v, omega)), "times as far as the speed says"),
    "lag": (lambda odometry, history: odometry._replace(pose=history[max(0, len(history) - 4)].pose), "s late"),
    "noise": (None, "times its variance: is R too small"),
    "axes": (posed(lambda x, y, theta: (y, x, theta)), "as if x and y were swapped"),
    "interval": (lambda odometry, history: odometry, "times as f"),
    "bias": (twisted(lambda v, omega: (v, omega + 0.1)), "has the gyro a bias?"),
    "second source": (second, "are there two sources?"),
}
"""What each fault makes of odometry and all that came before, and what is said of it."""


def driven(noise, seconds, *, fault=None, filter="matched", seed=0, folder=None):
    """Return what is said of a robot that drives to random goals on its estimate."""
    change, _ = FAULTS.get(fault, (None, ""))
    assumed = make_noise(noise)
    if fault == "noise":
        odometry = replace(assumed.odometry, R=tuple(9.0 * R for R in assumed.odometry.R))
        write_parameters(replace(assumed, odometry=odometry), folder / "noise.yaml")
        noise = str(folder / "noise.yaml")
    plant = TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, seed=seed, period=DT))
    tuning, rng, command, goal, history = make_filter(filter, assumed), random.Random(seed), STOP, (1.0, 1.0), []
    estimator, agreement = KalmanFilter(tuning, dt=DT, integrator="euler"), Agreement(BURGER, assumed)
    doubt, said = Doubt(assumed, degrees=0 if isinstance(tuning.kind, DeadReckoning) else 3), set()
    astray = -math.inf  # the step in which the filter was last wrong by more than it states
    estimator.dt = interval = 2.0 * DT if fault == "interval" else DT
    for k in range(round(seconds / DT)):
        moved = plant.step(DT, command)
        history.append(moved["odometry"])
        heard = change(history[-1], history) if change else history[-1]
        if k:
            estimator.step(heard.twist, heard.pose if heard.measured else None)
        else:
            estimator.start(heard.pose)
        said.add(agreement.judge(interval, heard, command) and agreement.cause)
        (mean, P), truth, doubts = estimator.belief, moved["truth"], doubt.add(interval, heard, estimator.nis).cause
        if abs(wrap(mean.theta - truth.theta)) > 6.0 * math.sqrt(P.tt) + 0.05:
            astray = k
        if not (doubts.startswith(INNOVATIONS) and (k - astray) * DT < 3.0 * WINDOW):  # then it is right
            said.add(doubts)
        if k % 300 == 0 or math.hypot(goal[0] - mean.x, goal[1] - mean.y) < 0.3:
            goal, gain = (rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0)), rng.choice((1.5, 1.5, 6.0))
        turn = wrap(math.atan2(goal[1] - mean.y, goal[0] - mean.x) - mean.theta)
        command = limit(Command(0.21 * max(0.0, math.cos(turn)), gain * turn), BURGER)
        history = history[-8:] if len(history) > 16 else history
    return said - {""}


@pytest.mark.sample(6)
@pytest.mark.parametrize("noise", ["documented", "wheel"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_within_ten_seconds_of_driving(noise, fault, tmp_path):
    """On four of five drives at least; noise of wheel odometry is nothing that a filter without corrections could doubt."""
    if (noise, fault) == ("wheel", "noise"):
        pytest.skip("Dead reckoning assumes no noise of the pose.")
    said = [driven(noise, 10.0, fault=fault, seed=seed, folder=tmp_path) for seed in range(5)]
    assert sum(any(FAULTS[fault][1] in each for each in drive) for drive in said) >= 4, said


SUITED = [("wheel", "matched"), ("documented", "matched"), ("tutorial", "matched"), ("rough", "mixture"), ("rough", "slip")]


@pytest.mark.sample(2)
@pytest.mark.parametrize("seconds", [120.0, pytest.param(600.0, marks=pytest.mark.nightly)])
@pytest.mark.parametrize(("noise", "filter"), SUITED)
def test_simulated_noise_is_no_fault(noise, filter, seconds):
    """For two minutes, and for ten at night; for ten hours see below."""
    assert driven(noise, seconds, filter=filter) == set()


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "filter"), [*SUITED, ("clean", "matched"), ("documented", "gated"), ("rough", "gated")])
def test_ten_hours_of_simulated_noise_are_no_fault(noise, filter):
    assert driven(noise, 36000.0, filter=filter, seed=1) == set()
