"""Logs of other projects: what was driven is read from what was written."""

import math

import numpy as np
import pytest
from drawing import draw, recorded

from turtlebot_gym.drives import read
from turtlebot_gym_agents.evaluation.replay import replay_seeds, replayable

AHEAD = 0.25  # where the laser stands, m
ARC = [(0.0, 0.0, 0.0), (math.sin(0.2), 1.0 - math.cos(0.2), 0.2), (math.sin(0.6), 1.0 - math.cos(0.6), 0.6)]
"""Poses on a circle of 1 m, after 0, 0.5 and 1.5 s."""


def odom(time, pose, sent=None):
    return f"ODOM {' '.join(map(str, pose))} 9.0 9.0 0.0 {time if sent is None else sent} host {time + 3.0}"


def flaser(time, pose, laser=None, beams=180):
    laser = laser or (pose[0] + AHEAD * math.cos(pose[2]), pose[1] + AHEAD * math.sin(pose[2]), pose[2])
    ranges = [str(1.0 + 0.01 * k) for k in range(beams - 1)] + ["81.91"]
    return " ".join(["FLASER", str(beams), *ranges, *map(str, (*laser, *pose)), str(time), "host", str(time + 3.0)])


def robotlaser(time, pose):
    head = ["ROBOTLASER1", "0", "-2.0", "4.0", "2.0", "5.0", "0.01", "0", "3", "1.0", "2.0", "5.0", "0"]
    laser = (pose[0] + AHEAD * math.cos(pose[2]), pose[1] + AHEAD * math.sin(pose[2]), pose[2])
    return " ".join([*head, *map(str, (*laser, *pose)), "9", "9", "0", "0", "0", str(time), "host", str(time)])


def written(path, *lines):
    path.write_text("\n".join(["# CARMEN Logfile", "PARAM robot_length 50", *lines]) + "\n")
    return path


def test_the_twist_of_a_carmen_log_is_the_arc_between_its_poses(tmp_path):
    times = (10.0, 10.5, 11.5)
    drive = read(written(tmp_path / "a.log", *(odom(*row) for row in zip(times, ARC, strict=True))))
    np.testing.assert_allclose(drive.time, [0.0, 0.5, 1.5])
    np.testing.assert_allclose(drive.twist[1:], [[0.4, 0.4], [0.4, 0.4]], atol=1e-12)  # along the arc, not its chord
    np.testing.assert_allclose(drive.odometry, ARC)
    assert not drive.has_truth
    assert drive.remarks == ()


@pytest.mark.parametrize("line", [flaser, robotlaser])
def test_the_scans_of_a_carmen_log_have_time_angles_and_mount(tmp_path, line):
    lines = [odom(1.0, ARC[0]), line(1.25, ARC[1]), odom(1.5, ARC[1]), odom(2.5, ARC[2]), line(9.0, ARC[2])]
    drive = read(written(tmp_path / "a.log", *lines))
    (seen,) = drive.scans  # the second one is after the last row
    assert (seen.row, seen.time) == (1, 0.25)
    assert seen.mount == pytest.approx((AHEAD, 0.0, 0.0))
    x, y, theta = ARC[1]
    assert seen.lidar == pytest.approx((x + AHEAD * math.cos(theta), y + AHEAD * math.sin(theta), theta))
    assert seen.scan.ranges[0] == 1.0
    assert seen.scan.ranges[-1] == np.inf  # beyond what the laser measures
    expected = (-0.5 * math.pi, math.radians(1.0)) if line is flaser else (-2.0, 2.0)
    assert (seen.scan.first, seen.scan.increment) == pytest.approx(expected)


