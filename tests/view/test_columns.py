"""The tables that a browser receives: numbers keep their meaning, and they are small."""

from dataclasses import replace

import numpy as np
import pytest
from drive_samples import random_drive

from turtlebot_gym.drive import Drive, Seen
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import ORIGIN, Pose
from turtlebot_gym_view import columns
from turtlebot_gym_view.columns import RESOLUTION, kept_of, rows_of, tables_of


def test_the_tables_hold_all_that_a_drive_has():
    whole = tables_of(random_drive())
    assert whole["scans"]["row"].tolist() == [0, 2, 4, 6]
    assert whole["scans"]["end"].tolist() == [36, 72, 108, 144]
    assert len(whole["beams"]["range"]) == 144
    rows = [row for row in range(8) for _ in range(2)]
    assert whole["places"]["row"].tolist() == whole["people"]["row"].tolist() == rows


def test_a_drive_without_anything_but_rows_has_empty_tables_of_the_same_columns():
    bare = tables_of(Drive(time=0.1 * np.arange(4)))
    full = tables_of(random_drive())
    for name, table in full.items():
        assert bare[name].keys() == table.keys()
        if name != "rows":
            assert not any(map(len, bare[name].values())), name


def test_numbers_are_rounded_to_a_tenth_of_a_millimetre():
    drive = random_drive()
    x = rows_of(drive)["x"]
    np.testing.assert_allclose(x, drive.true_state[:, 0], atol=0.5 * RESOLUTION + 1e-6)
    np.testing.assert_array_equal(x / RESOLUTION, np.round(x / RESOLUTION))
    assert x.dtype == np.float32
    assert RESOLUTION < 2e-4


def test_an_ellipse_by_hand():
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = [[1.0, 0.0], [0.0, 4.0]]  # sigmas of 1 m along x and 2 m along y
    drive = random_drive(1)
    table = rows_of(replace(drive, covariance=covariance[None]))
    assert table["width"][0] == pytest.approx(8.0)
    assert table["height"][0] == pytest.approx(4.0)
    assert abs(np.sin(table["tilt"][0])) == pytest.approx(1.0)
    assert np.isnan(rows_of(replace(drive, covariance=np.full((1, 3, 3), np.nan)))["width"]).all()  # unknown


def scanned(rows, beams):
    scan = Scan(np.full(beams, 1.0, np.float32), 0.0, 0.0175, 0.1, 3.5)
    return Drive(time=0.1 * np.arange(rows), scans=tuple(Seen(row, Pose(0.0, 0.0, 0.0), scan) for row in range(rows)))


def test_ranges_travel_in_millimetres():
    scan = Scan(np.array([0.1234, np.inf, 3.4996, 70.0], np.float32), 0.25, 1.57, 0.1, 100.0)
    tables = tables_of(Drive(time=np.array([0.0]), scans=(Seen(0, Pose(1.0, 2.0, 3.0), scan),)))
    assert tables["beams"]["range"].tolist() == [123, 0, 3500, 0]
    names = ("x", "y", "theta", "first", "increment")
    assert [tables["scans"][name][0] for name in names] == [1.0, 2.0, 3.0, 0.25, np.float32(1.57)]


def test_a_long_drive_sends_every_nth_scan(monkeypatch):
    monkeypatch.setattr(columns, "MOST_BEAMS", 100)
    assert kept_of(scanned(10, 10)) == 1
    drive = scanned(25, 10)
    assert kept_of(drive) == 3
    tables = tables_of(drive)
    assert tables["scans"]["row"].tolist() == list(range(0, 25, 3))
    assert len(tables["beams"]["range"]) == 90


def test_people_are_the_circles_that_move():
    walk = [np.array([[0.0, 0.1 * k, 0.3], [5.0, 5.0, 0.2]]) for k in range(3)]
    people = tables_of(Drive(time=0.1 * np.arange(3), circles=tuple(walk)))["people"]
    assert people["moves"].tolist() == [1.0, 0.0] * 3
    assert people["radius"][:2].tolist() == [pytest.approx(0.3, abs=1e-3), pytest.approx(0.2, abs=1e-3)]


def placed(robot, x, y):
    """Return where a point of the robot's frame is on the map."""
    return increment(robot, ORIGIN, Pose(x, y, 0.0), sincos(robot.theta))[:2]


@pytest.mark.parametrize("pose", ["true_state", "estimate", "odometry"])
def test_a_track_is_where_the_robot_sees_it_and_goes_its_way_in_a_second(pose):
    sample = random_drive()
    known = {name: np.full_like(getattr(sample, name), np.nan) for name in ("true_state", "estimate", "odometry")}
    drive = replace(sample, **{**known, pose: getattr(sample, pose)})
    table = tables_of(drive)["tracks"]
    shown = [(row, *track) for row in range(len(drive)) for track in drive.tracks[row].tolist() if track[-1] == 1.0]
    assert table["row"].tolist() == [row for row, *_ in shown]
    assert 0 < len(shown) < 5 * len(drive)
    for at, (row, x, y, vx, vy, deviation, *_) in enumerate(shown):
        robot = Pose(*getattr(drive, pose)[row, :3].tolist())
        assert (table["x"][at], table["y"][at]) == pytest.approx(placed(robot, x, y), abs=RESOLUTION)
        assert (table["next_x"][at], table["next_y"][at]) == pytest.approx(placed(robot, x + vx, y + vy), abs=RESOLUTION)
        assert table["radius"][at] == pytest.approx(2.0 * deviation / np.sqrt(2.0), abs=RESOLUTION)


def test_where_there_is_no_track_nothing_is_drawn():
    tracks = np.zeros((4, 5, 8))
    tracks[1], tracks[2, :2, -1] = np.nan, (0.5, 1.0)
    table = tables_of(Drive(time=0.1 * np.arange(4), tracks=tracks))["tracks"]
    assert table["row"].tolist() == [2]
    assert np.isnan(table["x"]).all()  # nobody knows where the robot is
