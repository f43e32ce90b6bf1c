"""Absolute fixes: the sensor's numbers, what each filter makes of one, and that a late one ends up where it belongs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.stats import multivariate_normal

from turtlebot_gym import Episode, FixNoise, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.estimation.filters import filter_of, matrix
from turtlebot_gym.estimation.fixes import no_fix, with_fixes
from turtlebot_gym.systems import system_of
from turtlebot_gym.tasks import SQUARE
from turtlebot_gym.values import STOP, Command, Fix, Odometry, Pose, Senses, senses_of

DT, DEPTH = 0.1, 5
KINDS = ("matched", "gated", "mixture", "slip", "scale")
CASES = [*((kind, "rough") for kind in KINDS), ("matched", "wheel"), ("tutorial", "tutorial")]
POSITION = (0.02, 0.03, math.inf)
POSE = (0.02, 0.03, 0.05)
SENSES = senses_of(("odometry", "fix"))


def senses(k):
    """Return what the odometry says at a step of some drive."""
    v, omega = 0.2, 0.5 * math.sin(0.3 * k)
    z = Pose(0.02 * k + 0.03 * math.sin(7.0 * k), 0.05 * math.cos(3.0 * k), 0.4 * math.sin(0.2 * k))
    return Senses(Odometry(z, Command(v, omega), k % 7 != 3))


def fix_at(k, R=POSE):
    """Return a fix of the pose at a step, as if it came in that very step."""
    return Fix(Pose(0.02 * k, 0.1, 0.1), R, 0.0, True)


def told(filter, tuning, fixes, steps=20):
    """Drive a filter that receives fixes in some steps; return its estimates."""
    before = SENSES(*senses(0), no_fix())
    log = [filter.start(before, tuning)]
    for k in range(1, steps + 1):
        now = SENSES(*senses(k), fixes.get(k, no_fix()))
        log.append(filter.step(log[-1], before, now, tuning, DT, 0.5))
        before = now
    return log


def by_hand(filter, tuning, fixes, steps=20):
    """Drive a bare filter, and take each fix in the step in which it was measured; return its estimates."""
    log = [filter.start(senses(0), tuning)]
    for k in range(1, steps + 1):
        now = filter.step(log[-1], senses(k - 1), senses(k), tuning, DT, 0.5)
        log.append(filter.fix(now, fixes[k].pose, fixes[k].R, tuning) if k in fixes else now)
    return log


@pytest.mark.parametrize("R", [POSITION, POSE])
@pytest.mark.parametrize(("kind", "noise"), CASES)
def test_a_fix_in_time_is_taken_in_after_the_step(kind, noise, R):
    tuning = make_filter(kind, make_noise(noise))
    bare, fixes = filter_of(tuning), {4: fix_at(4, R), 9: fix_at(9, R)}
    mine, expected = told(with_fixes(bare, DEPTH), tuning, fixes), by_hand(bare, tuning, fixes)
    assert [one.newest for one in mine] == expected
    assert [(one.belief, one.nis) for one in mine] == [(one.belief, one.nis) for one in expected]
    assert mine[-1].belief != told(with_fixes(bare, DEPTH), tuning, {})[-1].belief


@pytest.mark.parametrize(("kind", "noise"), CASES)
@pytest.mark.parametrize("late", range(DEPTH + 1))
def test_a_late_fix_leads_to_the_same_bits_as_one_in_time(kind, noise, late):
    tuning = make_filter(kind, make_noise(noise))
    bare, k = filter_of(tuning), 8
    in_time = by_hand(bare, tuning, {k: fix_at(k)})
    mine = told(with_fixes(bare, DEPTH), tuning, {k + late: fix_at(k)._replace(age=late * DT)})
    assert [one.newest for one in mine[k + late :]] == in_time[k + late :]
    if late:
        assert mine[k + late - 1].newest != in_time[k + late - 1]  # before it has come, nothing is known of it


@pytest.mark.parametrize("depth", [3, 5, 9])
def test_fixes_may_overtake_each_other_and_how_much_is_remembered_changes_nothing(depth):
    tuning = make_filter("matched", make_noise("wheel"))
    bare = filter_of(tuning)
    late = {7: fix_at(6)._replace(age=DT), 8: fix_at(5)._replace(age=0.3), 1: fix_at(1), 14: fix_at(14)}
    in_time = by_hand(bare, tuning, {1: fix_at(1), 5: fix_at(5), 6: fix_at(6), 14: fix_at(14)})
    assert [one.newest for one in told(with_fixes(bare, depth), tuning, late)[8:]] == in_time[8:]


@pytest.mark.parametrize(("age", "counts"), [(0.54, True), (0.56, False), (9.0, False), (-0.04, True), (-0.06, False)])
def test_a_fix_from_before_what_is_remembered_or_from_the_future_changes_nothing(age, counts):
    tuning = make_filter("matched", make_noise("wheel"))
    filter = with_fixes(filter_of(tuning), DEPTH)
    without = told(filter, tuning, {})
    assert (told(filter, tuning, {12: fix_at(9)._replace(age=age)})[-1].newest != without[-1].newest) is counts


def test_the_first_steps_remember_less():
    tuning = make_filter("matched", make_noise("wheel"))
    filter = with_fixes(filter_of(tuning), DEPTH)
    assert told(filter, tuning, {2: fix_at(0)._replace(age=0.2)}, 2)[-1].belief != told(filter, tuning, {}, 2)[-1].belief
    assert told(filter, tuning, {2: fix_at(0)._replace(age=0.3)}, 2)[-1].belief == told(filter, tuning, {}, 2)[-1].belief


def test_a_fix_counts_at_the_nearest_step():
    tuning = make_filter("matched", make_noise("wheel"))
    bare = filter_of(tuning)
    in_time = by_hand(bare, tuning, {8: fix_at(8)})[-1]
    for age, here in ((0.16, True), (0.24, True), (0.14, False), (0.26, False)):
        mine = told(with_fixes(bare, DEPTH), tuning, {10: fix_at(8)._replace(age=age)})[-1]
        assert (mine.newest == in_time) is here


def conditioned(belief, z, R):
    """Return mean, covariance and likelihood of the joint update by matrices."""
    m, P = np.array(belief.mean), matrix(belief.covariance)
    n = 3 if math.isfinite(R[2]) else 2
    H, nu = np.eye(n, 5), (np.array(z) - m[:3])[:n]
    S = H @ P @ H.T + np.diag(R[:n])
    K = P @ H.T @ np.linalg.inv(S)
    return m + K @ nu, P - K @ H @ P, multivariate_normal.pdf(nu, np.zeros(n), S)


@pytest.mark.parametrize("R", [POSITION, POSE])
@pytest.mark.parametrize(
    ("kind", "noise"), [("matched", "rough"), ("gated", "rough"), ("scale", "rough"), ("matched", "wheel")]
)
def test_a_fix_is_the_joint_update_of_the_textbook(kind, noise, R):
    tuning = make_filter(kind, make_noise(noise))
    filter = filter_of(tuning)
    estimate = by_hand(filter, tuning, {}, 12)[-1]
    z = Pose(0.3, 0.05, 0.2)
    mean, P, _ = conditioned(estimate.belief, z, R)
    fixed = filter.fix(estimate, z, R, tuning)
    np.testing.assert_allclose(fixed.belief.mean, mean, atol=1e-12)
    np.testing.assert_allclose(matrix(fixed.belief.covariance), P, atol=1e-12)
    assert fixed.nis == estimate.nis  # the odometry's


@pytest.mark.parametrize("R", [POSITION, POSE])
@pytest.mark.parametrize("kind", ["mixture", "slip"])
def test_a_fix_weighs_the_hypotheses_by_how_likely_each_makes_it(kind, R):
    tuning = make_filter(kind, make_noise("rough"))
    filter = filter_of(tuning)
    estimate = by_hand(filter, tuning, {}, 2)[-1]  # while there is doubt
    z = Pose(0.1, 0.1, 0.2)

    def parts(one):
        if kind == "mixture":
            return list(zip(one.hypotheses, one.weights, strict=True))
        return [*zip(one.gripping, one.grip_weights, strict=True), *zip(one.slipping, one.slip_weights, strict=True)]

    expected = [(weight * conditioned(belief, z, R)[2], conditioned(belief, z, R)) for belief, weight in parts(estimate)]
    total = sum(weight for weight, _ in expected)
    for (belief, weight), (likely, (mean, P, _)) in zip(parts(filter.fix(estimate, z, R, tuning)), expected, strict=True):
        assert weight == pytest.approx(likely / total, abs=1e-10)
        np.testing.assert_allclose(belief.mean, mean, atol=1e-12)
        np.testing.assert_allclose(matrix(belief.covariance), P, atol=1e-12)


def test_a_heading_is_fixed_across_pi():
    tuning = make_filter("matched", make_noise("wheel"))
    filter = filter_of(tuning)
    start = filter.start(Senses(Odometry(Pose(0.0, 0.0, 3.1), STOP, True)), tuning)
    fixed = filter.fix(start, Pose(0.0, 0.0, -3.1), (1.0, 1.0, 1e-12), tuning)
    assert fixed.belief.mean.theta == pytest.approx(-3.1, abs=1e-3)


def fixes_of(fix, steps=4000, seed=0):
    """Return times in steps, errors and ages of the fixes of a drive, with the true poses of all steps."""
    p = make_parameters(replace(SQUARE, switch_period=1e9, max_steps=1e9), noise="wheel", fix=fix)
    episode = Episode(p, (Pose(0.0, 0.0, 0.0),), seed=seed)
    poses, came = [episode.world.body.true_state], []
    for step in range(1, steps + 1):
        episode.act((0.8, 0.3))
        poses.append(episode.world.body.true_state)
        if episode.world.senses.fix.arrived:
            came.append((step, episode.world.senses.fix))
    return came, poses


@pytest.fixture(scope="module")
def drive():
    return fixes_of(FixNoise(R=(0.04, 0.01, 0.0025), period=0.4, delay=0.3, dropout_probability=0.3))


def test_fixes_are_measured_each_period_come_late_and_say_how_late(drive):
    came, _ = drive
    assert {(step - 3) % 4 for step, _ in came} == {0}
    assert came[0][0] > 3
    assert {round(fix.age, 9) for _, fix in came} == {0.3}
    lost = 1.0 - len(came) / 999  # of 999 in 4000 steps; a fair one fails for one seed in 10^4
    assert abs(lost - 0.3) < stats.norm.isf(0.5e-4) * math.sqrt(0.21 / 999)


def test_a_fix_is_the_pose_of_its_stamp_with_white_noise(drive):
    came, poses = drive
    errors = np.array([np.array(fix.pose) - poses[step - 3][:3] for step, fix in came])
    errors[:, 2] = (errors[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    for error, variance in zip(errors.T, (0.04, 0.01, 0.0025), strict=True):  # each fails for one seed in 10^4
        assert stats.kstest(error / math.sqrt(variance), "norm").pvalue > 1e-4
    late = np.array([np.array(fix.pose[:2]) - poses[step][:2] for step, fix in came])
    assert np.abs(late.mean(axis=0)).max() < 0.1  # not the pose of now, which is farther along
    assert np.mean(late**2) > np.mean(errors[:, :2] ** 2)


def test_fixes_draw_numbers_of_their_own():
    def odometry(fix):
        episode = Episode(make_parameters(noise="rough", fix=fix), seed=3)
        return [(episode.act((0.5, 0.2)), episode.world.senses.odometry.pose)[1] for _ in range(20)]

    assert odometry("markers") == odometry(None)


def test_a_seeds_fixes_stay_what_they_are():
    """As they were drawn when this was written: who compares with earlier drives needs the same again."""
    p = make_parameters(replace(SQUARE, switch_period=1e9, max_steps=1e9), noise="clean", fix="localization")
    episode, came = Episode(p, (Pose(0.0, 0.0, 0.0),), seed=7), []
    for step in range(1, 13):
        episode.act((0.0, 0.0))
        if episode.world.senses.fix.arrived:
            came.append((step, episode.world.senses.fix.pose))
    assert came == [
        (7, (0.0323678750579755, -0.011094305260724892, 0.053066210655037)),
        (12, (0.04905246252690396, -0.04692115875743451, 0.05482974503723214)),
    ]


def naive(system):
    """Return a system whose late fixes are taken for ones of now."""
    late = system.sensors[-1]

    def sense_now(*arguments):
        return late.sense(*arguments)._replace(age=0.0)

    return system.with_sensor(late._replace(sense=sense_now))


@pytest.fixture(scope="module")
def consistency():
    """Return the mean NEES of the pose of late fixes with an uncertain heading, put in at their stamp and naively."""
    fix = FixNoise(R=(0.0025, 0.0025, 0.0025), period=0.5, delay=0.3, dropout_probability=0.3)
    p = make_parameters(replace(SQUARE, switch_period=1e9, max_steps=1e9), noise="wheel", fix=fix)
    found = []
    for system in (system_of(p), naive(system_of(p))):
        told = []
        for seed in range(60):
            episode = Episode(p, (Pose(0.0, 0.0, 0.0),), seed=seed, system=system)
            for step in range(60):
                episode.act((0.9, 0.4 * math.sin(0.1 * step)))
            world = episode.world
            P = matrix(world.estimate.belief.covariance)
            told.append(nees(np.array(world.estimate.belief.mean), np.array(world.body.true_state), P, components=3))
        found.append(float(np.mean(told)))
    return found


def test_late_fixes_leave_the_filter_consistent_and_naive_fusion_does_not(consistency):
    # 60 independent drives: a consistent filter's sum is chi-square with 180 degrees of freedom. Fails for one seed in 10^4.
    low, high = stats.chi2.ppf((0.5e-4, 1.0 - 0.5e-4), 180) / 60.0
    at_stamp, as_if_now = consistency
    assert low < at_stamp < high
    assert as_if_now > high


def test_two_variances_mean_that_the_heading_is_not_measured():
    assert FixNoise(R=(0.01, 0.02)) == FixNoise(R=(0.01, 0.02, math.inf))
