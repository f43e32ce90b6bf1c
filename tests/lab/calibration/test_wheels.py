"""Wheels from windows: laws that hold whatever the rate, the clock and the jumps of a log, on robots like those recorded.

A drive is simulated in steps of 5 ms, by arcs, and logged at some rate: the mean twist since the row before, late, and the
truth with noise. The robots stand for recorded ones: a Create whose turns are 0.62 of the wheels' and that veers, tracked by a
system that swaps robots; a Jackal whose wheels are 10 % smaller than assumed; slow, fast and nearly straight drives.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from drive_samples import recorded

from turtlebot_gym.drive import Drive
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym_lab.calibration import calibrate
from turtlebot_gym_lab.calibration.alphas import pieces_of
from turtlebot_gym_lab.calibration.windows import path_of
from turtlebot_gym_lab.drives import read

pytestmark = pytest.mark.slow

FINE = 0.005
CREATE = {"wheels": ProcessNoise(scale=1.01, turn_scale=0.62 / 1.01, veer=0.04 / 1.01), "speed": 0.15, "turning": 0.6}
ROBOTS = {
    "create": CREATE,
    "jackal": {"wheels": ProcessNoise(scale=0.90), "speed": 0.8, "turning": 0.8},
    "slow": {"wheels": ProcessNoise(scale=0.97, turn_scale=1.1), "speed": 0.05, "turning": 0.3, "seconds": 500.0},
    "fast": {"wheels": ProcessNoise(scale=1.04, turn_scale=0.9), "speed": 1.5, "turning": 1.5},
    "as assumed": {"wheels": ProcessNoise(), "speed": 0.2, "turning": 0.8},
}


def motion(random, seconds, speed, turning):
    """Return speeds and turning rates of a drive with arcs both ways, straights, turns on the spot and stands, smooth."""
    steps = round(seconds / FINE)
    twist, at = np.zeros((steps, 2)), 0
    while at < steps:
        hold = round(random.uniform(1.5, 4.0) / FINE)
        arc = (random.uniform(0.4, 1.0) * speed, random.uniform(-0.7, 0.7) * turning)
        spin = (0.0, random.choice((-1.0, 1.0)) * random.uniform(0.5, 1.0) * turning)
        twist[at : at + hold] = (arc, arc, (speed, 0.0), spin, (0.0, 0.0))[random.integers(5)]
        at += hold
    ramp = np.ones(60) / 60.0
    return np.column_stack([np.convolve(column, ramp, "same") for column in twist.T])


def logged(
    wheels, *, speed, turning, seconds=150.0, rate=20.0, late=0.0, seed=1, noise=0.003, truth=(0.001, 0.002), swing=None
) -> Drive:
    """Return the log of a drive.

    Args:
        wheels: What the wheels execute of what they report.
        speed: Usual speed, m/s.
        turning: Usual turning rate, rad/s.
        seconds: Length of the drive.
        rate: Rows per second.
        late: Time by which the recorded twist is late, s.
        seed: Seed.
        noise: Variance of the executed twist per squared twist, in 0.1 s.
        truth: Standard deviations of the truth, m and rad.
        swing: Replaces the turning rate; None for arcs and spins.
    """
    random = np.random.default_rng(seed)
    told = motion(random, seconds, speed, turning)
    if swing is not None:
        told[:, 1] = swing
    shaken = told * (1.0 + np.sqrt(noise * 0.1 / FINE) * random.standard_normal(told.shape))
    v = wheels.scale * shaken[:, 0]
    omega = wheels.scale * (wheels.turn_scale * shaken[:, 1] + wheels.veer * shaken[:, 0])
    theta = np.concatenate([[0.3], 0.3 + np.cumsum(omega * FINE)])
    steps = v * FINE * np.exp(1j * 0.5 * (theta[1:] + theta[:-1]))
    place = np.concatenate([[0.0], np.cumsum(steps)])
    fine = FINE * np.arange(len(theta))
    time = np.arange(0.0, fine[-1], 1.0 / rate)
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(told * FINE, axis=0)])
    moved = np.column_stack([np.interp(time - late, fine, column) for column in sums.T])
    twist = np.concatenate([np.zeros((1, 2)), np.diff(moved, axis=0) * rate])
    rows = np.rint(time / FINE).astype(int)
    poses = np.column_stack([place[rows].real, place[rows].imag, theta[rows]])
    poses += np.array([truth[0], truth[0], truth[1]]) * random.standard_normal(poses.shape)
    poses[:, 2] = np.remainder(poses[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return Drive(time=time, twist=twist, true_state=poses)


def swapped(drive, seed=1):
    """Return a drive whose truth is twice that of another robot, once with the marker turned round, and three times missing."""
    random, truth = np.random.default_rng(seed), drive.true_state.copy()
    for at, kind in zip(np.sort(random.uniform(0.05, 0.9, 6)), ("swap", "gap", "flip", "swap", "gap", "gap"), strict=True):
        first = int(at * len(drive))
        rows = slice(first, first + round(random.uniform(1.0, 5.0) / drive.period))
        if kind == "swap":
            truth[rows, :3] = [1.5, -1.0, 1.0] + truth[rows, :3][::-1] * [0.3, 0.3, 1.0]
        elif kind == "flip":
            truth[rows, 2] = np.remainder(truth[rows, 2] + 2.0 * np.pi, 2.0 * np.pi) - np.pi
        else:
            truth[rows] = np.nan
    return replace(drive, true_state=truth)


def wheels_of(fitted):
    """Return the way and the turn of a calibration."""
    process = fitted.likeliest.process
    return np.array([process.scale, process.scale * process.turn_scale])


def drift(drive, wheels, length=2.0):
    """Return the root mean square of dead reckoning's error after some way, m."""
    parameters = np.array([wheels.scale, wheels.turn_scale, wheels.veer, 0.0, 0.0, 0.0, 0.0, 0.0])
    off = pieces_of(path_of(drive), drive.truth, parameters, 0.5, length, overlap=4, by_way=True).off
    return math.sqrt(float((off[:, :2] ** 2).sum(axis=1).mean()))


