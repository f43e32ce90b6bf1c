"""Mistakes of a log are named by their causes; what the data cannot tell has no cause, and a clean log has no remark."""

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from turtlebot_gym import make_noise
from turtlebot_gym.presets import NOISES
from turtlebot_gym_lab.calibration.plausibility import require_units
from turtlebot_gym_lab.drives.causes import cause_of, jump_of
from turtlebot_gym_lab.drives.clocks import judged
from turtlebot_gym_lab.evaluation.calibration import simulated_log
from turtlebot_gym_lab.evaluation.replay import ANY_ROBOT


@cache
def log(noise="wheel", rate=20.0, seed=1, seconds=90.0):
    return simulated_log(make_noise(noise), seed=seed, steps=round(seconds * rate), dt=1.0 / rate)


def twist(v=1.0, omega=1.0):
    return lambda drive: replace(drive, twist=drive.twist * (v, omega))


def poses(name, change):
    def spoil(drive):
        said = getattr(drive, name)[:, :3].copy()
        return replace(drive, **{name: change(*said.T)})

    return spoil


def columns(*values):
    return np.column_stack(values)


def in_the_world(drive):
    heading = drive.truth[:, 2] if drive.has_truth else drive.odometry[:, 2]
    return replace(drive, twist=columns(drive.twist[:, 0] * np.cos(heading), drive.twist[:, 1]))


def late(seconds):
    def spoil(drive):
        rows = round(seconds / drive.period)
        truth = np.roll(drive.truth, rows, axis=0)
        truth[: max(rows, 0)] = np.nan
        truth[len(truth) + min(rows, 0) :] = np.nan
        return replace(drive, true_state=truth)

    return spoil


def without_w(x, y, theta):
    return columns(x, y, np.arctan2(0.0, 1.0 - 2.0 * np.sin(theta / 2.0) ** 2))


def turned(angle):
    return lambda x, y, theta: columns(x, y, np.angle(np.exp(1j * (theta + angle))))


MISTAKES = {
    "sign of the turning rate": (twist(omega=-1.0), "the turning rate has the wrong sign"),
    "sign of the speed": (twist(v=-1.0), "the speed has the wrong sign"),
    "deg/s": (twist(omega=math.degrees(1.0)), "if it is in deg/s"),
    "mm/s": (twist(v=1000.0), "if the speed is in mm/s"),
    "cm/s": (twist(v=100.0), "if the speed is in cm/s"),
    "true positions in mm": (
        poses("true_state", lambda x, y, a: columns(1e3 * x, 1e3 * y, a)),
        "true positions move .* millimetres",
    ),
    "twist in the world": (in_the_world, "along x of the world"),
    "w of the truth": (poses("true_state", without_w), "the true heading is 0 or pi .* w was never set"),
    "w of odometry": (poses("odometry", without_w), "the measured heading is 0 or pi .* w was never set"),
    "pose 0": (poses("odometry", lambda x, y, a: columns(0 * x, 0 * y, 0 * a)), "the measured position stays 0"),
    "truth 0": (poses("true_state", lambda x, y, a: columns(0 * x, 0 * y, 0 * a)), "the true position stays 0"),
    "twist 0": (twist(0.0, 0.0), "the twist is 0 in every row"),
    "speed 0": (twist(v=0.0), "the speed is 0 in every row"),
    "turning rate 0": (twist(omega=0.0), "the turning rate is 0 in every row"),
    "heading stands": (poses("odometry", lambda x, y, a: columns(x, y, 0 * a + a[0])), "the measured heading never changes"),
    "another child frame": (poses("true_state", turned(math.pi / 2)), "the true heading is turned by 90 degrees"),
    "child frame backwards": (poses("true_state", turned(math.pi)), "the true heading is turned by 180 degrees"),
    "truth and odometry swapped": (
        lambda drive: replace(drive, odometry=drive.truth, true_state=drive.odometry),
        "the two are swapped",
    ),
    "truth 2 s late": (late(2.0), "the truth is 2.00 s behind the twist"),
    "truth 3 s early": (late(-3.0), "the truth is 3.00 s ahead of the twist"),
    "x and y of odometry": (poses("odometry", lambda x, y, a: columns(y, x, a)), "the measured x and y are swapped"),
    "y of the truth": (poses("true_state", lambda x, y, a: columns(x, -y, a)), "the true y has the wrong sign"),
    "heading of the truth": (poses("true_state", lambda x, y, a: columns(x, y, -a)), "the true heading has the wrong sign"),
}


@pytest.mark.sample(16)
@pytest.mark.parametrize("rate", [50.0, 5.0])
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_by_its_cause(name, rate):
    spoil, said = MISTAKES[name]
    spoiled, where = spoil(log(rate=rate)), "log.csv"
    with pytest.raises(ValueError, match=said) as refusal:
        require_units(spoiled, replace(ANY_ROBOT, max_linear=50.0, max_angular=50.0), where)
    assert str(refusal.value).startswith(where)
    assert "\n" not in str(refusal.value)


@pytest.mark.sample(28)
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_has_its_own_cause_or_none_where_noise_hides_it(name, noise):
    spoil, said = MISTAKES[name]
    cause = cause_of(spoil(log(noise)))
    assert not cause or re.search(said, cause)


def test_two_that_disagree_are_not_told_apart_without_a_third():
    drive = replace(log(), odometry=None)
    assert "or the true heading is turned by 180 degrees" in cause_of(twist(v=-1.0)(drive))
    assert "the turning rate has the wrong sign" in cause_of(twist(omega=-1.0)(drive))  # the truth moves as its heading says


def test_a_reset_is_said_and_a_spike_is_none():
    drive = log("rough")
    moved = drive.odometry.copy()
    moved[900:, :2] -= moved[900, :2]
    assert "the measured pose jumps by" in jump_of(replace(drive, odometry=moved))
    assert not jump_of(drive)


@pytest.mark.parametrize("rate", [50.0, 20.0, 5.0])
@pytest.mark.parametrize("noise", NOISES)
def test_a_clean_log_has_neither_cause_nor_remark(noise, rate):
    drive = log(noise, rate)
    assert (cause_of(drive), jump_of(drive), judged(drive).remarks) == ("", "", ())
