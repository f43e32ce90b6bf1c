"""Arrays of wheel poses and scans: what was driven is read from what was written."""

import math

import numpy as np
import pytest
from drive_samples import recorded

from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.evaluation.replay import replay_seeds, replayable

ARC = [(0.0, 0.0, 0.0), (math.sin(0.2), 1.0 - math.cos(0.2), 0.2), (math.sin(0.6), 1.0 - math.cos(0.6), 0.6)]
"""Poses on a circle of 1 m, after 0, 0.5 and 1.5 s."""


def written(path, times, poses, ranges=None, **more):
    ranges = np.full((len(times), 180), 100) if ranges is None else ranges
    np.savez(path, time=np.array(times), odometry=np.array(poses), ranges_cm=ranges, **more)
    return path


def test_the_twist_is_the_arc_between_poses(tmp_path):
    path = written(tmp_path / "a.npz", (10.0, 10.5, 11.5), ARC)
    drive = read(path)
    np.testing.assert_allclose(drive.time, [0.0, 0.5, 1.5])
    np.testing.assert_allclose(drive.twist[1:], [[0.4, 0.4], [0.4, 0.4]], atol=1e-12)  # along the arc, not its chord
    np.testing.assert_allclose(drive.odometry, ARC)
    assert not drive.has_truth
    (remark,) = drive.remarks
    assert "nothing says where the LiDAR is on the robot: it is assumed in the middle of the axle" in remark
    drive = read(path, mount=(0.1, 0.0, math.pi))
    assert drive.remarks == ()
    assert drive.scans[0].mount == (0.1, 0.0, math.pi)
    assert drive.scans[2].lidar == pytest.approx(
        (ARC[2][0] + 0.1 * math.cos(0.6), ARC[2][1] + 0.1 * math.sin(0.6), 0.6 - math.pi)
    )


@pytest.mark.parametrize(("beams", "degrees"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_a_laser_of_half_a_turn_has_one_or_two_beams_to_a_degree(tmp_path, beams, degrees):
    drive = read(written(tmp_path / "a.npz", (1.0, 2.0, 3.0), ARC, np.full((3, beams), 100)))
    assert math.degrees(drive.scans[0].scan.increment) == pytest.approx(degrees)
    assert drive.scans[0].scan.first == pytest.approx(-0.5 * math.pi)


def test_faults_of_a_log_are_reported(tmp_path):
    poses = [(0.1 * k, 0.0, 0.0) for k in range(40)]
    times = [0.1 * k + 50.0 for k in range(20)] + [0.1 * k + 10.0 for k in range(20, 40)]  # the clock was set
    times[7] = 50.3
    path = written(tmp_path / "a.npz", times, poses)
    drive = read(path)
    assert len(drive) == 39
    assert any("the clock was set back 1 times, first by 39.900 s" in remark for remark in drive.remarks)
    assert f"{path}: 1 of 40 rows have a time that does not increase: left out" in drive.remarks
    assert np.flatnonzero(~drive.joined).tolist() == [0, 19]
    np.testing.assert_allclose(drive.twist[[1, 7, 20], 0], 1.0)  # nothing of the way is lost with a row
    with pytest.raises(ValueError, match="a drive needs two rows with odometry"):
        read(written(tmp_path / "few.npz", (1.0, 1.0), ARC[:2]))


def test_the_arrays_of_a_log(tmp_path):
    path, ranges = tmp_path / "a.npz", np.full((4, 180), 150, np.uint16)
    ranges[:, 3] = 8183
    arrays = {"time": np.array([0.0, 1.0, 0.5, 2.0]), "odometry": np.array([*ARC[:2], ARC[1], ARC[2]]), "ranges_cm": ranges}
    np.savez(path, **arrays, reference_row=[0, 3], reference=np.array([ARC[0], (7.0, 8.0, 0.5)]))
    drive = read(path)
    np.testing.assert_allclose(drive.time, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(drive.truth, [ARC[0], [np.nan] * 3, (7.0, 8.0, 0.5)])
    assert (drive.scans[0].scan.ranges[0], drive.scans[0].scan.ranges[3]) == (1.5, np.inf)
    assert "1 of 4 rows have a time that does not increase" in drive.remarks[-1]
    np.savez(path, **arrays, reference_row=[0, 4], reference=np.array(ARC[:2]))
    with pytest.raises(ValueError, match="do not fit each other"):
        read(path)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "left_out"), [("aces", 0), ("intel", 1612)])
def test_a_real_building_is_read_and_replayed(name, left_out):
    drive = read(recorded(f"carmen/{name}.npz"), mount=(0.0, 0.0, 0.0))
    assert len(drive.scans) > 7000
    assert sum("does not increase" in remark for remark in drive.remarks) == bool(left_out)
    assert all(f"{left_out} of " in remark for remark in drive.remarks)
    chosen = replayable(drive)
    assert len(chosen) > 0.5 * len(drive)  # stamps that scatter do not tear it apart
    replayed = replay_seeds(chosen[:1500], [0], rate=1e9)
    assert replayed.filter.heading_mean < 0.7 * replayed.raw.heading_mean


def test_a_log_of_nonsense_is_refused_or_its_good_rows_are_read(tmp_path):
    path, arrays = tmp_path / "a.npz", {"time": np.arange(3.0), "odometry": np.array(ARC)}
    arrays["odometry"][1, 0] = np.nan
    np.savez(path, **arrays, ranges_cm=np.full((3, 180), 100))
    drive = read(path)
    assert len(drive) == 2
    assert "1 of 3 rows are not finite" in drive.remarks[0]
    np.savez(path, **arrays, ranges_cm=np.zeros((3, 0)))
    with pytest.raises(ValueError, match="do not fit each other"):
        read(path)
