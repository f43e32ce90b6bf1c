"""The models: angles, draws, the robot's limits, execution and motion, and each error of odometry."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from turtlebot_gym.estimation.filters import FilterObject
from turtlebot_gym.models import random
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import counted, measure, sense
from turtlebot_gym.models.random import _log_unit, episode_key, normals, uniforms
from turtlebot_gym.models.unicycle import INTEGRATORS, accelerate, advance, execute, execution_variances, expected, limit, slips
from turtlebot_gym.parameters import OdometryNoise, ProcessNoise
from turtlebot_gym.presets import WHEEL, matched
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import STOP, Command, Odometry, Pose

EDGES = [k * math.pi / 4.0 for k in range(-16, 17)]
NEAR = [math.nextafter(edge, side) for edge in EDGES for side in (-math.inf, math.inf)]
RANDOM = np.random.default_rng(0).uniform(-50.0, 50.0, 20_000).tolist()


@pytest.mark.parametrize("angles", [EDGES, NEAR, RANDOM], ids=["edges", "beside the edges", "random"])
def test_wrap_stays_in_its_interval_and_on_the_circle(angles):
    for angle in angles:
        wrapped = wrap(angle)
        assert -math.pi <= wrapped < math.pi
        assert math.remainder(wrap(wrapped) - wrapped, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-15)
        turns = (angle - wrapped) / (2.0 * math.pi)
        assert turns == pytest.approx(round(turns), abs=1e-14)


@pytest.mark.parametrize("reach", [math.pi / 4.0, math.pi, 50.0, 1e4, 99_999.0])
def test_sincos_is_accurate_and_at_the_edges_of_its_quadrants_within_1(reach):
    angles = [*np.random.default_rng(1).uniform(-reach, reach, 20_000).tolist(), *EDGES, *NEAR, 0.0, 5e-324, 1e-9]
    ours = np.array([sincos(angle) for angle in angles])
    np.testing.assert_allclose(ours, np.stack([np.sin(angles), np.cos(angles)], axis=1), rtol=0.0, atol=3e-16)
    assert np.abs(ours).max() <= 1.0


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


def test_limits_by_hand():
    burger = ROBOTS["burger"]  # the outer wheel would run at 0.2108 + 2.635 * 0.08 = 0.4216 m/s, and may at 0.2097
    assert limit(Command(0.2108, 2.635), burger) == pytest.approx((0.2097 / 2.0, 2.635 * 0.2097 / 0.4216))
    assert limit(Command(-0.2, 1.0), replace(burger, reverse=False)) == (0.0, 1.0)  # turns where it stands


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


@pytest.mark.parametrize(("integrator", "order"), [(EULER, 1), (MIDPOINT, 2)])
def test_integrators_converge_to_the_arc_with_their_orders(integrator, order):
    v, omega, radius, errors = 0.2, 0.7, 0.2 / 0.7, []
    exact = [radius * (math.sin(1.7) - math.sin(0.3)), radius * (math.cos(0.3) - math.cos(1.7)), 1.7]
    for steps in (20, 40, 80):
        pose = Pose(0.0, 0.0, 0.3)
        for _ in range(steps):
            pose = advance(pose, v, omega, 2.0 / steps, integrator)
        errors.append(np.abs(np.array(pose) - exact))
    coarse, half, fine = (error[:2].max() for error in errors)
    assert [np.log2(coarse / half), np.log2(half / fine)] == pytest.approx([order, order], abs=0.1)
    assert errors[0].max() < (1e-3 if order == 2 else 0.1)


ALPHAS = ProcessNoise(alpha1=0.02, alpha2=0.003, alpha3=0.4, alpha4=0.05)


def test_execution_noise_is_that_of_the_velocity_motion_model():
    var_v, var_omega = execution_variances(Command(0.2, -1.5), ALPHAS, 0.1)
    assert var_v == pytest.approx(0.02 * 0.04 + 0.003 * 2.25)
    assert var_omega == pytest.approx(0.4 * 0.04 + 0.05 * 2.25)
    halved = execution_variances(Command(0.2, -1.5), ALPHAS, 0.05)  # twice as large: the drift per metre is the same
    assert halved == pytest.approx((2.0 * var_v, 2.0 * var_omega))
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


@pytest.mark.parametrize(
    ("slipping", "dt", "most"), [(False, 0.1, 0.02), (False, 0.05, 0.01), (True, 0.1, 0.1), (True, 0.05, 0.05)]
)
def test_bursts_of_slip_begin_and_end_at_their_rates(slipping, dt, most):
    """The chain's share of time and its bursts' mean length do not depend on dt."""
    chain = ProcessNoise(slip=0.5, slip_start=0.02, slip_end=0.1)
    changes = [slips(slipping, chain, draw, dt) is not slipping for draw in (1e-12, 0.99 * most, 1.01 * most, 1.0 - 1e-12)]
    assert changes == [True, True, False, False]
    assert not slips(False, ProcessNoise(), 1e-12, dt)


POSE, WHEELS = Pose(1.0, -2.0, 3.0), Pose(0.5, -1.5, 2.5)


# Numbers worked out by hand; nothing is symmetric in x, y and theta.

SPIKED = {"R": (0.04, 0.04, 0.04), "bias": (0.3, 0.3, 0.0), "spike_probability": 0.4, "spike": 0.6}


@pytest.mark.parametrize(
    ("noise", "pose", "draws", "expected"),
    [
        ({}, POSE, ((0.7, 0.7), 0.7, 0.7), POSE),
        # 1 + 0.1 + 0.2 * 0.5; 2 + 0.2 - 0.3 * 2; 0.5 + 0.3 + 0.4 * 0.25
        ({"R": (0.04, 0.09, 0.16), "bias": (0.1, 0.2, 0.3)}, (1.0, 2.0, 0.5), ((0.5, -2.0), 0.25, 0.7), (1.2, 1.6, 0.9)),
        # 1 + 0.3 + 0.2; 1 + 0.3 - 0.2; 1 + 0.6
        (SPIKED, (1.0, 1.0, 1.0), ((1.0, -1.0), 0.0, 0.1), (1.5, 1.1, 1.6)),
        ({"wheel": True}, POSE, ((0.0, 0.0), 0.0, 0.5), WHEELS),
        ({"bias": (0.0, 0.0, 0.5)}, POSE, ((0.0, 0.0), 0.0, 0.5), (1.0, -2.0, 3.5 - 2.0 * math.pi)),
        # Of the spikes one half goes each way: below 0.2 up, from 0.2 to below 0.4 down.
        *(
            ({"spike_probability": 0.4, "spike": 0.7}, (0.0, 0.0, 0.0), ((0.0, 0.0), 0.0, event), (0.0, 0.0, turn))
            for event, turn in ((0.19, 0.7), (0.2, -0.7), (0.39, -0.7), (0.4, 0.0))
        ),
        ({"wheel": True, "R": (0.01,) * 3}, POSE, ((1.0, 0.0), 0.0, 0.5), (0.6, -1.5, 2.5)),
    ],
)
def test_each_number_has_its_own_error(noise, pose, draws, expected):
    assert measure(Pose(*pose), WHEELS, OdometryNoise(**noise), *draws) == pytest.approx(expected, rel=1e-12)


# Wheel odometry as recordings have it.

KEY, DT = episode_key(3, 0), 0.1
BEFORE, AFTER = Pose(1.5, 2.5, 0.5), Pose(1.6, 2.55, 0.6)


def wheel(**numbers):
    return OdometryNoise(wheel=True, **numbers)


@pytest.mark.parametrize(("rate", "v", "dt"), [("leap", 0.1, 0.1), ("reset", 0.1, 0.05), ("reverse", -0.1, 0.1)])
def test_rates_are_per_tenth_of_a_second(rate, v, dt):
    numbers, steps = {f"{rate}_probability": 0.1, "leap": 1.0}, round(4000 * DT / dt)
    wrong = sum(counted(BEFORE, AFTER, v, wheel(**numbers), KEY, at, dt) != AFTER for at in range(steps))
    assert abs(wrong - 400) < 4.0 * math.sqrt(400.0)  # one key in 10^4
    assert all(counted(BEFORE, AFTER, v, wheel(leap=1.0), KEY, at, dt) == AFTER for at in range(100))


def test_a_leap_has_its_length_in_any_direction_and_its_turn_to_either_side():
    noise = wheel(leap_probability=1.0, leap=0.3, leap_turn=0.4)
    poses = [counted(BEFORE, AFTER, 0.1, noise, KEY, at, DT) for at in range(400)]
    x, y, theta = np.array(poses).T - np.array([AFTER]).T
    np.testing.assert_allclose(np.hypot(x, y), 0.3)
    np.testing.assert_allclose(np.abs(theta), 0.4)
    # Sums of 400 directions and of 400 sides: each bound is more than four standard deviations.
    assert max(abs(x.sum()), abs(y.sum())) < 4.0 * 0.3 * math.sqrt(200.0)
    assert abs(theta.sum()) < 4.0 * 0.4 * math.sqrt(400.0)


def test_a_reset_is_at_the_origin_and_reverse_motion_is_mirrored():
    assert counted(BEFORE, AFTER, 0.1, wheel(reset_probability=1.0), KEY, 1, DT) == Pose(0.0, 0.0, 0.0)
    noise = wheel(reverse_probability=1.0)
    assert counted(BEFORE, AFTER, 0.1, noise, KEY, 1, DT) == AFTER
    assert counted(BEFORE, AFTER, -0.1, noise, KEY, 1, DT) == pytest.approx((1.4, 2.45, 0.6))


@pytest.mark.parametrize("gap_end", [1.0, 0.25])
def test_gaps_are_as_long_as_they_should_be(gap_end):
    noise, odometry, lost = OdometryNoise(dropout_probability=0.05, gap_end=gap_end), Odometry(BEFORE, STOP, True), []
    for at in range(1, 8000):
        odometry = sense(AFTER, AFTER, STOP, odometry, noise, KEY, at)
        lost.append(not odometry.measured)
    starts = sum(now and not before for before, now in pairwise(lost))
    expected = 1.0 / min(gap_end, 1.0 - noise.dropout_probability)  # a loss may follow a loss by chance
    assert sum(lost) / starts == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(("way", "lost", "carried"), [(0.31, 0, True), (0.33, 0, False), (0.35, 2, True), (0.37, 2, False)])
def test_a_leap_is_what_is_farther_than_the_twist_explains_in_the_time_since_the_last_pose(way, lost, carried):
    """0.3 m beyond 0.2 m/s for 0.1 s, and for 0.3 s after two lost poses."""
    kf = FilterObject(matched(WHEEL))
    kf.start(Pose(0.0, 0.0, 0.0))
    for _ in range(lost):
        kf.step(Command(0.2, 0.0))
    kf.step(Command(0.2, 0.0), Pose(way, 0.0, 0.0))
    assert bool(kf.belief.mean[0] == pytest.approx(way)) is carried


# The counter-based draws: their distributions, and their bits.

N = 20_000
FALSE_ALARM = 1e-6
"""Of each test, for perfect random numbers; the draws are fixed, so a pass stays one."""


def along(what, draw=uniforms):
    """Return N draws (N, 2) that follow each other in one counter, all else being the same."""
    draws = {
        "seeds": lambda i: draw(episode_key(i, 0), 3, 1),
        "episodes": lambda i: draw(episode_key(0, i), 3, 1),
        "steps": lambda i: draw(episode_key(0, 0), i, 1),
        "streams": lambda i: draw(episode_key(0, i // 7), 3, i % 7),
    }
    return np.array([draws[what](i) for i in range(N)])


@pytest.mark.parametrize("counter", ["seeds", "episodes", "steps", "streams"])
def test_uniforms_are_uniform_and_normals_normal(counter):
    for column in along(counter).T:
        assert 0.0 < column.min() < column.max() < 1.0
        assert stats.kstest(column, "uniform").pvalue > FALSE_ALARM
    for column in along(counter, normals).T:
        assert stats.kstest(column, "norm").pvalue > FALSE_ALARM
        tail = stats.binomtest(int((np.abs(column) > 3.0).sum()), N, 2.0 * stats.norm.sf(3.0))
        assert tail.pvalue > FALSE_ALARM


def test_log_unit_is_accurate():
    rng = np.random.default_rng(0)
    numbers = [*(2.0 ** rng.uniform(-63.0, 0.0, 20_000)).tolist(), *(1.0 - 2.0 ** rng.uniform(-52.0, 0.0, 5000)).tolist()]
    edges = [1.0, 0.5, 0.25, 2.0**-31, 2.0**-32, 2.0**-33, 2.0**-62, 0.7071067811865476, 0.7071067811865475]
    numbers += [min(math.nextafter(x, to), 1.0) for x in edges for to in (0.0, x, 1.0)]  # where it halves
    np.testing.assert_allclose([_log_unit(x) for x in numbers], np.log(numbers), rtol=1e-15, atol=0.0)


# The draws are frozen: a seed gives the same episode in every later version. Rollouts: tests/golden.


def test_the_first_draws_of_all_and_the_streams_are_frozen():
    assert uniforms(4258668631600825077, 0, 0) == (0.16548430838156492, 0.8458544864552096)
    names = "PROCESS POSITION HEADING EVENTS SLIP START GOAL LEAP COUNT ROOM SCAN FIX SENSOR GYRO GOALS"
    assert [getattr(random, name) for name in names.split()] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 1, 2, 3, 4, 5, 7]
    assert episode_key(0, 0) == 4258668631600825077
