"""Clocks and missing rows: each fault is noticed and handled, and a drive without one is left as it is."""

import re
from dataclasses import replace

import numpy as np
import pytest
import rosbag_messages as ros
from drawing import columns_of, draw, write
from drive_samples import COLUMNS
from rosbag_messages import ODOMETRY, POSE, header, make, odometry, pose, write_bag

from turtlebot_gym.drive import Drive
from turtlebot_gym_lab.calibration import calibrate
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.drives.topics import Topics
from turtlebot_gym_lab.evaluation.replay import replayable

WHOLE = draw(1500)
KEPT = np.random.default_rng(1).random(len(WHOLE)) > 0.02
KEPT[:2] = True


def thinned(time):
    return Drive(time=time, **{name: getattr(WHOLE, name)[KEPT] for name in COLUMNS})


@pytest.mark.parametrize("drive", [WHOLE, replace(WHOLE, time=np.cumsum(np.random.default_rng(0).uniform(0.06, 0.14, 1500)))])
def test_a_drive_without_fault_is_read_as_it_is(tmp_path, drive):
    read_back = read(write(tmp_path / "drive.csv", columns_of(drive)))
    assert read_back.remarks == ()
    assert read_back.joined[1:].all()


def test_rows_that_are_missing_with_their_time_are_counted(tmp_path):
    missing = int((~KEPT).sum())
    read_back = read(write(tmp_path / "drive.csv", columns_of(thinned(WHOLE.time[KEPT]))))
    assert any(f"{missing} rows are missing at" in remark for remark in read_back.remarks)
    assert read_back.joined[1:].all()


def test_rows_that_are_missing_without_a_gap_in_time_are_noticed(tmp_path):
    drive = thinned(WHOLE.time[: KEPT.sum()])
    read_back = read(write(tmp_path / "drive.csv", columns_of(drive)))
    (rows,) = [
        int(rows) for rows in re.findall(r"the truth leaps ahead of the twist at (\d+) rows", " ".join(read_back.remarks))
    ]
    after = np.flatnonzero(~KEPT) - np.arange((~KEPT).sum())  # the rows that follow a missing one
    moving = np.abs(drive.twist[after[after < len(drive)]]).max(axis=1) > 0.05
    assert 0.9 * moving.sum() <= rows <= 0.05 * len(drive)


def test_a_clock_that_is_set_back_goes_on(tmp_path):
    time = WHOLE.time.copy()
    time[700:] -= 65.0
    read_back = read(write(tmp_path / "drive.csv", columns_of(replace(WHOLE, time=time))))
    assert len(read_back) == len(WHOLE)
    np.testing.assert_allclose(read_back.time, WHOLE.time, atol=1e-6)
    assert "the clock was set back 1 times, first by 64.900 s" in read_back.remarks[0]
    assert np.flatnonzero(~read_back.joined).tolist() == [0, 700]


def bag(folder, *, ahead=0.0, back=0.0, delay=0.002, truth=0.0):
    """Write a drive whose truth comes from another computer, and whose robot's clock is ahead, and set back on the way."""
    rng, messages = np.random.default_rng(0), []
    for k, time in enumerate(1e9 + WHOLE.time[:200]):
        stamp = time + ahead - (back if k >= 100 else 0.0)
        messages.append(
            ("/odom", ODOMETRY, time + delay + rng.exponential(0.01), odometry(stamp, WHOLE.odometry[k], WHOLE.twist[k]))
        )
        messages.append(("/ground_truth", POSE, time + 0.003, make(POSE, header(time + truth), pose(*WHOLE.truth[k]))))
        messages.append(("/cmd_vel", ros.TWIST, time + 0.02, ros.twist(*WHOLE.twist[min(k + 1, 199)])))
    return write_bag(folder, sorted(messages, key=lambda message: message[2]))


@pytest.mark.parametrize("ahead", [0.775, -0.775])
def test_a_truth_by_another_clock_is_moved_to_that_of_the_robot(tmp_path, ahead):
    read_back = read(bag(tmp_path / "bag", ahead=ahead), topics=Topics(twist="/cmd_vel"))
    np.testing.assert_allclose(read_back.truth[1:199], WHOLE.truth[1:199], atol=0.005)  # to 5 ms of driving
    np.testing.assert_allclose(read_back.twist[1:], WHOLE.twist[1:200], atol=1e-9)
    moved = [
        remark for remark in read_back.remarks if "of that of the odometry" in remark or "that of the odometry: its" in remark
    ]
    assert len(moved) == 2  # truth and commands
    assert all(("behind" if ahead > 0.0 else "ahead of") in remark for remark in moved)


def test_a_short_delay_is_no_other_clock(tmp_path):
    assert read(bag(tmp_path / "bag", delay=0.2)).remarks == ()


@pytest.mark.parametrize("apart", [{"ahead": 10.0 - 1e9}, {"truth": 10.0 - 1e9}])
@pytest.mark.parametrize("use", [lambda drive: calibrate(drive, kind="wheel"), replayable])
def test_wall_and_simulated_time_are_named_where_the_truth_is_needed(tmp_path, apart, use):
    drive = read(bag(tmp_path / "bag", **apart))
    starts = (10.0 if apart.get(name) else 1e9 for name in ("truth", "ahead"))
    truth, odom = (f"{start:.3f} to {start + 19.9:.3f} s" for start in starts)
    said = f"'/ground_truth': its clock is not that of the odometry: its stamps are {truth}, .* {odom}: .*use_sim_time"
    with pytest.raises(ValueError, match=said):
        use(drive)


def test_a_robot_whose_clock_is_set_back_drives_on(tmp_path):
    read_back = read(bag(tmp_path / "bag", back=30.0))
    assert len(read_back) == 200
    np.testing.assert_allclose(read_back.time, WHOLE.time[:200], atol=0.1)
    assert any("topic '/odom': the clock was set back 1 times" in remark for remark in read_back.remarks)


def test_a_turn_that_a_driver_winds_up_is_taken_from_the_headings(tmp_path):
    drive = replace(WHOLE, odometry=WHOLE.true_state[:, :3], twist=WHOLE.twist.copy())
    drive.twist[40, 1] += 2.0 * np.pi / 0.1
    read_back = read(write(tmp_path / "drive.csv", columns_of(drive)))
    assert read_back.twist[40, 1] == pytest.approx(WHOLE.twist[40, 1], abs=0.3)
    assert "1 turning rates are more than half a turn to a row" in read_back.remarks[0]
