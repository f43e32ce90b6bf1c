"""Every filter, step by step, is that of the textbooks: see `textbook`."""

import math
from dataclasses import replace

import numpy as np
import pytest
from textbook import MIDDLE, Textbook, believing, difference, off

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, make_filter
from turtlebot_gym.estimation.filters import KalmanFilter, covariance_of, filter_of
from turtlebot_gym.parameters import FilterTuning, Kalman, Tutorial
from turtlebot_gym.presets import DOCUMENTED, ROUGH, TUTORIAL_FILTER, matched
from turtlebot_gym.systems.imu import Imu, ImuNoise
from turtlebot_gym.values import STOP, Command, Odometry, Pose, senses_of

TUNINGS = {
    # The assumed execution exceeds Q for both twists, at every period below ...
    "process": FilterTuning(
        Q=(0.001, 0.002, 0.003, 1e-6, 2e-6),
        R=(0.01, 0.04, 0.09),
        P0=(0.1, 0.2, 0.3, 0.4, 0.5),
        process=ProcessNoise(alpha1=0.3, alpha2=0.05, alpha3=0.7, alpha4=0.11),
    ),
    # ... and Q exceeds it.
    "Q": FilterTuning(
        Q=(0.001, 0.002, 0.003, 0.4, 0.9),
        R=(0.01, 0.04, 0.09),
        process=ProcessNoise(alpha1=0.003, alpha2=0.0005, alpha3=0.007, alpha4=0.0011),
    ),
    "tutorial": TUTORIAL_FILTER,
    "documented": matched(DOCUMENTED),
    "rough": matched(ROUGH),
    "clean": matched(Noise()),
}
KINDS = [Kalman(), Tutorial()]


def start():
    root = np.random.default_rng(5).normal(size=(5, 5)) * 0.3
    P = root @ root.T
    P[:3, 3:], P[3:, :3], P[3, 4], P[4, 3] = 0.0, 0.0, 0.0, 0.0  # commands replace the twist: nothing correlates it
    return np.array([1.0, -2.0, 2.9, 0.4, -0.7]), P


def drive(steps):
    """Yield random commands and measured poses; None for a lost one."""
    rng = np.random.default_rng(6)
    for step in range(steps):
        command = Command(*rng.uniform([-0.5, -2.0], [0.5, 2.0]).tolist())
        z = Pose(*rng.uniform([-1.0, -3.0, -math.pi], [2.0, 0.0, math.pi]).tolist())
        yield command, z if step % 4 != 2 else None


def assert_same(x, P, book, *, rtol=1e-8, atol=1e-10):
    """Require the same state, covariance of the pose and variances of the twist."""
    np.testing.assert_allclose(off(x, book.x), 0.0, atol=1e-9)
    np.testing.assert_allclose(P, covariance_of(book.P), rtol=rtol, atol=atol)


@pytest.mark.sample(9)
@pytest.mark.parametrize(("integrator", "dt"), [("euler", 0.1), ("midpoint", 0.25)])
@pytest.mark.parametrize("name", TUNINGS)
@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_the_textbooks(name, kind, dt, integrator):
    tuning, (x, P) = replace(TUNINGS[name], kind=kind, from_origin=True), start()
    if isinstance(kind, Tutorial):
        x, P = np.zeros(5), np.diag(tuning.P0)
        ours = KalmanFilter(tuning, dt=dt, integrator=integrator)
    else:
        ours = believing(KalmanFilter(tuning, dt=dt, integrator=integrator), x, P)
    book = Textbook(x, P, tuning, dt, integrator)
    for command, z in drive(60):
        ours.step(command, z)
        book.predict(command)
        if z is not None:
            book.update(z)
            assert ours.nis == pytest.approx(book.nis, rel=1e-8)
        assert_same(*ours.belief, book)
        if isinstance(kind, Tutorial):
            upper = book.P[np.triu_indices(5)]
            np.testing.assert_allclose(ours.estimate.P, upper, rtol=1e-8, atol=1e-10)


# A gyro's bias: a filter that knows of more than a pose and a twist.

DT, SEEN = 0.1, senses_of(("odometry", "imu"))
NOISE = Noise(
    process=ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.05, alpha4=0.02, slip=0.4, slip_start=0.05, slip_end=0.2),
    odometry=OdometryNoise(R=(0.03**2, 0.02**2, 0.05**2), spike_probability=0.1, spike=0.4, dropout_probability=0.1),
)
GYRO = ImuNoise(variance=1e-4, bias_deviation=0.05, bias_walk=0.01)


def noisy_drive(seed, steps=80):
    """Yield commands, turning rates and measured poses, or None, of a drive with spikes, slip and drop-outs."""
    rng = np.random.default_rng(seed)
    x, y, theta, v, omega, slipping = 0.5, -0.3, 2.9, 0.0, 0.0, False
    for k in range(steps + 1):
        command = Command(0.2, 0.8 * math.sin(0.1 * k)) if k > 0 else STOP
        x, y, theta = x + DT * v * math.cos(theta), y + DT * v * math.sin(theta), difference(theta + DT * omega)
        slipping = rng.random() >= 0.2 if slipping else rng.random() < 0.05
        v, omega = (u * (0.6 if slipping else 1.0) for u in command)
        spike = rng.choice((0.0, 0.4, -0.4), p=(0.9, 0.05, 0.05))
        z = Pose(x + rng.normal(0.0, 0.03), y + rng.normal(0.0, 0.02), difference(theta + rng.normal(0.0, 0.05) + spike))
        yield command, Imu(omega + 0.04 + rng.normal(0.0, 0.01), math.nan), z if k == 0 or rng.random() > 0.1 else None


def ours(tuning, seed, integrator):
    """Yield a filter's estimate at each step of a drive, with what was commanded and seen."""
    start, step, *_ = filter_of(tuning)
    estimate = before = None
    for command, gyro, z in noisy_drive(seed):
        senses = SEEN(Odometry(z or before.odometry.pose, command, z is not None), gyro)
        estimate = start(senses, tuning) if before is None else step(estimate, before, senses, tuning, DT, MIDDLE[integrator])
        before = senses
        yield estimate, command, gyro.omega, z


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_the_gyros_bias_is_a_sixth_state_of_the_textbooks_filter(integrator):
    tuning, book = make_filter("gyro", NOISE, imu=GYRO), None
    for estimate, command, turning, z in ours(tuning, 5, integrator):
        if book is None:
            P = np.diag([*tuning.R, 0.0, 0.0, 0.05**2])
            book = Textbook([*z, 0.0, 0.0, 0.0], P, tuning, DT, integrator)
        else:
            book.predict(command)
            book.P[5, 5] += GYRO.bias_walk**2 * DT
            book.update([turning], [GYRO.variance], np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 1.0]]))
            if z is not None:
                book.update(z)
        sixth = estimate.bias
        assert_same([*estimate.belief.mean, sixth.mean], estimate.belief.covariance, book, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose([*sixth.column, sixth.variance], book.P[5, [0, 1, 2, 5]], rtol=0.0, atol=1e-11)
    assert abs(sixth.mean - 0.04) < 4.0 * math.sqrt(sixth.variance)
