"""Wheels that change while the robot is localized are noticed, and nothing else is."""

import numpy as np
import pytest

from turtlebot_gym.localization.wheels import MOST, WheelWatch
from turtlebot_gym.values import Pose


def drive(random, rows, scale, turn_scale, veer):
    """Yield true poses and odometry of a robot whose wheels change, with noise of 3 cm and 20 mrad per root of m."""
    true, wheels = np.zeros(3), np.zeros(3)
    for row in range(rows):
        v, omega = 0.2, 0.6 * np.sin(row / 40.0)
        s = scale if row > rows // 2 else 1.0
        t = turn_scale if row > rows // 2 else 1.0
        way = s * v * 0.1 * (1.0 + 0.15 * random.standard_normal())
        turn = t * omega * 0.1 + (veer if row > rows // 2 else 0.0) * v * 0.1 + 0.003 * random.standard_normal()
        for pose, d, a in ((true, way, turn), (wheels, v * 0.1, omega * 0.1)):
            pose += [d * np.cos(pose[2] + 0.5 * a), d * np.sin(pose[2] + 0.5 * a), a]
        yield Pose(*(true + random.normal(0.0, (0.01, 0.01, 0.005)))), Pose(*wheels)


def watched(seed, *, rows=6000, scale=1.0, turn_scale=1.0, veer=0.0, is_confirmed=True):
    watch = WheelWatch()
    for belief, odometry in drive(np.random.default_rng(seed), rows, scale, turn_scale, veer):
        watch.see(belief, odometry, is_confirmed=is_confirmed)
    return watch.wheels


@pytest.mark.parametrize("seed", range(5))
def test_wheels_as_assumed_are_not_reported(seed):
    wheels = watched(seed)
    assert wheels.windows > 50
    assert not wheels.has_changed
    off = np.array([wheels.scale - 1.0, wheels.turn - 1.0, wheels.veer])
    assert (np.abs(off) < 4.0 * np.array(wheels.deviations)).all()  # 4 deviations: one of 1000 drives fails


@pytest.mark.parametrize("changed", [{"scale": 0.93}, {"scale": 1.06}, {"turn_scale": 0.85}, {"veer": 0.08}])
def test_a_change_is_followed_and_reported(changed):
    wheels = watched(1, **changed)
    [(name, value)] = changed.items()
    assert getattr(wheels, name.removesuffix("_scale")) == pytest.approx(value, abs=0.03)
    assert wheels.has_changed


def test_what_no_scan_confirms_says_nothing():
    wheels = watched(1, scale=0.8, is_confirmed=False)
    assert (wheels.scale, wheels.turn, wheels.veer, wheels.windows) == (1.0, 1.0, 0.0, 0)


def test_leaps_of_the_belief_say_nothing():
    watch, carried = WheelWatch(), 0.0
    for row, (belief, odometry) in enumerate(drive(np.random.default_rng(2), 6000, 1.0, 1.0, 0.0)):
        carried += 3.0 if row % 700 == 699 else 0.0
        watch.see(belief._replace(x=belief.x + carried), odometry, is_confirmed=True)
    assert not watch.wheels.has_changed


def test_a_change_is_bounded():
    watch = WheelWatch()
    for k in range(2000):
        grown = 1.0 + min(0.002 * k, 5.0)  # slowly, so that no window is gated
        watch.see(Pose(0.5 * k * min(grown, 2.0), 0.0, 0.0), Pose(0.5 * k, 0.0, 0.0), is_confirmed=True)
    assert watch.wheels.scale <= 1.0 + MOST


def test_forgetting_ends_at_what_was_known_at_first():
    deviations = watched(3, rows=12000).deviations
    assert max(deviations) <= 0.1
