"""Sensors: the numbers of fixes and of the gyro, what filters make of them, and that a late fix ends up where it belongs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from textbook import difference

from turtlebot_gym import Episode, FixNoise, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.estimation.fixes import NO_FIX, with_fixes
from turtlebot_gym.systems.sensors import ImuNoise
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Command, Fix, Odometry, Pose, Senses, senses_of

DT, DEPTH = 0.1, 5
CASES = [("matched", "rough"), ("gated", "rough"), ("matched", "wheel"), ("tutorial", "tutorial")]
POSITION, POSE = (0.02, 0.03, math.inf, 0.0, 0.0, 0.0), (0.02, 0.03, 0.05, 0.0, 0.0, 0.0)
CORRELATED = (0.02, 0.03, 0.05, 0.015, -0.01, 0.002)
SENSES = senses_of(("odometry", "fix"))


def tuned(kind, noise):
    tuning = make_filter(kind, make_noise(noise))
    return tuning, filter_of(tuning)


def senses(k):
    """Return what the odometry says at a step of some drive."""
    v, omega = 0.2, 0.5 * math.sin(0.3 * k)
    z = Pose(0.02 * k + 0.03 * math.sin(7.0 * k), 0.05 * math.cos(3.0 * k), 0.4 * math.sin(0.2 * k))
    return Senses(Odometry(z, Command(v, omega), k % 7 != 3))


def fix_at(k, R=POSE, age=0.0):
    """Return a fix of the pose at a step."""
    return Fix(Pose(0.02 * k, 0.1, 0.1), R[:3], age, True, R[3:])


def with_late(filter, tuning, fixes, *, depth=DEPTH, steps=20):
    """Drive a filter that receives fixes, each in a step; return its estimates."""
    before = SENSES(*senses(0), NO_FIX)
    log, filter = [], with_fixes(filter, depth)
    for k in range(steps + 1):
        now = SENSES(*senses(k), fixes.get(k, NO_FIX))
        log.append(filter.step(log[-1], before, now, tuning, DT, 0.5) if k else filter.start(now, tuning))
        before = now
    return log


def by_hand(filter, tuning, fixes, steps=20):
    """Drive a bare filter, and take each fix in the step in which it was measured; return its estimates."""
    log = []
    for k in range(steps + 1):
        now = filter.step(log[-1], senses(k - 1), senses(k), tuning, DT, 0.5) if k else filter.start(senses(0), tuning)
        log.append(filter.fix(now, fixes[k].pose, fixes[k].R + fixes[k].cross, tuning) if k in fixes else now)
    return log


@pytest.mark.parametrize("R", [POSITION, CORRELATED])
@pytest.mark.parametrize(("kind", "noise"), CASES)
@pytest.mark.parametrize("late", range(DEPTH + 1))
def test_a_late_fix_leads_to_the_same_bits_as_one_that_is_taken_in_after_its_step(kind, noise, late, R):
    (tuning, bare), k = tuned(kind, noise), 8
    in_time = by_hand(bare, tuning, {k: fix_at(k, R)})
    mine = with_late(bare, tuning, {k + late: fix_at(k, R, late * DT)})
    for estimate, expected in zip(mine[k + late :], in_time[k + late :], strict=True):
        assert (estimate.newest, estimate.belief, estimate.nis) == (expected, expected.belief, expected.nis)
    assert mine[k + late - 1].newest == by_hand(bare, tuning, {})[k + late - 1]  # before it has come, nothing is known of it
    assert mine[-1].newest != by_hand(bare, tuning, {})[-1]


@pytest.mark.parametrize(
    ("received", "counted", "steps"),
    [
        ({7: (6, 0.1), 8: (5, 0.3), 1: (1, 0.0), 14: (14, 0.0)}, {1: 1, 5: 5, 6: 6, 14: 14}, 20),  # one overtakes another
        *(({12: (9, age)}, {step: 9}, 20) for age, step in ((0.54, 7), (-0.04, 12))),
        *(({12: (9, age)}, {}, 20) for age in (0.56, 9.0, -0.06)),  # before what is remembered, or from the future
        *(({10: (8, age)}, {step: 8}, 20) for age, step in ((0.16, 8), (0.24, 8), (0.14, 9), (0.26, 7))),
        ({2: (0, 0.2)}, {0: 0}, 2),
        ({2: (0, 0.3)}, {}, 2),  # in the first steps less is remembered
    ],
)
def test_a_fix_counts_at_the_nearest_of_the_steps_that_are_remembered(received, counted, steps):
    tuning, bare = tuned("matched", "wheel")
    late = {step: fix_at(at, age=age) for step, (at, age) in received.items()}
    in_time = by_hand(bare, tuning, {step: fix_at(at) for step, at in counted.items()}, steps)
    for depth in (DEPTH,) if len(received) == 1 else (3, DEPTH, 9):  # how much more is remembered changes nothing
        assert with_late(bare, tuning, late, depth=depth, steps=steps)[-1].newest == in_time[-1]


ENDLESS, ORIGIN = replace(SQUARE, switch_period=1e9, max_steps=1e9), (Pose(0.0, 0.0, 0.0),)


def fixes_of(p, action, steps, seed):
    """Return steps and fixes of a drive, with the true poses of all steps."""
    episode = Episode(p, ORIGIN, seed=seed)
    poses, came = [episode.world.body.true_state], []
    for step in range(1, steps + 1):
        episode.act(action)
        poses.append(episode.world.body.true_state)
        if episode.world.senses.fix.arrived:
            came.append((step, episode.world.senses.fix))
    return came, poses


def test_fixes_come_each_period_as_late_as_they_say_with_white_noise_on_the_pose_of_their_stamp():
    fix = FixNoise(R=(0.04, 0.01, 0.0025), period=0.4, delay=0.3, dropout_probability=0.3)
    came, poses = fixes_of(make_parameters(ENDLESS, noise="wheel", fix=fix), (0.8, 0.3), 4000, 0)
    assert {(step - 3) % 4 for step, _ in came} == {0}
    assert came[0][0] > 3
    assert {(round(fix.age, 9), fix.R) for _, fix in came} == {(0.3, (0.04, 0.01, 0.0025))}
    lost = 1.0 - len(came) / 999  # of 999 in 4000 steps; a fair one fails for one seed in 10^4
    assert abs(lost - 0.3) < stats.norm.isf(0.5e-4) * math.sqrt(0.21 / 999)
    errors = np.array([np.array(fix.pose) - poses[step - 3][:3] for step, fix in came])
    errors[:, 2] = [difference(error) for error in errors[:, 2]]
    for error in errors.T / np.sqrt(fix.R)[:, None]:  # each fails for one seed in 10^4
        assert stats.kstest(error, "norm").pvalue > 1e-4
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 0.15  # of 700; one in 10^4 exceeds it


# The gyro; its filter: `test_filters`.


def test_readings_have_the_stated_noise_bias_and_drift():
    """Standard errors are 7 % for 100 seeds: 36 % is more than five of them, a false alarm in a million."""
    for noise, first, last in (
        ({"variance": 0.04}, 0.2, 0.2),
        ({"bias_deviation": 0.3}, 0.3, 0.3),
        ({"bias_walk": 0.5}, 0.0, 0.5 * math.sqrt(2.0)),
    ):
        rows = []
        for seed in range(100):
            episode = Episode(make_parameters(imu=ImuNoise(**noise)), seed=seed)
            start = episode.world.senses.imu.omega
            for _ in range(20):
                episode.step(STOP)
            rows.append((start, episode.world.senses.imu.omega))
        assert np.std(rows, axis=0) == pytest.approx((first, last), rel=0.36)


def test_with_wheel_odometry_the_gyro_keeps_the_heading():
    """The wheels' heading drifts by slip of the turning rate, which the gyro measures; its bias was taken off before."""
    errors = []
    for options in ({}, {"filter": "gyro", "imu": ImuNoise(variance=1e-6, bias_deviation=1e-4)}):
        p, off = make_parameters("square", noise="wheel", **options), []
        for seed in range(10):
            episode = Episode(p, SQUARE_WAYPOINTS, seed=seed)
            for k in range(200):
                episode.act((0.9, 0.4 * math.sin(0.05 * k)))
            off.append(difference(episode.world.estimate.belief.mean.theta - episode.world.body.true_state.theta))
        errors.append(np.sqrt(np.mean(np.square(off))))
    assert errors[1] < 0.35 * errors[0]
