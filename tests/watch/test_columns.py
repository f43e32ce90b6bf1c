"""Tracks: pieces make the whole, a reader misses nothing, and columns say what the drive says."""

from dataclasses import replace

import numpy as np
import pytest
from drawing import random_drive

from turtlebot_gym.drives import Drive, Seen
from turtlebot_gym.plotting import ellipse
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.watch.columns import apart, rows_of, scans_of


def test_columns_of_pieces_are_those_of_the_whole():
    drive = random_drive()
    whole, pieces = rows_of(drive), [drive[:3], drive[3:]]
    columns = [rows_of(pieces[0]), rows_of(pieces[1], scans_before=len(pieces[0].scans))]
    for name, values in whole.items():
        joined = [each for column in columns for each in column[name]]
        np.testing.assert_array_equal(np.array(joined), np.array(list(values)), err_msg=name)
    assert whole["scan"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert rows_of(replace(drive, scans=()))["scan"].tolist() == [-1.0] * 8


def test_the_ellipse_is_that_of_the_plots():
    drive = random_drive()
    columns = rows_of(drive)
    angle = np.linspace(0.0, 2.0 * np.pi, 97)
    for k in range(len(drive)):
        outline = ellipse(drive.estimate[k], drive.covariance[k], points=97)
        a, b, tilt = (float(columns[name][k]) for name in ("width", "height", "tilt"))
        turn = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
        drawn = np.stack([a / 2.0 * np.cos(angle), b / 2.0 * np.sin(angle)], axis=1) @ turn + drive.estimate[k, :2]
        gaps = np.linalg.norm(drawn[:, None] - outline[None], axis=-1).min(axis=1)
        assert gaps.max() < 0.05 * a


def test_an_ellipse_by_hand():
    covariance = np.zeros((5, 5))
    covariance[:2, :2] = [[1.0, 0.0], [0.0, 4.0]]  # sigmas of 1 m along x and 2 m along y
    drive = random_drive(1)
    columns = rows_of(replace(drive, covariance=covariance[None]))
    assert columns["width"][0] == pytest.approx(8.0)
    assert columns["height"][0] == pytest.approx(4.0)
    assert abs(np.sin(columns["tilt"][0])) == pytest.approx(1.0)
    assert np.isnan(rows_of(replace(drive, covariance=np.full((1, 5, 5), np.nan)))["width"]).all()  # unknown


def test_ranges_travel_in_millimetres():
    scan = Scan(np.array([0.1234, np.inf, 3.4996, 70.0], np.float32), 0.0, 1.57, 0.1, 100.0)
    columns = scans_of((Seen(0, Pose(1.0, 2.0, 3.0), scan),))
    assert columns["ranges"][0].tolist() == [123, 0, 3500, 0]
    assert (columns["x"][0], columns["y"][0], columns["theta"][0]) == (1.0, 2.0, 3.0)


def test_two_drives_are_apart_as_far_as_their_robots_at_the_same_time():
    states = np.zeros((5, 5))
    states[:, 0] = np.arange(5.0)
    slow = Drive(time=10.0 + np.arange(5.0), true_state=states)
    fast = Drive(time=0.5 * np.arange(5.0), true_state=np.add(states, [0.0, 3.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(apart(slow, fast), [3.0, np.hypot(1.0, 3.0), np.hypot(2.0, 3.0), np.nan, np.nan], rtol=1e-6)
    np.testing.assert_array_equal(apart(slow, slow), np.zeros(5))
    unknown = replace(slow, true_state=np.full((5, 5), np.nan), estimate=states)
    np.testing.assert_allclose(apart(slow, unknown), np.zeros(5))
