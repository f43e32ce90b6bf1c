"""Odometry is optional where a truth and the commands are there; where it is not, one line says why."""

import re

import numpy as np
import pytest
import rosbag_messages as ros
from drawing import draw
from rosbag_messages import ODOMETRY, POSE, TF, TWIST, Plugin, header, make, odometry, pose, write_bag

from turtlebot_gym.values import ORIGIN
from turtlebot_gym_lab.calibration import calibrate
from turtlebot_gym_lab.commands.recorded import StartOptions
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.drives.reading import pose_sensors
from turtlebot_gym_lab.evaluation.replay import dead_reckoning

pytestmark = pytest.mark.touched("lab", "tests/lab")

START = 1.7e9
DRAWN = draw(900, scale=0.9, deviations=(0.0, 0.0, 0.0), alphas=(0.002, 0.0, 0.0, 0.002))


def messages(*, wheels=True, truth: str | None = "/ground_truth", tree=False, commands="/cmd_vel"):
    said = []
    for k, time in enumerate(START + DRAWN.time):
        if wheels:
            said.append(("/odom", ODOMETRY, time, odometry(time, DRAWN.truth[k], DRAWN.twist[k])))
        if truth:
            said.append((truth, POSE, time + 1e-3, make(POSE, header(time), pose(*DRAWN.truth[k]))))
        if tree:
            said.append(("/tf", TF, time + 1e-3, make(TF, [ros.transform(time, DRAWN.truth[k], "base", "map")])))
            said.append(("/tf", TF, time + 1e-3, make(TF, [ros.transform(time, DRAWN.truth[k], "base", "odom")])))
        if commands and k + 1 < len(DRAWN):
            said.append((commands, TWIST, time + 2e-3, ros.twist(*DRAWN.twist[k + 1])))
    return said


@pytest.mark.sample(1)
@pytest.mark.parametrize("truth", [None, "/mocap/robot", "/tf:map.base"])
def test_the_truth_gives_the_rows_and_the_commands_the_twist(tmp_path, truth):
    topic = {None: "/ground_truth", "/tf:map.base": ""}.get(truth, truth)
    drive = read(write_bag(tmp_path / "bag", messages(wheels=False, truth=topic, tree=not topic)), truth=truth)
    assert len(drive) == len(DRAWN)
    np.testing.assert_allclose(drive.truth, DRAWN.truth, atol=1e-6)
    np.testing.assert_allclose(drive.twist[1:], DRAWN.twist[1:], atol=1e-9)
    assert not drive.has_odometry
    (remark,) = drive.remarks
    assert (
        f"there is no odometry: the truth on '{topic or '/tf'}' gives the rows, the commands on '/cmd_vel' the twist" in remark
    )
    fitted = calibrate(drive).estimates["scale"]
    assert fitted.low < 0.9 < fitted.high
    assert fitted.high - fitted.low < 0.02


def test_with_odometry_its_own_rows_count(tmp_path):
    """The law can fail: with odometry there are no rows of the truth, and no such remark."""
    drive = read(write_bag(tmp_path / "bag", messages()))
    assert drive.has_odometry
    assert not any("there is no odometry" in remark for remark in drive.remarks)


@pytest.mark.parametrize("plugin", list(Plugin))
def test_a_topic_that_was_recorded_without_messages_is_none(tmp_path, plugin):
    silent = (("/odom", ODOMETRY), ("/true_state", ODOMETRY), ("/pose", "geometry_msgs/msg/PoseWithCovarianceStamped"))
    folder = write_bag(tmp_path / "bag", messages(wheels=False), plugin=plugin, silent=silent)
    assert len(read(folder)) == len(DRAWN)
    assert pose_sensors(folder) == []
    with pytest.raises(ValueError, match="topic '/true_state' has no messages"):
        read(folder, truth="/true_state")


def test_a_localizer_adds_the_commands_up(tmp_path):
    drive = read(write_bag(tmp_path / "bag", messages(wheels=False)))
    moved = StartOptions().localizable(drive)
    assert moved.has_odometry
    np.testing.assert_array_equal(moved.odometry, dead_reckoning(drive, start=ORIGIN))
    assert "there is no odometry: the twist, added up, stands for it" in moved.remarks[-1]
    assert StartOptions().localizable(moved) is moved


@pytest.mark.parametrize(
    ("options", "truth", "said"),
    [
        ({"truth": ""}, None, "it lacks a truth to compare them with; there are /cmd_vel."),
        ({"truth": "/mocap"}, None, "it lacks a truth to compare them with: did you mean --truth /mocap?"),
        ({"commands": ""}, None, "it lacks commands (there is no '/cmd_vel'; name them by --topics.twist)"),
        ({"tree": True, "truth": ""}, "/tf:odom.base", "is the odometry itself"),
    ],
)
def test_what_is_not_enough_is_refused_in_one_line(tmp_path, options, truth, said):
    folder = write_bag(tmp_path / "bag", messages(wheels=False, **options))
    with pytest.raises(ValueError, match=re.escape(said)) as refusal:
        read(folder, truth=truth)
    assert "\n" not in str(refusal.value)


def test_odometry_on_another_topic_is_proposed(tmp_path):
    said = [("/wheels" if topic == "/odom" else topic, *rest) for topic, *rest in messages(truth="", commands="")]
    with pytest.raises(ValueError, match=r"did you mean --topics\.odom /wheels\?"):
        read(write_bag(tmp_path / "bag", said))
