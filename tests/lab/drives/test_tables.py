"""Tables: good ones are read to the bit, and faults of others are reported in one line with file and place."""

import re

import numpy as np
import pytest
from drawing import columns_of, draw, write

from turtlebot_gym.robots import ROBOTS
from turtlebot_gym_lab.calibration.plausibility import check
from turtlebot_gym_lab.drives import read

BURGER = ROBOTS["burger"]
DRAWN = draw()


@pytest.fixture
def columns():
    return columns_of(DRAWN)


@pytest.mark.parametrize("mark", [",", ", ", ";", "\t", " "])
def test_a_table_is_read_to_the_bit(tmp_path, columns, mark):
    drive = read(write(tmp_path / "drive.csv", columns, mark=mark))
    for name in ("time", "twist", "odometry", "truth"):
        np.testing.assert_array_equal(getattr(drive, name), getattr(DRAWN, name))
    assert drive.joined.tolist() == [False] + [True] * 599
    assert drive.remarks == ()
    assert drive.around.label == "drive.csv"


def test_arrays_are_read_as_a_table_is(tmp_path, columns):
    np.savez(tmp_path / "columns.npz", **columns)
    np.savez(tmp_path / "drive.npz", time=DRAWN.time, twist=DRAWN.twist, odometry=DRAWN.odometry, true_state=DRAWN.true_state)
    for name in ("columns.npz", "drive.npz"):
        drive = read(tmp_path / name)
        np.testing.assert_array_equal(drive.twist, DRAWN.twist)
        np.testing.assert_array_equal(drive.odometry, DRAWN.odometry)
        np.testing.assert_array_equal(drive.truth, DRAWN.truth)


def test_columns_may_have_other_names_and_others_between_them(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text('# "note",omega,v,y,x,yaw,stamp\n0,1,2,3,4,5,6\n0,1.5,2.5,3.5,4.5,5.5,6.5\n')
    drive = read(path, columns={"true_x": "x", "true_y": "y", "true_theta": "yaw"})
    np.testing.assert_array_equal(drive.time, [6.0, 6.5])
    np.testing.assert_array_equal(drive.twist, [[2.0, 1.0], [2.5, 1.5]])
    np.testing.assert_array_equal(drive.truth, [[4.0, 3.0, 5.0], [4.5, 3.5, 5.5]])
    assert not drive.has_odometry


def test_a_heading_belongs_to_the_positions_beside_it(tmp_path, columns):
    measured = {name: columns[name] for name in ("t", "v", "omega", "x", "y", "theta")}
    drive = read(write(tmp_path / "drive.csv", measured))
    np.testing.assert_array_equal(drive.odometry, DRAWN.odometry)
    assert not drive.has_truth
    true = {"t": DRAWN.time, "vx": columns["v"], "gyro": columns["omega"]} | dict(
        zip(("px", "py", "theta"), DRAWN.truth.T, strict=True)
    )
    drive = read(write(tmp_path / "drive.csv", true))
    np.testing.assert_array_equal(drive.truth, DRAWN.truth)
    assert not drive.has_odometry


def test_a_truth_without_heading_has_that_of_its_motion(tmp_path, columns):
    del columns["true_theta"]
    drive = read(write(tmp_path / "drive.csv", columns))
    known = np.isfinite(drive.truth[:, 2])
    assert 0.4 < known.mean() < 0.9  # not while it turns on the spot
    off = np.remainder(drive.truth[known, 2] - DRAWN.truth[known, 2] + np.pi, 2.0 * np.pi) - np.pi
    assert np.abs(off).mean() < 0.02  # half of the turn in a row
    assert "the truth has no heading: the direction of motion is taken" in drive.remarks[-1]


GOOD = "t,vx,gyro,px,py,theta"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,vx,px,py,theta\n0,0,0,0,0\n1,0,0,0,0\n", r"no column for omega \(omega or gyro.*; there are 't', 'vx', 'px', 'py'"),
        ("t,v,omega,x,theta\n0,0,0,0,0\n1,0,0,0,0\n", r"no column for y \(y or odom_y"),
        (f"{GOOD},vx\n0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n", "a column is there more than once"),
        (f"{GOOD}\n0,0,0,0,0\n1,0,0,0,0\n", "its rows have 5 cells instead of 6"),
        (f"{GOOD}\n0,0,0,0,0,0\n1,zero,0,0,0,0\n", "only 1 of 2 rows are good; a drive has at least two"),
        (",".join(f"c{k}" for k in range(40)) + "\n", "there are 'c0', .*'c11' and 28 more"),
        ("\0\1\2", "it is no text with named columns"),
    ],
)
def test_bad_tables_are_refused_with_file_and_line(tmp_path, text, message):
    path = tmp_path / "drive.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: .*{message}[^\n]*$"):
        read(path)


