"""Whole filter steps against the textbook: 5 x 5 matrices in NumPy, and numbers worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.estimation.consistency import cramer_rao_bound
from turtlebot_gym.estimation.filters import KalmanFilter, reference_filter
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Kalman, ProcessNoise
from turtlebot_gym.values import Command, Pose

MIDDLE = {"euler": 0.0, "midpoint": 0.5}
H = np.eye(3, 5)
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
}


def difference(angle):
    """Return the angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


class Textbook:
    """``x = f(x, u), P = F P F' + Q; K = P H' S^-1, x += K nu, P = (I - K H) P (I - K H)' + K R K'``."""

    def __init__(self, x, P, tuning, dt, integrator):
        self.x, self.P, self.tuning, self.dt, self.middle = (
            np.array(x, float),
            np.array(P, float),
            tuning,
            dt,
            MIDDLE[integrator],
        )

    def predict(self, command):
        x, y, theta, v, omega = self.x
        dt, t = self.dt, self.tuning
        along = theta + self.middle * omega * dt
        self.x = np.array(
            [x + v * math.cos(along) * dt, y + v * math.sin(along) * dt, difference(theta + omega * dt), *command]
        )
        keep = 1.0 if t.kind.remember_velocity else 0.0
        F = np.array(
            [
                [1.0, 0.0, -v * math.sin(along) * dt, math.cos(along) * dt, -v * math.sin(along) * self.middle * dt**2],
                [0.0, 1.0, v * math.cos(along) * dt, math.sin(along) * dt, v * math.cos(along) * self.middle * dt**2],
                [0.0, 0.0, 1.0, 0.0, dt],
                [0.0, 0.0, 0.0, keep, 0.0],
                [0.0, 0.0, 0.0, 0.0, keep],
            ]
        )
        v2, omega2, p = command[0] ** 2, command[1] ** 2, t.process
        Q = np.array(t.Q) * dt / 0.1
        Q[3] = max(Q[3], (p.alpha1 * v2 + p.alpha2 * omega2) * 0.1 / dt)
        Q[4] = max(Q[4], (p.alpha3 * v2 + p.alpha4 * omega2) * 0.1 / dt)
        self.P = F @ self.P @ F.T + np.diag(Q)

    def update(self, z):
        R = np.diag(self.tuning.R)
        nu = np.array(z) - self.x[:3]
        nu[2] = difference(nu[2]) if self.tuning.kind.wrap_innovation else nu[2]
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        rest = np.eye(5) - K @ H
        self.x = self.x + K @ nu
        self.x[2] = difference(self.x[2])
        self.P = rest @ self.P @ rest.T + K @ R @ K.T
        self.nu, self.S, self.nis = nu, S, nu @ np.linalg.solve(S, nu)


def start():
    root = np.random.default_rng(5).normal(size=(5, 5)) * 0.3
    return np.array([1.0, -2.0, 2.9, 0.4, -0.7]), root @ root.T


