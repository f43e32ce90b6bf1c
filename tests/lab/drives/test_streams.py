"""Streams: what each says at the time of a row, by hand, and in bags of drives without a fault, which have no remark."""

from itertools import product

import numpy as np
import pytest
from rosbag_messages import ODOMETRY, POSE, TF, header, make, odometry, pose, transform, write_bag
from simulated import simulated_log

from turtlebot_gym import make_noise
from turtlebot_gym.drive import known
from turtlebot_gym.presets import NOISES
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.drives.streams import Stream, between, headings, interpolated

NAN = np.nan


def stream(pairs):
    made = Stream()
    for time, value in pairs:
        made.add(time, value)
    return made


def test_a_value_holds_from_its_own_time_until_it_is_too_old():
    numbers = stream([(1.0, [1.0]), (2.0, [2.0]), (3.0, [3.0])])
    wanted = np.array([0.9, 1.0, 1.6, 2.0, 9.0])
    np.testing.assert_array_equal(numbers.held(wanted, 1)[:, 0], [NAN, 1.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(numbers.held(wanted, 1, fresh=0.5)[:, 0], [NAN, 1.0, NAN, 2.0, NAN])
    np.testing.assert_array_equal(numbers.held(wanted[:3], 1, fresh=0.0)[:, 0], [NAN, 1.0, NAN])
    np.testing.assert_array_equal(numbers.before(wanted, 1)[:, 0], [0.0, 0.0, 1.0, 1.0, 3.0])
    assert np.isnan(Stream().held(wanted, (5, 5))).all()


def test_a_value_belongs_to_the_nearest_row():
    numbers = stream([(0.04, [1.0]), (0.26, [2.0]), (0.44, [3.0]), (5.0, [4.0])])
    np.testing.assert_array_equal(numbers.nearest(0.1 * np.arange(5), 1)[:, 0], [1.0, NAN, NAN, 2.0, 3.0])


def test_a_value_whose_time_does_not_increase_is_left_out():
    numbers = stream([(1.0, 1), (1.0, 2), (0.5, 3), (2.0, 4)])
    assert (numbers.times, numbers.values, numbers.late, numbers.count) == ([1.0, 2.0], [1, 4], [2, 3], 4)


def test_poses_are_interpolated_over_short_gaps_alone_and_are_themselves_at_their_own_time():
    poses = [[0.1 * k, 0.0, 3.1 + 0.02 * k, 0.0, 0.0] for k in (0, 1, 2, 9, 10)]
    time = np.array([0.0, 0.1, 0.2, 0.9, 1.0])
    wanted = np.array([-0.1, 0.05, 0.1, 0.5, 0.9, 1.1])
    poses_then = interpolated(time, np.array(poses)[:, :3], wanted)
    np.testing.assert_allclose(poses_then[[0, 1, 2, 3, 5], 0], [NAN, 0.05, 0.1, NAN, NAN], atol=1e-12)
    assert poses_then[2, 2] == pytest.approx(3.12)
    at_own_times = stream(zip(time, poses, strict=True)).interpolated(wanted)
    np.testing.assert_array_equal(at_own_times[[2, 4]], [poses[1][:3], poses[3][:3]])
    alone = stream([(0.1, poses[1])]).interpolated(wanted)
    np.testing.assert_array_equal(alone[:, 0], [NAN, NAN, 0.1, NAN, NAN, NAN])


def test_the_heading_of_an_arc_is_that_of_its_chord():
    time = 0.05 * np.arange(60)
    angle = 0.8 * time
    positions = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    middle = slice(3, -3)
    np.testing.assert_allclose(headings(time, positions, np.full(60, 0.8))[middle], angle[middle], atol=1e-9)
    backwards = headings(time, positions, np.full(60, -0.8))[middle]
    np.testing.assert_allclose(np.cos(backwards - angle[middle]), -1.0, atol=1e-9)
    assert np.isnan(headings(time, positions, np.full(60, 0.01))).all()


START, CAPTURE = 1e9, 30.0
"""Time of the first row, s, and rate of the motion capture, Hz."""
TRUTHS = {"topic": None, "chain": "/tf:map.base", "capture": "/mocap:hall.robot"}


def bag(folder, drive, kind, random):
    """Write a drive with its truth as a topic of poses, as map -> odom -> base, or as transforms by motion capture."""
    truth, said, messages = drive.truth, drive.odometry, []
    for k, time in enumerate(START + drive.time):
        received = time + 0.002 + random.exponential(0.002)
        measured = bool(np.isfinite(said[k]).all())
        place = said[k] if measured else truth[k]
        messages.append(("/odom", ODOMETRY, received, odometry(time, place, drive.twist[k], measured=measured)))
        if kind == "topic":
            messages.append(("/ground_truth", POSE, received + 1e-4, make(POSE, header(time, "map"), pose(*truth[k]))))
        if kind == "chain":
            turn = truth[k, 2] - place[2]
            x = truth[k, 0] - np.cos(turn) * place[0] + np.sin(turn) * place[1]
            y = truth[k, 1] - np.sin(turn) * place[0] - np.cos(turn) * place[1]
            parts = [transform(time, place, "base", "odom"), transform(time, (x, y, turn), "odom", "map")]
            messages += [("/tf", TF, received + 1e-4, make(TF, [part])) for part in parts]
    if kind == "capture":
        times = np.arange(drive.time[0], drive.time[-1], 1.0 / CAPTURE)
        for time, place in zip(START + times, between(drive.time, truth, times), strict=True):
            seen = place + random.normal(0.0, (3e-4, 3e-4, 1e-3))
            messages.append(("/mocap", TF, time + 0.003, make(TF, [transform(time, seen, "robot", "hall")])))
    return write_bag(folder, sorted(messages, key=lambda message: message[2]))


CASES = [pytest.param(*case, marks=pytest.mark.slow) for case in product(NOISES, (50.0, 20.0, 5.0), TRUTHS)]


@pytest.mark.parametrize(("noise", "rate", "kind"), [("rough", 5.0, "capture"), *CASES])
def test_a_clean_log_has_no_remark_whatever_its_noise_its_rate_and_the_kind_of_its_truth(tmp_path, noise, rate, kind):
    for seed in range(3):
        drive = simulated_log(make_noise(noise), seed=seed, steps=round(40.0 * rate), dt=1.0 / rate)
        again = read(bag(tmp_path / f"bag{seed}", drive, kind, np.random.default_rng(seed)), truth=TRUTHS[kind])
        assert again.remarks == ()
        assert known(again.truth).mean() > 0.95