@pytest.mark.parametrize(("beams", "degrees"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_a_laser_of_half_a_turn_has_one_or_two_beams_to_a_degree(tmp_path, beams, degrees):
    drive = read(written(tmp_path / "a.log", *(flaser(1.0 + k, ARC[k], beams=beams) for k in range(3))))
    assert math.degrees(drive.scans[0].scan.increment) == pytest.approx(degrees)


def test_poses_that_a_mapper_corrected_are_the_truth(tmp_path):
    corrected = [(0.1, 0.0, 0.0), (0.5, 0.3, 0.1), (0.9, 0.7, 0.8)]
    drive = read(written(tmp_path / "a.log", *(flaser(1.0 + k, ARC[k], corrected[k]) for k in range(3))))
    np.testing.assert_allclose(drive.truth, corrected)
    assert "a mapper has corrected its poses" in drive.remarks[0]
    true = [f"TRUEPOS {' '.join(map(str, corrected[k] + ARC[k]))} {k + 1}.0 host {k}.0" for k in range(3)]
    drive = read(written(tmp_path / "a.log", *true))
    np.testing.assert_allclose(drive.truth, corrected)
    np.testing.assert_allclose(drive.odometry, ARC)


def test_faults_of_a_carmen_log_are_reported(tmp_path):
    poses = [(0.1 * k, 0.0, 0.0) for k in range(40)]
    lines = [odom(0.1 * k + 50.0, pose) for k, pose in enumerate(poses)]
    lines[5] = "ODOM 1.0 2.0"
    lines[7] = odom(50.3, poses[7])
    lines[20:] = [odom(0.1 * k + 10.0, poses[k]) for k in range(20, 40)]  # the clock was set
    path = written(tmp_path / "a.log", *lines)
    drive = read(path)
    assert len(drive) == 38
    assert f"{path}: 1 lines cannot be read, first line 8: left out" in drive.remarks
    assert any("the clock was set back 1 times, first by 39.900 s" in remark for remark in drive.remarks)
    assert f"{path}: 1 of 39 rows have a time that does not increase: left out" in drive.remarks
    assert np.flatnonzero(~drive.joined).tolist() == [0, 18]
    np.testing.assert_allclose(drive.twist[[1, 6, 20], 0], 1.0)  # nothing of the way is lost with a row
    with pytest.raises(ValueError, match="a drive needs two rows with odometry"):
        read(written(tmp_path / "few.log", lines[0]))


def test_the_arrays_of_a_carmen_log(tmp_path):
    path, ranges = tmp_path / "a.npz", np.full((4, 180), 150, np.uint16)
    ranges[:, 3] = 8183
    arrays = {"time": np.array([0.0, 1.0, 0.5, 2.0]), "odometry": np.array([*ARC[:2], ARC[1], ARC[2]]), "ranges_cm": ranges}
    np.savez(path, **arrays, reference_row=[0, 3], reference=np.array([ARC[0], (7.0, 8.0, 0.5)]))
    drive = read(path)
    np.testing.assert_allclose(drive.time, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(drive.truth, [ARC[0], [np.nan] * 3, (7.0, 8.0, 0.5)])
    assert (drive.scans[0].scan.ranges[0], drive.scans[0].scan.ranges[3]) == (1.5, np.inf)
    assert "1 of 4 rows have a time that does not increase" in drive.remarks[0]
    np.savez(path, **arrays, reference_row=[0, 4], reference=np.array(ARC[:2]))
    with pytest.raises(ValueError, match="do not fit each other"):
        read(path)


def test_a_robot_of_mrclam_has_its_truth_beside_it(tmp_path):
    drawn = draw(200)
    head = "# Time [s]    forward velocity [m/s]    angular velocity[rad/s]"
    path = tmp_path / "Robot3_Odometry.dat"
    np.savetxt(path, np.column_stack([drawn.time + 1e9, drawn.twist]), header=head, comments="", fmt="%.4f")
    assert not read(path).has_truth
    assert "there is no Robot3_Groundtruth.dat beside it" in read(path).remarks[0]
    np.savetxt(tmp_path / "Robot3_Groundtruth.dat", np.column_stack([drawn.time + 1e9, drawn.truth]), header="# a", fmt="%.6f")
    drive = read(path)
    np.testing.assert_allclose(drive.twist, drawn.twist, atol=1e-4)
    np.testing.assert_allclose(drive.truth, drawn.truth, atol=1e-5)
    assert drive.remarks == ()


@pytest.mark.parametrize(("name", "left_out"), [("aces", 0), ("intel", 1612)])
def test_a_real_building_is_read_and_replayed(name, left_out):
    drive = read(recorded(f"carmen/{name}.npz"))
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
    lines = [odom(10.0 + k, ARC[k % 3]) for k in range(4)]
    drive = read(
        written(tmp_path / "a.log", *lines, "ODOM 1e300 0 0 0 0 0 20.0 host 20.0", "FLASER 0 0 0 0 0 0 0 21.0 host 21.0")
    )
    assert len(drive) == 4
    assert "2 lines cannot be read" in drive.remarks[0]
    path = tmp_path / "Robot1_Odometry.dat"
    path.write_text("# a\n10.0 0.1 nan\n10.1 1e308 0.2\n10.2 0.1 0.2\n")
    with pytest.raises(ValueError, match="a drive needs two good rows, got 1"):
        read(path)
