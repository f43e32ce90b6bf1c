"""The extended Kalman filter: its Jacobian, its covariance, its start, its gates, and measurements that are exact."""

import math
from dataclasses import replace

import numpy as np
import pytest
from textbook import believing

from turtlebot_gym import Noise, OdometryNoise, make_filter
from turtlebot_gym.estimation import ekf, update
from turtlebot_gym.estimation.filters import KalmanFilter, covariance_of, filter_of, matrix
from turtlebot_gym.estimation.gate import ONE_MEASUREMENT, judge
from turtlebot_gym.estimation.update import innovation_variance
from turtlebot_gym.models.unicycle import INTEGRATORS, advance
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Kalman, Tutorial
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Odometry, Pose, Senses, State

NOWHERE = Covariance(*[0.0] * 8)
ZERO = (0.0, 0.0, 0.0)
EULER = INTEGRATORS["euler"]


@pytest.mark.sample(1)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_covariance_stays_positive_under_fuzzing(integrator):
    """Scales over twelve decades, missing ranks, drop-outs, gates and restarts: never a negative variance or eigenvalue.

    "Never" is up to the rounding of the largest covariance on the way: what a good measurement leaves of a large one is a small
    difference of large numbers, in any filter but a square-root one.
    """
    rng, rule = np.random.default_rng(5), INTEGRATORS[integrator]
    for _ in range(150):
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
            deviations = np.sqrt(np.diag(P) + 1e-12 * largest + 1e-300)
            assert np.abs(P / np.outer(deviations, deviations)).max() <= 1.0 + 1e-9, (Q, R, P)


# Measurements that are exact, or almost: rounding does not make the filter diverge.

DRIVES = {  # Q, R, P0 and the control interval, s; the last two diverge without the floors
    "exact": ((0.0,) * 5, ZERO, (1e9,) * 5, 0.1),
    "motion unknown": ((1e9, 0.0, 1e-100, 1e6, 1.0), ZERO, (0.1, 0.1, 0.1, 1.0, 1.0), 0.1),
    "one exact": ((0.0, 0.0, 0.0, 1.0, 1.0), (0.0, 1.0, 1e-6), (1e6, 1e6, 1e3, 1e3, 1e3), 0.1),
    "heading unknown": ((1e-100, 0.0, 1e9, 0.0, 1e9), (0.0, 1e-100, 0.0), (1e6, 1.0, 0.1, 1e6, 1e3), 0.1),
    "speeds unknown": ((1e-6, 1e-12, 1e9, 1e9, 1.0), (1e-12, 1e-12, 1e-12), (0.0, 1e9, 1.0, 1e-6, 1e6), 10.0),
}


TUTORIAL_KIND = Tutorial()


def error_of(name, *, kind=TUTORIAL_KIND, steps=60):
    """Return the greatest error of position, m, of a drive without noise, after the first steps; infinity where it diverges."""
    Q, R, P0, dt = DRIVES[name]
    tuning = FilterTuning(Q=Q, R=R, P0=P0, from_origin=True, kind=kind)
    pose, twist = Pose(0.5, -0.3, 0.2), STOP
    first = Senses(Odometry(pose, twist, True))
    estimate, worst = filter_of(tuning).start(first, tuning), 0.0
    for k in range(steps):
        pose = advance(pose, twist.v, twist.omega, dt, EULER)
        twist = Command(0.2 * math.cos(k), 2.0 * math.sin(3.0 * k))
        senses = Senses(Odometry(pose, twist, True))
        try:
            estimate = filter_of(tuning).step(estimate, senses, senses, tuning, dt, EULER)
        except (ValueError, OverflowError):  # a heading that is not finite cannot be wrapped in plain Python
            return math.inf
        mean, P = estimate.belief.mean, getattr(estimate, "P", estimate.belief.covariance)
        if not np.isfinite([*mean, *P]).all():
            return math.inf
        worst = max(worst, math.hypot(mean.x - pose.x, mean.y - pose.y)) if k > 5 else worst
    return worst


