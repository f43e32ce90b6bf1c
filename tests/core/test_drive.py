"""A drive: columns that are not given are unknown, and errors are distances and wrapped angles."""

import numpy as np
import pytest
from drive_samples import COLUMNS

from turtlebot_gym.drive import Drive, heading_error, position_error


def test_the_rows_of_an_episode_are_stacked():
    infos = [{"true_state": np.full(5, step), "odometry": np.full(3, 0.1 + step), "distance": 1.0} for step in range(4)]
    drive = Drive.stack(infos, time=0.5 * np.arange(4))
    np.testing.assert_array_equal(drive.true_state, np.arange(4.0)[:, None] + np.zeros(5))
    np.testing.assert_array_equal(drive.odometry[:, 1], 0.1 + np.arange(4))
    holes = Drive.stack([{"nis": 1.0}, {}, {"nis": 3.0}], time=np.arange(3))
    np.testing.assert_array_equal(holes.nis, [1.0, np.nan, 3.0])


def test_columns_that_are_not_given_are_unknown():
    drive = Drive(time=[0.0, 0.1, 0.2], true_state=np.ones((3, 3)))
    assert all(np.isnan(getattr(drive, name)).all() for name in COLUMNS[1:])
    np.testing.assert_array_equal(drive.true_state, [[1.0, 1.0, 1.0, np.nan, np.nan]] * 3)  # a pose says nothing of the twist
    assert (drive.has_truth, drive.has_odometry) == (True, False)
    assert drive.report == ("", "", "")
    assert [circles.shape for circles in drive.circles] == [(0, 3)] * 3


def test_the_best_known_poses_are_true_else_estimated_else_measured():
    truth, estimate, odometry = np.full((3, 5), np.nan), np.full((3, 5), np.nan), np.full((3, 3), 3.0)
    truth[0], estimate[:2] = 1.0, 2.0
    drive = Drive(time=[0.0, 0.1, 0.2], true_state=truth, estimate=estimate, odometry=odometry)
    np.testing.assert_array_equal(drive.poses, [[1.0] * 3, [2.0] * 3, [3.0] * 3])
    assert np.isnan(Drive(time=[0.0, 0.1]).poses).all()


def test_rows_far_apart_do_not_continue_each_other():
    time = np.array([0.0, 0.1, 0.2, 0.71, 0.81])
    assert Drive(time=time).joined.tolist() == [False, True, True, False, True]
    drive = Drive(time=time, joined=np.array([True, False, True, True, True]))
    assert drive.joined.tolist() == [False, False, True, False, True]


def test_position_error_is_the_distance_for_any_batch_and_that_of_an_unknown_pose_is_unknown():
    pose, unknown = np.tile([4.0, -2.0, 0.0], (2, 3, 1)), np.full((2, 3, 5), np.nan)
    np.testing.assert_array_equal(position_error(pose, np.array([1.0, 2.0, 0.3, 0.0, 0.0])), np.full((2, 3), 5.0))
    assert np.isnan([position_error(pose, unknown), heading_error(pose, unknown)]).all()


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 2])
def test_heading_error_does_not_count_whole_turns(turns):
    truth = np.array([[0.0, 0.0, 3.0]])
    pose = truth + np.array([0.0, 0.0, 0.4 + 2.0 * np.pi * turns])  # beyond pi: the raw difference is on another branch
    np.testing.assert_allclose(heading_error(pose, truth), 0.4, atol=1e-12)
    np.testing.assert_allclose(heading_error(truth, pose), 0.4, atol=1e-12)
