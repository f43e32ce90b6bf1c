"""The robot: its limits, how it executes commands and how it moves."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.models.unicycle import INTEGRATORS, accelerate, advance, execute, execution_variances, expected, limit, slips
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import Command, Pose

EULER, MIDPOINT = INTEGRATORS["euler"], INTEGRATORS["midpoint"]
COMMANDS = [Command(*row) for row in np.random.default_rng(0).uniform(-4.0, 4.0, (500, 2)).tolist()]


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_limit_holds_every_limit_and_the_curvature(robot):
    for command in COMMANDS:
        limited = limit(command, robot)
        v, omega = abs(limited.v), abs(limited.omega)
        assert v <= robot.max_linear * (1.0 + 1e-15)
        assert omega <= robot.max_angular * (1.0 + 1e-15)
        assert v + omega * robot.wheel_separation / 2.0 <= robot.max_wheel * (1.0 + 1e-15)
        # On the same path, in the same direction, and no slower than it must be.
        assert limited.v * command.omega == pytest.approx(limited.omega * command.v, abs=1e-15)
        assert limited.v * command.v >= 0.0
        again = limit(limited, robot)
        assert again == pytest.approx(limited, rel=1e-15)
        wheel = (v + omega * robot.wheel_separation / 2.0) / robot.max_wheel
        assert limited == command or max(v / robot.max_linear, omega / robot.max_angular, wheel) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("changes", "given", "expected"),
    [
        # The outer wheel would run at 0.2108 + 2.635 * 0.08 = 0.4216 m/s, and may at 0.2097.
        ({}, (0.2108, 2.635), (0.2097 / 2.0, 2.635 * 0.2097 / 0.4216)),
        ({"max_wheel": math.inf}, (0.2108, 2.635), (0.2108, 2.635)),
        ({"reverse": False}, (-0.2, 1.0), (0.0, 1.0)),  # turns where it stands
        ({"reverse": False}, (0.1, 1.0), (0.1, 1.0)),
    ],
)
def test_limits_by_hand(changes, given, expected):
    assert limit(Command(*given), replace(ROBOTS["burger"], **changes)) == pytest.approx(expected)


def test_acceleration_is_limited_both_ways_and_reaches_its_aim():
    robot = replace(ROBOTS["burger"], max_linear_acceleration=0.5, max_angular_acceleration=3.0)
    command, seen = Command(0.0, 0.0), []
    for _ in range(10):
        command = accelerate(command, Command(0.2, -1.0), robot, 0.1)
        seen.append(command)
    assert seen[0] == pytest.approx((0.05, -0.3))
    assert seen[3:] == [(pytest.approx(0.2), pytest.approx(-1.0))] * 7
    assert accelerate(command, Command(0.0, 0.0), robot, 0.1) == pytest.approx((0.15, -0.7))
    assert accelerate(command, Command(-9.0, 9.0), ROBOTS["burger"], 0.1) == (-9.0, 9.0)  # infinite: at once


@pytest.mark.parametrize(("middle", "order"), [(EULER, 1), (MIDPOINT, 2)])
def test_integrators_converge_to_the_arc_with_their_orders(middle, order):
    v, omega, radius, errors = 0.2, 0.7, 0.2 / 0.7, []
    exact = [radius * (math.sin(1.7) - math.sin(0.3)), radius * (math.cos(0.3) - math.cos(1.7)), 1.7]
    for steps in (20, 40, 80):
        pose = Pose(0.0, 0.0, 0.3)
        for _ in range(steps):
            pose = advance(pose, v, omega, 2.0 / steps, middle)
        errors.append(np.abs(np.array(pose) - exact))
    coarse, half, fine = (error[:2].max() for error in errors)
    assert [np.log2(coarse / half), np.log2(half / fine)] == pytest.approx([order, order], abs=0.1)
    assert errors[0].max() < (1e-3 if order == 2 else 0.1)


def test_integrators_agree_on_straight_lines_and_turns_on_the_spot():
    for v, omega in ((0.2, 0.0), (0.0, 1.5), (-0.1, 0.0)):
        assert advance(Pose(1.0, 2.0, 0.5), v, omega, 0.1, EULER) == advance(Pose(1.0, 2.0, 0.5), v, omega, 0.1, MIDPOINT)
    assert advance(Pose(1.0, 2.0, 3.1), 0.2, 1.0, 0.1, EULER) == pytest.approx(
        (1.0 + 0.02 * math.cos(3.1), 2.0 + 0.02 * math.sin(3.1), 3.2 - 2.0 * math.pi)
    )


ALPHAS = ProcessNoise(alpha1=0.02, alpha2=0.003, alpha3=0.4, alpha4=0.05)


def test_execution_noise_is_that_of_the_velocity_motion_model():
    var_v, var_omega = execution_variances(Command(0.2, -1.5), ALPHAS, 0.1)
    assert var_v == pytest.approx(0.02 * 0.04 + 0.003 * 2.25)
    assert var_omega == pytest.approx(0.4 * 0.04 + 0.05 * 2.25)
    executed = execute(Command(0.2, -1.5), ALPHAS, False, (2.0, -1.0), 0.1)
    assert executed == pytest.approx((0.2 + 2.0 * math.sqrt(var_v), -1.5 - math.sqrt(var_omega)))
    assert execute(Command(0.0, 0.0), ALPHAS, False, (3.0, 3.0), 0.1) == (0.0, 0.0)
    slipping = execute(Command(0.2, -1.5), replace(ALPHAS, slip=0.4), True, (2.0, -1.0), 0.1)
    assert slipping == pytest.approx((0.6 * executed.v, 0.6 * executed.omega))
    wheels = replace(ALPHAS, scale=1.1, turn_scale=0.5, veer=0.3)
    assert execute(Command(0.2, -1.5), wheels, False, (2.0, -1.0), 0.1) == pytest.approx(
        (1.1 * executed.v, 1.1 * (0.5 * executed.omega + 0.3 * 0.2))
    )
    mean, *variances = expected(Command(0.2, -1.5), wheels, 0.1)
    assert mean == pytest.approx((0.22, 1.1 * (-0.75 + 0.06)))
    assert variances == pytest.approx((1.1**2 * var_v, 0.55**2 * var_omega))


def spread(dt, runs=1500, metres=2.0):
    """Return the variance of the distance covered after some metres of noisy driving, in steps of dt."""
    rng = np.random.default_rng(int(1000 * dt))
    command, steps = Command(0.2, 0.0), round(metres / 0.2 / dt)
    draws = rng.normal(size=(runs, steps)).tolist()
    distances = [sum(execute(command, ALPHAS, False, (draw, 0.0), dt).v for draw in run) * dt for run in draws]
    return np.var(distances)


def test_drift_per_metre_does_not_depend_on_the_control_rate():
    # The variance over n runs is chi2(n) / n of the true one, alpha1 v^2 (0.1 s)^2 per 0.1 s: two tests of 10^-4.
    expected = 0.02 * 0.04 * 0.1**2 * 100
    low, high = np.divide(stats.chi2.interval(1.0 - 1e-4, df=1500), 1500)
    for dt in (0.05, 0.2):
        assert low < spread(dt) / expected < high
    assert not low < 2.0 < high  # what leaving dt out of the variance would give at 0.2 s


@pytest.mark.parametrize("dt", [0.05, 0.1])
def test_bursts_of_slip_last_as_long_as_stated(dt):
    """The chain's share of time and its bursts' mean length do not depend on dt."""
    chain = ProcessNoise(slip=0.5, slip_start=0.02, slip_end=0.1)
    draws = np.random.default_rng(3).random(200_000).tolist()
    states, slipping = [], False
    for draw in draws:
        slipping = slips(slipping, chain, draw, dt)
        states.append(slipping)
    starts = int(np.sum(np.diff(np.array(states, int)) == 1))
    # Bursts are geometric with mean 0.1 s / slip_end: the mean of n of them is normal with relative deviation below n^-1/2.
    bound = stats.norm.isf(0.5e-4) / math.sqrt(starts)
    assert sum(states) * dt / starts == pytest.approx(1.0, rel=bound)
    assert np.mean(states) == pytest.approx(0.02 / 0.12, rel=2.0 * bound)
    assert not any(slips(False, ProcessNoise(), draw, dt) for draw in (1e-12, 0.5, 1.0 - 1e-12))
