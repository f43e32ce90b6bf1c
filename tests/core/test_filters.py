"""Every filter is the textbook's, step by step; then starts, gates, numbers at the edge of what a float holds, the object."""

import math
from dataclasses import replace

import numpy as np
import pytest
from textbook import Textbook, believing, difference, off

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, make_filter
from turtlebot_gym.estimation import ekf, update
from turtlebot_gym.estimation.ekf import ONE_MEASUREMENT, judge
from turtlebot_gym.estimation.filters import FilterObject, covariance_of, filter_of, matrix
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Kalman, Tutorial
from turtlebot_gym.presets import POSE_GATE, ROUGH, TUTORIAL_FILTER, WHEEL
from turtlebot_gym.systems.sensors import Imu, ImuNoise
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Odometry, Pose, Senses, State, senses_of

SEEN = senses_of(("odometry", "imu"))
NOISE = Noise(
    process=ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.05, alpha4=0.02, slip=0.4, slip_start=0.05, slip_end=0.2),
    odometry=OdometryNoise(R=(0.03**2, 0.02**2, 0.05**2), spike_probability=0.1, spike=0.4, dropout_probability=0.1),
)
GYRO = ImuNoise(variance=1e-4, bias_deviation=0.05, bias_walk=0.01)
NOWHERE, EULER = Covariance(*[0.0] * 8), INTEGRATORS["euler"]
PLAIN = FilterTuning(  # the assumed execution exceeds Q for both twists
    Q=(0.001, 0.002, 0.003, 1e-6, 2e-6),
    R=(0.01, 0.04, 0.09),
    P0=(0.1, 0.2, 0.3, 0.4, 0.5),
    process=ProcessNoise(alpha1=0.3, alpha2=0.05, alpha3=0.7, alpha4=0.11),
)


def ungated(name, **options):
    tuning = make_filter(name, NOISE, **options)
    return replace(tuning, kind=replace(tuning.kind, gate=math.inf))


TUNINGS = {
    "plain": PLAIN,
    "with a large Q": replace(PLAIN, Q=(0.001, 0.002, 0.003, 0.4, 0.9)),
    "remembering": replace(PLAIN, kind=Tutorial(), from_origin=True),
    "the tutorial's": TUTORIAL_FILTER,
    "matched": ungated("matched"),
    "gyro": ungated("gyro", imu=GYRO),
}
FIXES = [
    (0.02, 0.03, math.inf, 0.0, 0.0, 0.0),
    (0.02, 0.03, 0.05, 0.0, 0.0, 0.0),
    (0.02, 0.03, 0.05, 0.015, -0.01, 0.002),
    (0.02, 0.03, math.inf, -0.015, 0.0, 0.0),
]
"""Variances of x, y and heading, which may be unknown, and covariances, of poses from elsewhere."""


def drive(steps=80):
    """Yield commands, turning rates and measured poses, or None, of a drive with spikes, slip and drop-outs."""
    rng = np.random.default_rng(5)
    x, y, theta, v, omega, slipping = 0.5, -0.3, 2.9, 0.0, 0.0, False
    for k in range(steps + 1):
        command = Command(0.2, 0.8 * math.sin(0.1 * k)) if k > 0 else STOP
        x, y, theta = x + 0.1 * v * math.cos(theta), y + 0.1 * v * math.sin(theta), difference(theta + 0.1 * omega)
        slipping = rng.random() >= 0.2 if slipping else rng.random() < 0.05
        v, omega = (u * (0.6 if slipping else 1.0) for u in command)
        spike = rng.choice((0.0, 0.4, -0.4), p=(0.9, 0.05, 0.05))
        z = Pose(x + rng.normal(0.0, 0.03), y + rng.normal(0.0, 0.02), difference(theta + rng.normal(0.0, 0.05) + spike))
        yield command, Imu(omega + 0.04 + rng.normal(0.0, 0.01), math.nan), z if k == 0 or rng.random() > 0.1 else None