@pytest.mark.parametrize("kind", [Kalman(), Tutorial()])
@pytest.mark.parametrize("name", DRIVES)
def test_the_estimate_stays_where_it_is_measured(name, kind):
    assert error_of(name, kind=kind) < 0.5


def test_without_the_floors_it_does_not(monkeypatch):
    monkeypatch.setattr(update, "LEAST_SHARE", 0.0)
    monkeypatch.setattr(update, "LEAST_VARIANCE", 0.0)
    assert max(map(error_of, list(DRIVES)[-2:])) > 1e3


def test_a_measurement_of_usual_accuracy_counts_as_it_is_and_an_exact_one_leaves_a_millionth_of_the_deviation():
    for variance in (0.0, 1e-9, 0.3, 1.0):
        for r in (1e-12, 1e-6, 0.05, 1e9, math.inf):
            assert innovation_variance(variance, r) == variance + r
    belief = Belief(State(*[0.0] * 5), NOWHERE._replace(xx=1e9))
    posterior, _ = update.update(belief, update.of_x(belief.covariance), 1.0, 0.0)
    assert posterior.mean.x == pytest.approx(1.0, abs=1e-9)
    assert math.sqrt(posterior.covariance.xx / 1e9) == pytest.approx(1e-6, rel=1e-3)


# By hand.

BY_HAND = FilterTuning(Q=(0.01, 0.02, 0.03, 0.04, 0.05), R=(0.5, 0.4, 0.25), P0=(0.1, 0.2, 0.3, 0.4, 0.5))


def variances(kf):
    P = kf.belief.covariance
    return [P.xx, P.yy, P.tt, P.vv, P.ww]


def certain(tuning, **options):
    """Return a filter that is certain of being at rest at the origin."""
    return believing(KalmanFilter(tuning, **options), np.zeros(5), np.zeros((5, 5)))


@pytest.mark.parametrize("from_origin", [False, True])
def test_it_starts_at_the_first_measurement_or_at_the_origin(from_origin):
    kf, origin = KalmanFilter(replace(BY_HAND, from_origin=from_origin)), ([0.0] * 5, [0.1, 0.2, 0.3, 0.4, 0.5])
    kf.start(Pose(1.0, 2.0, 3.0))
    measured = ([1.0, 2.0, 3.0, 0.0, 0.0], [0.5, 0.4, 0.25, 0.0, 0.0])
    assert (list(kf.belief.mean), variances(kf)) == (origin if from_origin else measured)
    assert (kf.belief.covariance[1:5:3], kf.belief.covariance.xt, kf.nis) == ((0.0, 0.0), 0.0, 0.0)
    assert kf.estimate.rejections == (0.0 if from_origin else ONE_MEASUREMENT)


CERTAIN = FilterTuning(Q=(0.0, 0.0, 0.0, 0.04, 0.05), R=(1.0, 1.0, 1.0), kind=Kalman(gate=9.0, max_rejections=3))


@pytest.mark.parametrize(("gate", "rejections"), [(9.0, 0), (math.nextafter(9.0, 0.0), 1)])
def test_the_gate_lets_pass_what_just_reaches_it_and_what_is_refused_can_be_looked_at(gate, rejections):
    kf = certain(replace(CERTAIN, kind=Kalman(gate=gate, max_rejections=3)))
    kf.step(STOP, Pose(3.0, 0.0, 0.0))  # 3^2 / (0 + 1)
    assert (kf.nis, kf.estimate.rejections) == (9.0, rejections)