@pytest.mark.parametrize("integrator", MIDDLE)
@pytest.mark.parametrize("dt", [0.07, 0.1, 0.25])
@pytest.mark.parametrize("name", TUNINGS)
@pytest.mark.parametrize("change", [{}, {"remember_velocity": True}, {"wrap_innovation": False}], ids=str)
def test_steps_are_the_textbooks(name, change, dt, integrator):
    tuning = replace(TUNINGS[name], kind=Kalman(**change))
    x, P = start()
    ours = KalmanFilter(tuning, state=x, covariance=P, dt=dt, integrator=integrator)
    book = Textbook(x, P, tuning, dt, integrator)
    rng = np.random.default_rng(6)
    for step in range(60):
        command = tuple(rng.uniform([-0.5, -2.0], [0.5, 2.0]).tolist())
        z = rng.uniform([-1.0, -3.0, -math.pi], [2.0, 0.0, math.pi]).tolist() if step % 4 != 2 else None
        ours.step(Command(*command), None if z is None else Pose(*z))
        book.predict(command)
        if z is not None:
            book.update(z)
            assert ours.nis == pytest.approx(book.nis, rel=1e-8)
            np.testing.assert_allclose(ours.innovation, book.nu, rtol=0.0, atol=1e-9)
            np.testing.assert_allclose(ours.innovation_covariance, book.S, rtol=1e-8, atol=1e-12)
        assert difference(ours.state[2] - book.x[2]) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(np.delete(ours.state, 2), np.delete(book.x, 2), rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(ours.covariance, book.P, rtol=1e-8, atol=1e-10)


def test_the_textbook_notices_a_wrong_filter():
    """The comparison above can fail: with any one number of the tuning off by 1 %, it does."""
    x, P = start()
    right = TUNINGS["process"]
    wrong = [
        replace(right, R=(0.0101, 0.04, 0.09)),
        replace(right, R=(0.01, 0.04, 0.0909)),
        replace(right, Q=(0.00101, *right.Q[1:])),
    ]
    wrong += [replace(right, process=replace(right.process, alpha3=0.707))]
    for tuning in wrong:
        ours, book = KalmanFilter(tuning, state=x, covariance=P), Textbook(x, P, right, 0.1, "euler")
        for command, z in (((0.3, 1.0), (1.1, -2.2, 3.0)), ((0.2, -1.0), (1.0, -2.0, -3.1))):
            ours.step(Command(*command), Pose(*z))
            book.predict(command)
            book.update(z)
        assert np.abs(ours.covariance - book.P).max() > 1e-7


# By hand.

BY_HAND = FilterTuning(Q=(0.01, 0.02, 0.03, 0.04, 0.05), R=(0.5, 0.4, 0.25), P0=(0.1, 0.2, 0.3, 0.4, 0.5))


def test_it_starts_at_the_first_measurement_or_at_the_origin():
    kf = KalmanFilter(BY_HAND)
    assert kf.state.tolist() == [0.0] * 5
    np.testing.assert_array_equal(kf.covariance, np.diag([0.1, 0.2, 0.3, 0.4, 0.5]))
    kf.start(Pose(1.0, 2.0, 3.0))
    assert kf.state.tolist() == [1.0, 2.0, 3.0, 0.0, 0.0]
    np.testing.assert_array_equal(kf.covariance, np.diag([0.5, 0.4, 0.25, 0.0, 0.0]))
    origin = KalmanFilter(replace(BY_HAND, from_origin=True))
    origin.start(Pose(1.0, 2.0, 3.0))
    assert origin.state.tolist() == [0.0] * 5
    np.testing.assert_array_equal(origin.covariance, np.diag([0.1, 0.2, 0.3, 0.4, 0.5]))
    assert (origin.nis, origin.rejections) == (0.0, 0)


CERTAIN = FilterTuning(Q=(0.0, 0.0, 0.0, 0.04, 0.05), R=(1.0, 1.0, 1.0), kind=Kalman(gate=9.0, max_rejections=3))


def test_the_gate_lets_pass_what_just_reaches_it():
    for gate, rejections in ((9.0, 0), (math.nextafter(9.0, 0.0), 1)):
        kf = KalmanFilter(replace(CERTAIN, kind=Kalman(gate=gate, max_rejections=3)), covariance=np.zeros((5, 5)))
        kf.step(Command(0.0, 0.0), Pose(3.0, 0.0, 0.0))  # 3^2 / (0 + 1)
        assert (kf.nis, kf.rejections) == (9.0, rejections)


def test_a_restart_takes_the_measurement_and_its_variances():
    """The third refusal in a row restarts; the twist stays the commanded one, with the variances it was predicted with."""
    kf = KalmanFilter(replace(CERTAIN, R=(0.01, 0.04, 0.09)), covariance=np.zeros((5, 5)), dt=0.2)
    for count in (1, 2):
        kf.step(Command(0.1, 0.2), Pose(7.0, 8.0, 1.0))
        assert kf.rejections == count
        assert kf.state[0] < 0.1
    kf.step(Command(0.1, 0.2))  # a lost measurement neither counts nor forgives
    assert kf.rejections == 2
    kf.step(Command(0.3, 0.4), Pose(7.0, 8.0, 1.0))
    assert kf.rejections == 0
    assert kf.state.tolist() == [7.0, 8.0, 1.0, 0.3, 0.4]
    np.testing.assert_allclose(kf.covariance, np.diag([0.01, 0.04, 0.09, 0.08, 0.1]), atol=1e-15)  # 0.04 and 0.05 per 0.1 s
    # With a gate that is open it would have moved towards the measurement at once.
    open_gate = KalmanFilter(replace(CERTAIN, kind=Kalman(max_rejections=3)), covariance=0.1 * np.eye(5))
    open_gate.step(Command(0.1, 0.2), Pose(7.0, 8.0, 1.0))
    assert open_gate.state[0] > 0.5


def test_a_measurement_that_is_taken_forgives_the_refused_ones():
    kf = KalmanFilter(CERTAIN, covariance=np.zeros((5, 5)))
    for z, rejections in ((9.0, 1), (9.0, 2), (0.1, 0), (9.0, 1)):
        kf.step(Command(0.0, 0.0), Pose(z, 0.0, 0.0))
        assert kf.rejections == rejections


def test_odometry_as_input_carries_the_pose_along_by_hand():
    tuning = replace(BY_HAND, kind=DeadReckoning())
    kf = KalmanFilter(tuning, state=(5.0, 6.0, math.pi / 2.0, 0.0, 0.0))
    predicted = KalmanFilter(replace(BY_HAND, kind=Kalman()), state=kf.state)
    kf.step(Command(0.1, 0.2), Pose(1.0, 1.0, 0.0))  # the first one only says where the odometry is
    predicted.predict(Command(0.1, 0.2))
    np.testing.assert_array_equal(kf.covariance, predicted.covariance)  # moved along, and corrected by nothing
    np.testing.assert_allclose(kf.state, [5.0, 6.0, math.pi / 2.0, 0.1, 0.2], atol=1e-15)
    kf.step(Command(0.3, 0.4), Pose(3.0, 2.0, 0.5))  # 2 ahead, 1 to the left, 0.5 rad to the left
    np.testing.assert_allclose(kf.state, [4.0, 8.0, math.pi / 2.0 + 0.5, 0.3, 0.4], atol=1e-12)
    kf.step(Command(0.0, 0.0))  # nothing arrived: it stays
    np.testing.assert_allclose(kf.state[:3], [4.0, 8.0, math.pi / 2.0 + 0.5], atol=1e-12)
    assert np.isnan(kf.innovation).all()
    assert (kf.nis, kf.rejections) == (0.0, 0)


@pytest.mark.parametrize("remember", [False, True])
def test_the_reference_filter_starts_at_the_origin_with_p0_and_is_the_textbooks(remember):
    tuning = replace(BY_HAND, kind=Kalman(remember_velocity=remember))
    reference = reference_filter(tuning)
    assert reference.x.tolist() == [0.0] * 5
    np.testing.assert_array_equal(reference.P, np.diag([0.1, 0.2, 0.3, 0.4, 0.5]))
    np.testing.assert_array_equal(reference.R, np.diag([0.5, 0.4, 0.25]))
    book = Textbook(np.zeros(5), reference.P, tuning, 0.1, "euler")
    for command, z in (((0.3, 1.0), (0.1, -0.2, 3.0)), ((0.2, -1.0), (0.0, 0.0, -3.1)), ((0.1, 0.5), None)):
        reference.predict(command)
        reference.update(z)
        book.predict(command)
        if z is not None:
            book.update(z)
        np.testing.assert_allclose(reference.P, book.P, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(np.delete(reference.x - book.x, 2), 0.0, atol=1e-12)
        assert difference(reference.x[2] - book.x[2]) == pytest.approx(0.0, abs=1e-12)
    reference.predict_x()  # without a command it stops
    assert reference.x[3:].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("options", [{}, {"dt": 0.1, "integrator": "euler"}, {"dt": 0.25, "integrator": "midpoint"}], ids=str)
def test_the_bound_is_the_textbooks_riccati_equation_along_the_truth(options):
    rng = np.random.default_rng(7)
    runs, steps, tuning = 3, 6, TUNINGS["process"]
    states = rng.uniform(-2.0, 2.0, (runs, steps + 1, 5))
    commands = rng.uniform(-1.0, 1.0, (runs, steps, 2))
    expected = np.zeros((steps + 1, 5, 5))
    for states_of_run, commands_of_run in zip(states, commands, strict=True):
        P = np.diag([*tuning.R, 0.0, 0.0])
        expected[0] += P / runs
        for k in range(steps):
            book = Textbook(states_of_run[k], P, tuning, options.get("dt", 0.1), options.get("integrator", "euler"))
            book.predict(commands_of_run[k])
            book.x = states_of_run[k + 1]
            book.update(states_of_run[k + 1, :3])
            P = book.P
            expected[k + 1] += P / runs
    np.testing.assert_allclose(cramer_rao_bound(states, commands, tuning, **options), expected, rtol=1e-9, atol=1e-12)
    alone = cramer_rao_bound(states[1], commands[1], tuning, **options)
    np.testing.assert_array_equal(alone, cramer_rao_bound(states[1:2], commands[1:2], tuning, **options))
    with pytest.raises(ValueError, match="integrator must be one of 'euler', 'midpoint', got 'rk4'"):
        cramer_rao_bound(states, commands, tuning, integrator="rk4")
