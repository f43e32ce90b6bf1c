"""Tables: good ones are read to the bit, and what is wrong with others is said in one line with file and place."""

import numpy as np
import pytest

from turtlebot_gym.calibration import tables
from turtlebot_gym.calibration.plausibility import check
from turtlebot_gym.calibration.tables import read_table, with_truth
from turtlebot_gym.robots import ROBOTS

BURGER = ROBOTS["burger"]


def test_a_table_is_read_to_the_bit(tmp_path, drawn, write):
    log = read_table(write(tmp_path / "drive.csv", drawn.columns()))
    for name in ("time", "twist", "odometry", "truth"):
        np.testing.assert_array_equal(getattr(log, name), getattr(drawn, name))
    assert log.joined[1:].all()
    assert not log.joined[0]
    assert log.remarks == ()


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_columns_may_be_separated_and_called_otherwise(tmp_path, drawn, write, mark):
    columns = {"stamp": drawn.time, "speed": drawn.twist[:, 0], "turn": drawn.twist[:, 1], "note": drawn.time * 0.0}
    columns |= dict(zip(("px", "py", "theta"), drawn.truth.T, strict=True))
    log = read_table(write(tmp_path / "drive.csv", columns, mark=mark), columns={"omega": "turn"})
    np.testing.assert_array_equal(log.truth, drawn.truth)
    assert not log.has_odometry


def test_a_heading_belongs_to_the_positions_beside_it(tmp_path, drawn, write):
    columns = {name: drawn.columns()[name] for name in ("t", "v", "omega", "x", "y", "theta")}
    log = read_table(write(tmp_path / "drive.csv", columns))
    np.testing.assert_array_equal(log.odometry, drawn.odometry)
    assert not log.has_truth


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("omega", "wheel", 1), r"no column for omega \(omega or gyro"),
        (lambda text: text.replace("true_theta", "true", 1), r"no column for true_theta"),
        (lambda text: text.replace("omega", "v", 1), "column 'v' is there more than once"),
        (lambda text: "\n\n", "the file is empty"),
        (lambda text: text.splitlines()[0], "only 0 of 0 rows are good"),
        (lambda text: text.replace("\n0.5,", "\nhalf,", 1), "line 7: could not convert string to float: 'half'"),
        (lambda text: text.replace("\n0.5,", "\n0.5,0.0,", 1), "line 7: 10 cells instead of 9"),
        (lambda text: text.replace("\n0.5,", "\n0.5\0,", 1), "the file is binary"),
    ],
)
def test_bad_tables_are_refused_with_file_and_line(tmp_path, drawn, write, change, message):
    path = write(tmp_path / "drive.csv", drawn.columns())
    path.write_text(change(path.read_text()))
    with pytest.raises(ValueError, match=message) as refusal:
        read_table(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_binary_files_are_refused(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(ValueError, match="the file is binary"):
        read_table(path)


@pytest.mark.parametrize(
    ("spoil", "lost", "remark"),
    [
        (lambda columns: columns["v"].__setitem__([7, 9], np.nan), 2, "without a finite time and twist, first in line 9"),
        (lambda columns: columns["t"].__setitem__(50, columns["t"][49]), 1, "in which time stands still, first in line 52"),
        (lambda columns: columns["t"].__setitem__(slice(50, 53), 1.0), 3, "in which time runs backwards, first in line 52"),
    ],
)
def test_bad_rows_are_left_out_and_counted(tmp_path, drawn, write, spoil, lost, remark):
    columns = drawn.columns()
    spoil(columns)
    path = write(tmp_path / "drive.csv", columns)
    log = read_table(path)
    assert len(log.time) == 600 - lost
    assert log.remarks == (f"{path}: {lost} of 600 rows {remark}: left out",)
    # what lies on both sides of a hole is not taken for one interval
    assert (~log.joined).sum() >= 2


def test_missing_poses_are_counted_and_repeated_ones_are_missing(tmp_path, drawn, write):
    columns = drawn.columns()
    for name in ("x", "y", "theta"):
        columns[name][20] = np.nan
        columns[name][31] = columns[name][30]
    log = read_table(write(tmp_path / "drive.csv", columns))
    assert len(log.time) == 600
    assert set(np.flatnonzero(np.isnan(log.odometry[:, 0]))) == {20, 31}
    assert "measured poses are missing in 1 of 600 rows" in log.remarks[0]
    assert "repeated in 1 of 600 rows" in log.remarks[1]


def test_a_last_line_that_was_cut_short_is_left_out(tmp_path, drawn, write):
    path = write(tmp_path / "drive.csv", drawn.columns())
    path.write_text(path.read_text()[:-40])
    assert len(read_table(path).time) == 599


def test_a_table_that_is_mostly_bad_is_refused(tmp_path, drawn, write):
    columns = drawn.columns()
    columns["v"][100:] = np.nan
    with pytest.raises(ValueError, match="only 100 of 600 rows are good"):
        read_table(write(tmp_path / "drive.csv", columns))


@pytest.mark.parametrize(
    ("names", "factor", "message"),
    [
        (("v",), 1000.0, "the speed reaches 200 m/s, and the robot's limit is 0.2108: if it is in mm/s, divide it by 1000"),
        (("omega",), 180.0 / np.pi, "deg/s"),
        (("omega", "theta", "true_theta"), 180.0 / np.pi, "the turning rate reaches .* if it is in deg/s"),
        (("t",), 1e3, r"rows are 100 s apart: if time is in milliseconds, divide it by 1e\+03"),
        (("t",), 1e9, "nanoseconds"),
        (("x", "y"), 1000.0, "the measured positions move by .* if they are in millimetres, divide them by 1000"),
        (("true_x", "true_y"), 1000.0, "the true positions move by .* if they are in millimetres"),
        (("theta",), 180.0 / np.pi, "the measured heading runs from .* if it is in degrees, multiply it by pi/180"),
        (("true_theta",), 180.0 / np.pi, "the true heading runs from .* if it is in degrees"),
        (("v", "omega"), 0.0, r"the robot moves by 0.00 m and 0.00 rad in all: there is nothing to fit to"),
    ],
)
def test_wrong_units_are_noticed_by_what_a_robot_can_do(tmp_path, drawn, write, names, factor, message):
    columns = drawn.columns()
    for name in names:
        columns[name] *= factor
    path = write(tmp_path / "drive.csv", columns)
    with pytest.raises(ValueError, match=message) as refusal:
        check(read_table(path), BURGER, str(path))
    assert str(path) in str(refusal.value)


def test_right_units_pass(tmp_path, drawn, write):
    check(read_table(write(tmp_path / "drive.csv", drawn.columns())), BURGER, "drive.csv")


def test_the_truth_may_lie_in_a_file_of_its_own(tmp_path, drawn, write):
    columns = {name: drawn.columns()[name] for name in ("t", "v", "omega", "x", "y", "theta")}
    log = read_table(write(tmp_path / "drive.csv", columns))
    truth = dict(zip(("t", "x", "y", "theta"), np.column_stack([drawn.time, drawn.truth]).T, strict=True))
    both = with_truth(log, write(tmp_path / "truth.csv", truth))
    np.testing.assert_allclose(both.truth, drawn.truth, rtol=0, atol=1e-9)
    later = {**truth, "t": truth["t"] + 1000.0}
    with pytest.raises(ValueError, match="shares less than a second"):
        with_truth(log, write(tmp_path / "later.csv", later))


def test_every_name_has_a_meaning():
    assert set(tables.NAMES) == {"time", "v", "omega", "x", "y", "theta", "true_x", "true_y", "true_theta"}
