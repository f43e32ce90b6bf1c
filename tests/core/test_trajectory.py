"""A recorded drive: it is what the environment told, and its errors are distances and wrapped angles."""

import numpy as np
import pytest

from turtlebot_gym.trajectory import Trajectory, heading_error, position_error


def test_infos_are_stacked_in_time():
    infos = [
        {
            "true_state": np.full(5, step),
            "odometry": np.full(3, step + 0.1),
            "estimate": np.full(5, step + 0.2),
            "covariance": np.full((5, 5), step),
            "reference": np.full(3, 7.0),
            "command": np.full(2, -step),
            "distance": 1.0,
        }
        for step in range(4)
    ]
    drive = Trajectory.from_infos(infos, dt=0.5)
    np.testing.assert_array_equal(drive.time, [0.0, 0.5, 1.0, 1.5])
    assert drive.covariance.shape == (4, 5, 5)
    for name in Trajectory._fields[1:]:
        np.testing.assert_array_equal(getattr(drive, name), [info[name] for info in infos])


def test_position_error_is_the_distance_for_any_batch():
    truth = np.zeros((2, 3, 5))
    pose = np.zeros((2, 3, 3))
    pose[..., 0], pose[..., 1] = 3.0, -4.0
    np.testing.assert_array_equal(position_error(pose, truth), np.full((2, 3), 5.0))


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 2])
def test_heading_error_does_not_count_whole_turns(turns):
    truth = np.array([[0.0, 0.0, 3.0]])
    pose = truth + np.array([0.0, 0.0, 0.4 + 2.0 * np.pi * turns])  # beyond pi: the raw difference is on another branch
    np.testing.assert_allclose(heading_error(pose, truth), 0.4, atol=1e-12)
    np.testing.assert_allclose(heading_error(truth, pose), 0.4, atol=1e-12)


def test_what_is_unknown_stays_unknown():
    unknown, known = np.full((1, 3), np.nan), np.zeros((1, 3))
    assert np.isnan(position_error(known, unknown)).all()
    assert np.isnan(heading_error(known, unknown)).all()
