"""Streams by hand: what each says at the time of a row."""

import numpy as np
import pytest

from turtlebot_gym_lab.drives.streams import Stream, headings, interpolated

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