def test_the_third_refusal_in_a_row_takes_the_measurement_and_its_variances():
    """The twist stays the commanded one, with the variances it was predicted with."""
    kf = certain(replace(CERTAIN, R=(0.01, 0.04, 0.09)), dt=0.2)
    for count in (1, 2):
        kf.step(Command(0.1, 0.2), Pose(7.0, 8.0, 1.0))
        assert kf.estimate.rejections == count
        assert kf.belief.mean[0] < 0.1
    kf.step(Command(0.1, 0.2), Pose(0.05, 0.05, 0.0))  # one that is taken forgives them
    assert kf.estimate.rejections == 0
    for _ in range(2):
        kf.step(Command(0.1, 0.2), Pose(7.0, 8.0, 1.0))
    kf.step(Command(0.1, 0.2))  # a lost measurement neither counts nor forgives
    assert kf.estimate.rejections == 2
    kf.step(Command(0.3, 0.4), Pose(7.0, 8.0, 1.0))
    assert kf.estimate.rejections == ONE_MEASUREMENT
    assert list(kf.belief.mean) == [7.0, 8.0, 1.0, 0.3, 0.4]
    assert variances(kf) == pytest.approx([0.01, 0.04, 0.09, 0.08, 0.1], abs=1e-15)  # 0.04 and 0.05 per 0.1 s
    # With a gate that is open it would have moved towards the measurement at once.
    open_gate = believing(KalmanFilter(replace(CERTAIN, kind=Kalman(max_rejections=3))), np.zeros(5), 0.1 * np.eye(5))
    open_gate.step(Command(0.1, 0.2), Pose(7.0, 8.0, 1.0))
    assert open_gate.belief.mean[0] > 0.5


def test_odometry_as_input_carries_the_pose_along():
    kf = KalmanFilter(replace(BY_HAND, kind=DeadReckoning()))
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


# A gate on the heading alone.

R = (0.03**2, 0.02**2, 0.05**2)
HEADING_GATE = make_filter("gated", Noise(odometry=OdometryNoise(R=R)))


@pytest.mark.parametrize(("factor", "is_outlier"), [(2.5, False), (2.6, True)])
def test_a_gate_on_the_heading_keeps_the_position(factor, is_outlier):
    start, step, *_ = filter_of(HEADING_GATE)
    first = start(Senses(Odometry(Pose(1.0, 2.0, 0.5), STOP, True)), HEADING_GATE)._replace(rejections=0.0)
    deviation = math.sqrt(2.0 * R[2])  # of the difference of two measured headings, at rest
    heading = 0.5 + factor * deviation  # chi-square's 99 % quantile is 6.63, whose root is 2.58
    senses = Senses(Odometry(Pose(1.1, 2.05, heading), Command(0.1, 0.2), True))
    estimate = step(first, senses, senses, HEADING_GATE, 0.1, 0.0)
    mean, P = estimate.belief
    assert estimate.rejections == is_outlier
    assert mean[:3] == pytest.approx((1.05, 2.025, 0.5 if is_outlier else 0.5 + 0.5 * factor * deviation))
    assert (P.xx, P.tt) == pytest.approx((0.5 * R[0], R[2] if is_outlier else 0.5 * R[2]))
    assert estimate.nis == pytest.approx(0.1**2 / (2 * R[0]) + 0.05**2 / (2 * R[1]) + factor**2)


def test_the_lockout_counts_whole_steps_and_nothing_divides_by_zero():
    tuning = FilterTuning(Q=(0.0,) * 5, R=(1.0,) * 3, kind=Kalman(max_rejections=1, lockout=0.3))
    assert [judge(count, True, True, tuning, 0.1).lost for count in (0.0, 1.0, 2.0)] == [False, False, True]
    assert (update.inverse_of(4.0), update.inverse_of(0.0)) == (0.25, 0.0)
    known = Belief(State(1.0, 2.0, 0.5, 0.1, 0.2), NOWHERE)  # P = 0 and R = 0, which counts as (1 um)^2
    assert ekf.correct(known, Pose(1.5, 2.0, 0.5), ZERO) == (known, pytest.approx(0.25e12))