def test_neither_rate_nor_clock_changes_the_wheels():
    true = np.array([1.01, 0.62])
    for rate, late in zip((5.0, 10.0, 25.0, 50.0, 100.0), (0.0, 0.3, 0.05, 0.15, 0.2), strict=True):
        fitted = calibrate(logged(**CREATE, rate=rate, late=late, seed=3, noise=0.0))
        np.testing.assert_allclose(wheels_of(fitted), true, rtol=0.004, err_msg=str(rate))
        assert fitted.delay.value == pytest.approx(-late, abs=0.01)


def test_other_numbers_of_the_wheels_give_the_same_robot():
    drive = logged(**CREATE, seed=4)
    before = calibrate(drive).estimates
    after = calibrate(replace(drive, twist=drive.twist / 1.3)).estimates
    assert after["scale"].value == pytest.approx(1.3 * before["scale"].value, rel=1e-3)
    assert after["turn_scale"].value == pytest.approx(before["turn_scale"].value, rel=1e-3)
    assert after["veer"].value == pytest.approx(before["veer"].value, abs=2e-3)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_file_drives_the_same_robot_no_worse_than_raw_odometry(name):
    robot = ROBOTS[name]
    fitted = calibrate(swapped(logged(**robot, seed=6, rate=30.0, late=0.1)))
    assert fitted.verdict.is_good
    other = logged(**robot, seed=7, rate=30.0, late=0.1)
    raw, file = drift(other, ProcessNoise()), drift(other, fitted.noise.process)
    assert file <= 1.01 * raw
    right = wheels_of(fitted) / [robot["wheels"].scale, robot["wheels"].scale * robot["wheels"].turn_scale]
    np.testing.assert_allclose(right, 1.0, atol=0.02)
    assert (file < 0.7 * raw) == (name != "as assumed")


@pytest.mark.parametrize("seconds", [15.0, 100.0])
@pytest.mark.parametrize("size", [5e-4, 0.004, 0.02])
def test_only_wheels_that_a_drive_tells_and_tests_are_in_the_file(size, seconds):
    swing = size * np.sin(0.3 * FINE * np.arange(round(seconds / FINE)))
    robot = ProcessNoise(scale=0.93, turn_scale=0.6)
    for seed in range(3):
        fitted = calibrate(logged(robot, speed=0.3, turning=0.0, seconds=seconds, seed=seed, swing=swing), kind="wheel")
        turn, process = fitted.estimates["turn_scale"], fitted.noise.process
        assert turn.high - turn.low < 0.5 or (not turn.is_determined and turn.value == 1.0)
        assert size > 5e-4 or not turn.is_determined
        assert fitted.estimates["scale"].value == pytest.approx(0.93, rel=0.02)
        if not fitted.verdict.held:
            assert (process.scale, process.turn_scale, process.veer) == (1.0, 1.0, 0.0)
            assert "so the file has the usual" in fitted.verdict.text


@pytest.fixture(scope="module")
def wifibots():
    return {name: read(recorded(name)) for name in ("wifibot1.txt", "wifibot2.txt")}


def resampled(drive, rate):
    """Return a log at another rate: its rows at least so far apart, with the mean twist since the row before."""
    rows = np.unique(np.searchsorted(drive.time, np.arange(drive.time[0], drive.time[-1], 1.0 / rate)))
    path, dt = path_of(drive), np.diff(drive.time[rows])
    twist = np.column_stack([np.diff(column[rows]) / dt for column in (path.way, path.turn)])
    return Drive(time=drive.time[rows], twist=np.concatenate([np.zeros((1, 2)), twist]), true_state=drive.true_state[rows])


def whole(drive, seconds=4.0, late=0.0):
    """Return the way and the turn of a drive by total least squares of whole windows, without a model of their errors."""
    heading = np.unwrap(drive.truth[:, 2])
    ahead = np.diff(drive.truth[:, 0] + 1j * drive.truth[:, 1]) * np.exp(-0.5j * (heading[1:] + heading[:-1]))
    path, begin = path_of(drive), np.arange(drive.time[0] + 0.5, drive.time[-1] - 0.5 - seconds, 0.1)
    found = []
    for told, true in ((path.way, np.concatenate([[0.0], np.cumsum(ahead.real)])), (path.turn, heading)):
        pairs = [
            np.interp(begin + seconds - lag, drive.time, column) - np.interp(begin - lag, drive.time, column)
            for column, lag in ((told, late), (true, 0.0))
        ]
        direction = np.linalg.svd(np.column_stack(pairs), full_matrices=False)[2][0]
        found.append(direction[1] / direction[0])
    return np.array(found)


@pytest.mark.parametrize("name", ["wifibot1.txt", "wifibot2.txt"])
def test_a_recorded_log_says_the_same_at_every_rate(wifibots, name):
    true = whole(wifibots[name], late=-0.04 if name == "wifibot2.txt" else -0.1)
    for rate in (5.0, 10.0, 25.0, 50.0):
        fitted = calibrate(resampled(wifibots[name], rate))
        np.testing.assert_allclose(wheels_of(fitted), true, rtol=0.005, err_msg=str(rate))
        scale, turn = fitted.estimates["scale"], fitted.estimates["turn_scale"]
        assert scale.low < true[0] < scale.high
        assert turn.low < true[1] / true[0] < turn.high
        assert fitted.verdict.is_good
