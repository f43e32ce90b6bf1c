"""Tracks: pieces make the whole, a reader misses nothing, and columns say what the track says."""

from itertools import pairwise

import numpy as np
import pytest

from turtlebot_gym.plotting import ellipse
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.trajectory import Trajectory
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.watch import Growing, Seen, Surroundings, Track, concatenate, of_trajectory
from turtlebot_gym_agents.watch.columns import rows_of, scans_of


def make_track(rows=8, *, seed=0, scans=True):
    """Return a drive of random numbers."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(rows, 5, 5))
    drive = Trajectory(
        time=0.1 * np.arange(rows),
        true_state=rng.normal(size=(rows, 5)),
        odometry=rng.normal(size=(rows, 3)),
        estimate=rng.normal(size=(rows, 5)),
        covariance=root @ root.transpose(0, 2, 1),
        reference=rng.normal(size=(rows, 3)),
        command=rng.normal(size=(rows, 2)),
    )
    seen = [
        Seen(row, Pose(*rng.normal(size=3)), Scan(rng.uniform(0.1, 3.0, 36).astype(np.float32), 0.0, 0.1745, 0.1, 3.5))
        for row in range(0, rows, 2)
    ]
    return of_trajectory(
        drive,
        Surroundings("random"),
        nis=rng.chisquare(3, rows),
        clearance=rng.uniform(0.0, 1.0, rows),
        reports=[(float(k % 3), f"report {k}") for k in range(rows)],
        circles=[rng.normal(size=(2, 3)) for _ in range(rows)],
        scans=seen if scans else (),
        outcome="the end",
    )


def part(track, first, last):
    """Return rows of a track as a track of their own."""
    rows = slice(first, last)
    return Track(
        track.around,
        Trajectory(*(values[rows] for values in track.drive)),
        track.nis[rows],
        track.clearance[rows],
        track.level[rows],
        track.report[rows],
        track.circles[rows],
        tuple(seen._replace(row=seen.row - first) for seen in track.scans if first <= seen.row < last),
        track.outcome,
    )


def same(one, other):
    for name in Trajectory._fields:
        np.testing.assert_array_equal(getattr(one.drive, name), getattr(other.drive, name))
    for name in ("nis", "clearance", "level", "circles"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.report, one.outcome, [seen.row for seen in one.scans]) == (
        other.report, other.outcome, [seen.row for seen in other.scans],
    )  # fmt: skip


def test_what_is_not_given_is_unknown():
    track = make_track(3)
    bare = of_trajectory(track.drive, track.around)
    assert np.isnan([bare.nis, bare.clearance, bare.level]).all()
    assert np.shape([bare.nis, bare.clearance, bare.level]) == (3, 3)
    assert bare.report == ("", "", "")
    assert [each.shape for each in bare.circles] == [(0, 3)] * 3
    assert (bare.scans, bare.outcome) == ((), "")


@pytest.mark.parametrize("cuts", [(0, 8), (0, 3, 8), (0, 1, 2, 3, 4, 5, 6, 7, 8)])
def test_pieces_make_the_whole(cuts):
    track = make_track()
    same(concatenate([part(track, a, b) for a, b in pairwise(cuts)]), track)


def test_a_reader_of_a_growing_drive_misses_nothing_and_reads_nothing_twice():
    track, rng = make_track(30), np.random.default_rng(1)
    growing, read, number, pieces = Growing(), [], -1, 0
    for row in range(30):
        growing.add(part(track, row, row + 1))
        if rng.random() < 0.4 or row == 29:
            number, fresh, pieces = growing.read(number, pieces)
            read.append(fresh)
    same(concatenate(read), track)
    assert growing.read(number, pieces) == (number, None, pieces)
    growing.restart(part(track, 4, 6))
    later, fresh, pieces = growing.read(number, pieces)
    assert later != number
    assert pieces == 1
    same(fresh, part(track, 4, 6))


def test_nothing_cannot_be_joined():
    with pytest.raises(ValueError, match="at least one"):
        concatenate([])


def test_columns_of_pieces_are_those_of_the_whole():
    track = make_track()
    whole, pieces = rows_of(track), [part(track, 0, 3), part(track, 3, 8)]
    columns = [rows_of(pieces[0]), rows_of(pieces[1], scans_before=len(pieces[0].scans))]
    for name, values in whole.items():
        joined = [each for column in columns for each in column[name]]
        np.testing.assert_array_equal(np.array(joined), np.array(list(values)), err_msg=name)
    assert whole["scan"].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert rows_of(make_track(scans=False))["scan"].tolist() == [-1.0] * 8


def test_the_ellipse_is_that_of_the_plots():
    track = make_track()
    columns = rows_of(track)
    angle = np.linspace(0.0, 2.0 * np.pi, 97)
    for k in range(track.rows):
        outline = ellipse(track.drive.estimate[k], track.drive.covariance[k], points=97)
        a, b, tilt = (float(columns[name][k]) for name in ("width", "height", "tilt"))
        turn = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
        drawn = np.stack([a / 2.0 * np.cos(angle), b / 2.0 * np.sin(angle)], axis=1) @ turn + track.drive.estimate[k, :2]
        gaps = np.linalg.norm(drawn[:, None] - outline[None], axis=-1).min(axis=1)
        assert gaps.max() < 0.05 * a


def test_an_ellipse_by_hand():
    covariance = np.zeros((5, 5))
    covariance[:2, :2] = [[1.0, 0.0], [0.0, 4.0]]  # sigmas of 1 m along x and 2 m along y
    track = make_track(1)
    columns = rows_of(track._replace(drive=track.drive._replace(covariance=covariance[None])))
    assert columns["width"][0] == pytest.approx(8.0)
    assert columns["height"][0] == pytest.approx(4.0)
    assert abs(np.sin(columns["tilt"][0])) == pytest.approx(1.0)


def test_what_is_not_known_stays_unknown():
    track = make_track()
    unknown = track._replace(drive=track.drive._replace(covariance=np.full((8, 5, 5), np.nan)))
    assert np.isnan(rows_of(unknown)["width"]).all()


def test_ranges_travel_in_millimetres():
    scan = Scan(np.array([0.1234, np.inf, 3.4996, 70.0], np.float32), 0.0, 1.57, 0.1, 100.0)
    columns = scans_of((Seen(0, Pose(1.0, 2.0, 3.0), scan),))
    assert columns["ranges"][0].tolist() == [123, 0, 3500, 0]
    assert (columns["x"][0], columns["y"][0], columns["theta"][0]) == (1.0, 2.0, 3.0)