def assert_same(estimate, book):
    """Require the same state, covariance of the pose and variances of the twist, and all else that the filter knows."""
    mean, sixth = list(estimate.belief.mean), getattr(estimate, "bias", None)
    if sixth is not None:
        mean.append(sixth.mean)
        np.testing.assert_allclose([*sixth.column, sixth.variance], book.P[5, [0, 1, 2, 5]], rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(off(mean, book.x), 0.0, atol=1e-9)
    np.testing.assert_allclose(estimate.belief.covariance, covariance_of(book.P), rtol=1e-8, atol=1e-11)
    if hasattr(estimate, "P"):
        np.testing.assert_allclose(estimate.P, book.P[np.triu_indices(5)], rtol=1e-8, atol=1e-11)


@pytest.mark.parametrize(("integrator", "dt"), [("euler", 0.1), ("midpoint", 0.25)])
@pytest.mark.parametrize("name", TUNINGS)
def test_every_step_and_every_fix_is_the_textbooks(name, integrator, dt):
    tuning = TUNINGS[name]
    begin, step, fix, *_ = filter_of(tuning)
    estimate = before = book = None
    for k, (command, imu, z) in enumerate(drive()):
        senses = SEEN(Odometry(z or before.odometry.pose, command, z is not None), imu)
        if book is None:
            estimate, P = begin(senses, tuning), [*tuning.R, 0.0, 0.0]
            x, P = ([0.0] * 5, tuning.P0) if tuning.from_origin else ([*z, 0.0, 0.0], P)
            x, P = ([*x, 0.0], [*P, 0.05**2]) if name == "gyro" else (x, P)
            book = Textbook(x, np.diag(P), tuning, dt, integrator)
        else:
            estimate = step(estimate, before, senses, tuning, dt, INTEGRATORS[integrator])
            book.predict(command)
            if name == "gyro":
                book.P[5, 5] += GYRO.bias_walk**2 * dt
                book.update([imu.omega], [GYRO.variance], np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 1.0]]))
            if z is not None:
                book.update(z)
                assert estimate.nis == pytest.approx(book.nis, rel=1e-8)
        assert_same(estimate, book)
        if k % 9 == 4:
            (x, y, theta, *_), nis = estimate.belief.mean, estimate.nis
            pose, R = Pose(x + 0.05, y - 0.04, theta + 0.03), FIXES[k // 9 % 4]
            estimate = fix(estimate, pose, R, tuning)
            book.update(pose, R)
            assert_same(estimate, book)
            assert estimate.nis == nis  # the odometry's
        before = senses


# The start and the gates, by hand.

BY_HAND = FilterTuning(Q=(0.01, 0.02, 0.03, 0.04, 0.05), R=(0.5, 0.4, 0.25), P0=(0.1, 0.2, 0.3, 0.4, 0.5))
CERTAIN = FilterTuning(Q=(0.0, 0.0, 0.0, 0.04, 0.05), R=(1.0, 1.0, 1.0), kind=Kalman(gate=9.0, max_rejections=3))


def variances(kf):
    P = kf.belief.covariance
    return [P.xx, P.yy, P.tt, P.vv, P.ww]


@pytest.mark.parametrize("from_origin", [False, True])
def test_it_starts_at_the_first_measurement_or_at_the_origin(from_origin):
    kf, origin = FilterObject(replace(BY_HAND, from_origin=from_origin)), ([0.0] * 5, [0.1, 0.2, 0.3, 0.4, 0.5])
    assert list(kf.belief.mean) == [0.0] * 5
    kf.start(Pose(1.0, 2.0, 3.0))
    measured = ([1.0, 2.0, 3.0, 0.0, 0.0], [0.5, 0.4, 0.25, 0.0, 0.0])
    assert (list(kf.belief.mean), variances(kf)) == (origin if from_origin else measured)
    assert (kf.belief.covariance[1:5:3], kf.belief.covariance.xt, kf.nis) == ((0.0, 0.0), 0.0, 0.0)
    assert kf.estimate.rejections == (0.0 if from_origin else ONE_MEASUREMENT)


@pytest.mark.parametrize(("gate", "rejections"), [(9.0, 0), (math.nextafter(9.0, 0.0), 1)])
def test_the_gate_lets_pass_what_just_reaches_it(gate, rejections):
    kf = believing(FilterObject(replace(CERTAIN, kind=Kalman(gate=gate, max_rejections=3))), np.zeros(5), np.zeros((5, 5)))
    kf.step(STOP, Pose(3.0, 0.0, 0.0))  # 3^2 / (0 + 1)
    assert (kf.nis, kf.estimate.rejections) == (9.0, rejections)


def test_a_refusal_is_forgiven_by_a_measurement_and_the_third_in_a_row_takes_it_and_its_variances():
    kf = believing(FilterObject(replace(CERTAIN, R=(0.01, 0.04, 0.09)), dt=0.2), np.zeros(5), np.zeros((5, 5)))
    away = Pose(7.0, 8.0, 1.0)
    for z, rejections in ((away, 1), (away, 2), (Pose(0.05, 0.05, 0.0), 0), (away, 1), (away, 2), (None, 2)):
        kf.step(Command(0.1, 0.2), z)  # a lost measurement neither counts nor forgives
        assert kf.estimate.rejections == rejections
        assert kf.belief.mean[0] < 0.2
    kf.step(Command(0.3, 0.4), away)
    assert kf.estimate.rejections == ONE_MEASUREMENT
    assert list(kf.belief.mean) == [7.0, 8.0, 1.0, 0.3, 0.4]
    assert variances(kf) == pytest.approx([0.01, 0.04, 0.09, 0.08, 0.1], abs=1e-15)  # 0.04 and 0.05 per 0.1 s


def test_the_lockout_counts_whole_steps():
    tuning = FilterTuning(Q=(0.0,) * 5, R=(1.0,) * 3, kind=Kalman(max_rejections=1, lockout=0.3))
    assert [judge(count, True, True, tuning, 0.1).lost for count in (0.0, 1.0, 2.0)] == [False, False, True]


ON_WHEELS = Noise(process=WHEEL.process, odometry=OdometryNoise(R=(0.05**2, 0.05**2, 0.05**2)))
"""Wheels as recorded, and a sensor of the pose."""


@pytest.mark.parametrize("away", [Pose(3.0, -1.0, 0.5), Pose(0.0, 0.0, math.pi - 1e-3)])
@pytest.mark.parametrize("dt", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("name", ["matched", "calibrated", "gated", "gyro"])
def test_a_spike_is_refused_and_a_leap_that_stays_is_believed_after_a_second_or_three_measurements(name, dt, away):
    tuning, here = make_filter(name, ON_WHEELS, imu=GYRO), Pose(0.0, 0.0, 0.0)
    begin, step, *_ = filter_of(tuning)
    first, senses, far = (SEEN(Odometry(pose, STOP, True), Imu(0.0, 0.0)) for pose in (Pose(0.5, 0.0, 0.0), here, away))
    estimate = step(begin(first, tuning), first, senses, tuning, dt, 0.0)
    assert abs(estimate.belief.mean.x) < 0.01  # a spike in the first measurement is given up for the second
    for _ in range(20):
        estimate = step(estimate, senses, senses, tuning, dt, 0.0)
    for count in range(1, 200):
        estimate = step(estimate, far, far, tuning, dt, 0.0)
        x, y, theta, *_ = estimate.belief.mean
        if math.hypot(x - away.x, y - away.y) + abs(difference(theta - away.theta)) < 0.02:
            break
        assert name == "gyro" or (abs(x) < 0.01, estimate.rejections) == (True, count)
    assert count == pytest.approx(max(3, POSE_GATE["lockout"] / dt), abs=1)


@pytest.mark.parametrize(("factor", "is_outlier"), [(2.5, False), (2.6, True)])
def test_a_gate_on_the_heading_keeps_the_position(factor, is_outlier):
    R = NOISE.odometry.R
    tuning = make_filter("gated", Noise(odometry=OdometryNoise(R=R)))
    begin, step, *_ = filter_of(tuning)
    first = begin(Senses(Odometry(Pose(1.0, 2.0, 0.5), STOP, True)), tuning)._replace(rejections=0.0)
    deviation = math.sqrt(2.0 * R[2])  # of the difference of two headings; chi-square's 99 % quantile is 6.63, its root 2.58
    senses = Senses(Odometry(Pose(1.1, 2.05, 0.5 + factor * deviation), Command(0.1, 0.2), True))
    estimate = step(first, senses, senses, tuning, 0.1, 0.0)
    mean, P = estimate.belief
    assert estimate.rejections == is_outlier
    assert mean[:3] == pytest.approx((1.05, 2.025, 0.5 if is_outlier else 0.5 + 0.5 * factor * deviation))
    assert (P.xx, P.tt) == pytest.approx((0.5 * R[0], R[2] if is_outlier else 0.5 * R[2]))
    assert estimate.nis == pytest.approx(0.1**2 / (2 * R[0]) + 0.05**2 / (2 * R[1]) + factor**2)


def test_odometry_as_input_carries_the_pose_along():
    kf = FilterObject(replace(BY_HAND, kind=DeadReckoning()))
    believing(kf, (5.0, 6.0, math.pi / 2.0, 0.0, 0.0), np.diag(BY_HAND.P0))
    predicted = ekf.predict(kf.belief, Command(0.1, 0.2), BY_HAND, 0.1, EULER)
    kf.step(Command(0.1, 0.2), Pose(1.0, 1.0, 0.0))  # the first one only says where the odometry is
    assert kf.belief.covariance == predicted.covariance  # moved along, and corrected by nothing
    np.testing.assert_allclose(kf.belief.mean, [5.0, 6.0, math.pi / 2.0, 0.1, 0.2], atol=1e-15)
    kf.step(Command(0.3, 0.4), Pose(3.0, 2.0, 0.5))  # 2 ahead, 1 to the left, 0.5 rad to the left
    np.testing.assert_allclose(kf.belief.mean, [4.0, 8.0, math.pi / 2.0 + 0.5, 0.3, 0.4], atol=1e-12)
    kf.step(STOP)  # nothing arrived: it stays
    np.testing.assert_allclose(kf.belief.mean[:3], [4.0, 8.0, math.pi / 2.0 + 0.5], atol=1e-12)
    assert (kf.nis, kf.estimate.rejections) == (0.0, 1.0)  # lost ones, after which an increment may be longer


# Measurements that are exact, or almost: rounding does not make the filter diverge.


def test_a_measurement_of_usual_accuracy_counts_as_it_is_and_an_exact_one_leaves_a_millionth_of_the_deviation():
    for variance in (0.0, 1e-9, 0.3, 1.0):
        for r in (1e-12, 1e-6, 0.05, 1e9, math.inf):
            assert update.innovation_variance(variance, r) == variance + r
    belief = Belief(State(*[0.0] * 5), NOWHERE._replace(xx=1e9))
    posterior, _ = update.update(belief, update.of_row(belief.covariance, (1.0, 0.0, 0.0)), 1.0, 0.0)
    assert posterior.mean.x == pytest.approx(1.0, abs=1e-9)
    assert math.sqrt(posterior.covariance.xx / 1e9) == pytest.approx(1e-6, rel=1e-3)
    known = Belief(State(1.0, 2.0, 0.5, 0.1, 0.2), NOWHERE)  # P = 0 and R = 0, which counts as (1 um)^2
    assert ekf.correct(known, Pose(1.5, 2.0, 0.5), (0.0,) * 3) == (known, pytest.approx(0.25e12))
    assert (update.inverse_of(4.0), update.inverse_of(0.0)) == (0.25, 0.0)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_covariance_stays_positive(integrator):
    """Scales over twelve decades, missing ranks, drop-outs, gates and restarts; up to rounding of the largest on the way."""
    rng, rule = np.random.default_rng(5), INTEGRATORS[integrator]
    for _ in range(60):
        R = tuple((10.0 ** rng.uniform(-12.0, 2.0, 3) * (rng.random(3) > 0.1)).tolist())
        Q = tuple((10.0 ** rng.uniform(-12.0, 1.0, 5) * (rng.random(5) > 0.3)).tolist())
        kind = Kalman(gate=rng.choice([math.inf, 3.0]), max_rejections=3)
        tuning, dt = FilterTuning(Q=Q, R=R, kind=kind), float(10.0 ** rng.uniform(-3.0, 0.0))
        root = rng.normal(size=(5, int(rng.integers(0, 6)))) * 10.0 ** rng.uniform(-6.0, 3.0)
        belief = Belief(State(*rng.uniform(-3.0, 3.0, 5).tolist()), covariance_of(root @ root.T))
        estimate, largest = ekf.Estimate(belief, 0.0, 0.0), max(belief.covariance)
        for _ in range(40):
            z = Pose(*rng.uniform([-5.0, -5.0, -math.pi], [5.0, 5.0, math.pi]).tolist())
            senses = Senses(Odometry(z, Command(*rng.uniform(-3.0, 3.0, 2).tolist()), bool(rng.random() < 0.8)))
            largest = max(largest, *ekf.predict(estimate.belief, senses.odometry.twist, tuning, dt, rule).covariance)
            estimate = ekf.step(estimate, senses, senses, tuning, dt, rule)
            mean, P = estimate.belief.mean, matrix(estimate.belief.covariance)
            assert np.isfinite([*mean, *P.flat]).all()
            assert -math.pi <= mean.theta < math.pi
            assert estimate.nis >= 0.0
            assert (np.diag(P) >= 0.0).all()
            assert np.linalg.eigvalsh(P)[0] >= -1e-12 * largest, (Q, R, P)


# The object and tunings.


@pytest.mark.parametrize("name", ["matched", "gated", "tutorial"])
def test_steps_of_the_object_are_those_of_the_function(name):
    tuning, before = make_filter(name, ROUGH), Pose(0.3, 0.2, 0.1)
    kf, (start, step, *_) = FilterObject(tuning, integrator="midpoint", dt=0.05), filter_of(tuning)
    kf.start(before)
    estimate = start(Senses(Odometry(before, STOP, True)), tuning)
    for command, _, z in drive():
        kf.step(command, z)
        senses = (Senses(Odometry(pose, command, z is not None)) for pose in (before, z or before))
        estimate, before = step(estimate, *senses, tuning, 0.05, 0.5), z or before
        assert kf.estimate == estimate
        assert (kf.belief, kf.nis) == (estimate.belief, estimate.nis)
    for wrong in ({"dt": 0.0}, {"dt": math.nan}, {"integrator": "rk4"}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            FilterObject(tuning, **wrong)