def test_a_file_that_is_not_a_table_is_refused(tmp_path):
    with pytest.raises(OSError, match=r"none\.csv"):
        read(tmp_path / "none.csv")
    np.savez(tmp_path / "short.npz", t=np.arange(3.0), v=np.arange(4.0))
    with pytest.raises(ValueError, match="equally long"):
        read(tmp_path / "short.npz")


@pytest.mark.parametrize(
    ("spoil", "first", "lost"),
    [
        (lambda columns: columns["v"].__setitem__([7, 9], np.nan), 8, 2),
        (lambda columns: columns["t"].__setitem__(slice(50, 53), 1.0), 51, 3),
    ],
)
def test_bad_rows_are_left_out_and_counted(tmp_path, columns, spoil, first, lost):
    spoil(columns)
    path = write(tmp_path / "drive.csv", columns)
    drive = read(path)
    assert len(drive) == 600 - lost
    assert re.search(f"{lost} of 600 rows .* a time that does not increase, first row {first}", drive.remarks[0])
    # what lies on both sides of a hole is not taken for one interval
    assert (~drive.joined).sum() >= 2


def test_poses_that_are_missing_or_repeated_are_not_measured(tmp_path, columns):
    for name in ("x", "y", "theta"):
        columns[name][20] = np.nan
        columns[name][31] = columns[name][30]
    drive = read(write(tmp_path / "drive.csv", columns))
    assert set(np.flatnonzero(np.isnan(drive.odometry[:, 0]))) == {20, 31}
    assert "1 of 600 measured poses are repeated" in drive.remarks[0]


def test_a_last_line_that_was_cut_short_is_left_out(tmp_path, columns):
    path = write(tmp_path / "drive.csv", columns)
    path.write_text(path.read_text()[:-40])
    drive = read(path)
    assert len(drive) == 599
    assert "got 8 columns instead of 9" in drive.remarks[0]


def test_estimate_reference_and_command_are_read_as_they_are(tmp_path, columns):
    names = [f"estimate_{name}" for name in ("x", "y", "theta", "v", "omega")]
    names += ["reference_x", "reference_y", "reference_theta", "cmd_vel_v", "cmd_vel_omega"]
    values = np.arange(6000.0).reshape(600, 10)
    drive = read(write(tmp_path / "drive.csv", columns | dict(zip(names, values.T, strict=True))))
    np.testing.assert_array_equal(np.column_stack([drive.estimate, drive.reference, drive.command]), values)
    np.testing.assert_array_equal(drive.twist, DRAWN.twist)


@pytest.mark.parametrize(
    ("names", "factor", "message"),
    [
        (("v",), 1000.0, "the speed reaches 200 m/s, and the robot's limit is 0.2108: if it is in mm/s, divide it by 1000"),
        (("omega", "theta", "true_theta"), 180.0 / np.pi, "the turning rate reaches .* if it is in deg/s"),
        (("t",), 1e3, r"rows are 100 s apart: if time is in milliseconds, divide it by 1e\+03"),
        (("x", "y"), 1000.0, "the measured positions span .* if they are in millimetres, divide them by 1000"),
        (("true_theta",), 180.0 / np.pi, "the true heading runs from .* if it is in degrees"),
        (("v", "omega"), 0.0, r"the robot moves by 0.00 m and 0.00 rad in all: there is nothing to fit to"),
    ],
)
def test_wrong_units_are_noticed_by_what_a_robot_can_do(tmp_path, columns, names, factor, message):
    path = write(tmp_path / "drive.csv", columns)
    check(read(path), BURGER, str(path))
    for name in names:
        columns[name] *= factor
    with pytest.raises(ValueError, match=message) as refusal:
        check(read(write(path, columns)), BURGER, str(path))
    assert str(path) in str(refusal.value)


def test_a_short_drive_is_not_calibrated():
    with pytest.raises(ValueError, match="only 19 rows are good, too few to calibrate; 20 are needed"):
        check(DRAWN[:19], BURGER, "drive.csv")


def test_the_truth_may_be_in_a_file_of_its_own(tmp_path, columns):
    path = write(tmp_path / "drive.csv", {name: columns[name] for name in ("t", "v", "omega", "x", "y", "theta")})
    truth = dict(zip(("t", "x", "y", "theta"), np.column_stack([DRAWN.time, DRAWN.truth]).T, strict=True))
    drive = read(path, truth=write(tmp_path / "truth.csv", truth))
    np.testing.assert_allclose(drive.truth, DRAWN.truth, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(drive.odometry, DRAWN.odometry)
    later = {**truth, "t": truth["t"] + 1000.0}
    with pytest.raises(ValueError, match="shares less than a second"):
        read(path, truth=write(tmp_path / "later.csv", later))
    with pytest.raises(ValueError, match="truth must be auto, none, or a file where the recording is no bag, got '/mocap'"):
        read(path, truth="/mocap")
