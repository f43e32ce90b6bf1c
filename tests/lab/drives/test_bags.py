"""Bags: written by rosbags, read without ROS, and refused with their name and topic."""

import math
import sys

import numpy as np
import pytest
import rosbag_messages as ros
from drawing import draw
from drive_samples import recorded
from rosbag_messages import ODOMETRY, POINT, POSE, TF, TRANSFORM, TWIST, Plugin, header, make, odometry, point, pose, write_bag

from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.drives.reading import pose_sensors
from turtlebot_gym_lab.drives.topics import Topics

SHORT = draw(120)
START = 100.0


def messages_of(drive, *, times=None, truth=POSE, command=False):
    """Return the messages of a drive; ``times`` are the stamps of the odometry."""
    messages = []
    for k, time in enumerate(START + drive.time):
        stamp_of_row = time if times is None else START + times[k]
        place = drive.truth[k]
        true = {
            POSE: lambda: make(POSE, header(time), pose(*place)),  # noqa: B023
            POINT: lambda: make(POINT, header(time), point(*place[:2])),  # noqa: B023
            TRANSFORM: lambda: ros.transform(time, place),  # noqa: B023
            TF: lambda: make(TF, [ros.transform(time, (9.0, 9.0, 0.0), "other"), ros.transform(time, place)]),  # noqa: B023
        }
        messages.append(("/odom", ODOMETRY, time, odometry(stamp_of_row, drive.odometry[k], drive.twist[k], measured=k != 17)))
        if truth:
            messages.append(("/ground_truth", truth, time, true[truth]()))
        if command and k + 1 < len(drive):
            messages.append(("/cmd_vel", TWIST, time, ros.twist(*drive.twist[k + 1])))
    return messages


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("short") / "bag", messages_of(SHORT))


@pytest.mark.parametrize("plugin", list(Plugin))
def test_a_bag_is_read_by_its_folder_and_by_its_file(tmp_path, plugin):
    folder = write_bag(tmp_path / "bag", messages_of(SHORT), plugin=plugin)
    (file,) = (path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
    for path in (folder, file):
        drive = read(path)
        np.testing.assert_allclose(drive.time, SHORT.time, atol=1e-6)
        np.testing.assert_allclose(drive.twist, SHORT.twist, atol=1e-12)
        np.testing.assert_allclose(drive.truth, SHORT.truth, atol=1e-6)
        assert list(np.flatnonzero(np.isnan(drive.odometry[:, 0]))) == [17]  # marked as lost
        there = np.arange(120) != 17
        np.testing.assert_allclose(drive.odometry[there], SHORT.odometry[there], atol=1e-9)
        assert drive.remarks == ()
        assert drive.around.label == path.name


def test_a_bag_of_ros_1_is_read(tmp_path):
    ros.write_ros_1(tmp_path / "drive.bag", messages_of(SHORT))
    drive = read(tmp_path / "drive.bag")
    np.testing.assert_allclose(drive.twist, SHORT.twist, atol=1e-12)
    np.testing.assert_allclose(drive.truth, SHORT.truth, atol=1e-6)


@pytest.mark.parametrize(("kind", "truth"), [(TRANSFORM, None), (TF, "/ground_truth:base"), (POINT, None)])
def test_the_truth_is_any_message_that_states_a_pose(tmp_path, kind, truth):
    drive = read(write_bag(tmp_path / "bag", messages_of(SHORT, truth=kind)), truth=truth)
    np.testing.assert_allclose(drive.truth[:, :2], SHORT.truth[:, :2], atol=1e-6)
    if kind == POINT:
        assert "the truth has no heading" in drive.remarks[-1]
    else:
        np.testing.assert_allclose(drive.truth[:, 2], SHORT.truth[:, 2], atol=1e-6)


def test_a_command_holds_until_the_next_one(tmp_path):
    # commands have no stamp: it is the time of their arrival
    folder = write_bag(tmp_path / "bag", messages_of(SHORT, command=True))
    drive = read(folder, topics=Topics(twist="/cmd_vel", truth="/ground_truth"))
    np.testing.assert_allclose(drive.twist[1:], SHORT.twist[1:], atol=1e-12)


def test_measured_poses_of_another_topic_belong_to_the_nearest_row(tmp_path):
    messages = messages_of(SHORT)
    messages += [
        ("/pose_fix", POSE, START + 11.0, make(POSE, header(START + 0.1 * k + 0.03), pose(k, 0.0, 0.0))) for k in (3, 40)
    ]
    drive = read(write_bag(tmp_path / "bag", messages), topics=Topics(fix="/pose_fix"))
    assert np.flatnonzero(np.isfinite(drive.odometry[:, 0])).tolist() == [3, 40]
    np.testing.assert_allclose(drive.odometry[[3, 40], 0], [3.0, 40.0])


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        (Topics(odom="/odometry"), r"there is no topic '/odometry'; there are /ground_truth, /odom"),
        (Topics(truth="/mocap"), r"there is no topic '/mocap'"),
        (Topics(twist="/odom"), r"topic '/odom' has the type nav_msgs/msg/Odometry; it must be geometry_msgs/msg/TwistStamped"),
        (Topics(fix="/odom"), "topic '/odom' is named for two quantities"),
        (Topics(scan="/odom"), "topic '/odom' has the type nav_msgs/msg/Odometry; it must be sensor_msgs/msg/LaserScan"),
    ],
)
def test_missing_and_wrong_topics_are_named(bag, topics, message):
    with pytest.raises(ValueError, match=message) as refusal:
        read(bag, topics=topics)
    assert str(bag) in str(refusal.value)


def test_transforms_need_the_name_of_a_frame_that_is_there(tmp_path):
    folder = write_bag(tmp_path / "bag", messages_of(SHORT, truth=TF))
    with pytest.raises(ValueError, match="'/ground_truth' holds transforms: name the robot's frame"):
        read(folder, truth="/ground_truth")
    with pytest.raises(ValueError, match=r"no transforms lead from 'any frame' to 'wheel'; there are world\.other"):
        read(folder, truth="/ground_truth:wheel")


def test_empty_bags_and_other_files_are_refused(tmp_path):
    with ros.rosbag2.Writer(tmp_path / "bag", version=9):
        pass
    write_bag(tmp_path / "few", messages_of(SHORT)[:1])
    (tmp_path / "folder").mkdir()
    (tmp_path / "noise.mcap").write_bytes(bytes(range(256)) * 8)
    for name, message in {
        "bag": "there is no topic '/odom'; there are none",
        "few": "two messages on odom, got 1",
        "none.mcap": "there is no such bag",
        "folder": "the bag is damaged or incomplete",
        "noise.mcap": "the bag is damaged or incomplete",
    }.items():
        with pytest.raises(ValueError, match=message):
            read(tmp_path / name)


@pytest.mark.parametrize("plugin", list(Plugin))
def test_a_bag_that_was_cut_short_is_refused_in_one_line(tmp_path, plugin):
    folder = write_bag(tmp_path / "bag", messages_of(SHORT), plugin=plugin)
    data = next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
    data.write_bytes(data.read_bytes()[: data.stat().st_size // 2])
    with pytest.raises(ValueError, match=f"^{folder}: the bag is damaged or incomplete[^\n]*$"):
        read(folder)


def test_messages_whose_time_runs_backwards_are_left_out_and_counted(tmp_path):
    times = SHORT.time.copy()
    times[50:53] = times[10]
    drive = read(write_bag(tmp_path / "bag", messages_of(SHORT, times=times)))
    assert len(drive) == 117
    assert "topic '/odom': 3 of 120 messages, first number 51, have a time that does not increase" in drive.remarks[0]


@pytest.mark.parametrize("plugin", list(Plugin))
def test_a_topic_that_was_recorded_without_messages_is_none(tmp_path, plugin):
    silent = (("/true_state", ODOMETRY), ("/pose", "geometry_msgs/msg/PoseWithCovarianceStamped"))
    folder = write_bag(tmp_path / "bag", messages_of(SHORT), plugin=plugin, silent=silent)
    assert read(folder).has_truth
    assert pose_sensors(folder) == []
    with pytest.raises(ValueError, match="there is no topic '/true_state'"):
        read(folder, truth="/true_state")


@pytest.mark.parametrize("ahead", [10.0 - 1e9, 1e9])
def test_a_truth_by_another_clock_is_refused(tmp_path, ahead):
    messages = [
        (topic, kind, time, make(POSE, header(time + ahead), pose(0.0, 0.0, 0.0)) if kind == POSE else message)
        for topic, kind, time, message in messages_of(SHORT)
    ]
    with pytest.raises(ValueError, match=r"the truth's stamps are .* s, those of the odometry .*use_sim_time"):
        read(write_bag(tmp_path / "bag", messages))


def test_without_rosbags_the_error_names_what_to_install(bag, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(ImportError, match="pip install 'rosbags"):
        read(bag)


def graph_drive():
    """Return the messages of a drive of five steps of 0.1 s along x, recorded a second late."""
    ranges = np.array([1.0, 2.0, np.inf, 0.01], np.float32)
    beams = make(ros.SCAN, header(10.2, "laser"), 0.0, 4.712, 1.5708, 0.0, 0.0, 0.1, 3.5, ranges, np.zeros(0, np.float32))
    messages = [
        ("/obstacles", ros.MARKERS, 11.0, ros.room()),
        ("/diagnostics", ros.REPORT, 11.15, ros.diagnostics(500.0, "/cmd_vel_guard", "collision monitor: slow", 1)),
        ("/reference", POSE, 11.0, make(POSE, header(10.0), pose(2.0, 1.0, 0.5))),
        ("/scan", ros.SCAN, 11.2, beams),
    ]
    for k in range(5):
        at, received = 10.0 + 0.1 * k, 11.0 + 0.1 * k
        messages += [
            ("/odom", ODOMETRY, received, odometry(at, (0.1 * k + 0.03, 0.0, 0.0), (0.2, 0.1), measured=k != 2)),
            ("/true_state", ODOMETRY, received, odometry(at, (0.1 * k, 0.0, 0.0), (0.9, 0.1))),
            (
                "/estimate",
                ODOMETRY,
                received,
                odometry(at, (0.1 * k + 0.01, 0.0, 0.0), (0.2, 0.1), variances=(0.04, 0.09, 0.01)),
            ),
            ("/nis", ros.NIS, received, make(ros.NIS, header(at), ros.vector(1.5 + k))),
            (
                "/clearance",
                ros.RANGE,
                received,
                make(ros.RANGE, header(at), 0, 6.28, -math.inf, math.inf, 0.5 - 0.125 * k, 0.0),
            ),
            ("/tracks", ros.CLOUD, received, ros.tracks(at, np.full((5, 8), 0.125 * k))),
            ("/diagnostics", ros.REPORT, received, ros.diagnostics(500.0, "/kalman_filter", "not the guard", 2)),
        ]
    messages += [("/odom", ODOMETRY, 11.41, odometry(10.4, (0.43, 0.0, 0.0), (0.2, 0.1)))]  # sent again, as in lock-step
    return sorted(messages, key=lambda message: message[2])


@pytest.mark.parametrize(("namespace", "plugin"), [("", Plugin.SQLITE3), ("/robot1", Plugin.MCAP)])
def test_the_bag_of_a_graph_is_read_completely(tmp_path, namespace, plugin):
    messages = [(topic if topic == "/diagnostics" else namespace + topic, *rest) for topic, *rest in graph_drive()]
    drive = read(write_bag(tmp_path / "bag", messages, plugin=plugin))
    x = 0.1 * np.arange(5)
    for column, expected in (
        (drive.time, x),
        (drive.true_state[:, 0], x),
        (drive.true_state[:, 3], [0.9] * 5),
        (drive.odometry[:, 0], [0.03, 0.13, np.nan, 0.33, 0.43]),  # a lost measurement is missing
        (drive.estimate[:, 0], x + 0.01),
        (drive.covariance[:, [0, 1, 2], [0, 1, 2]], [[0.04, 0.09, 0.01]] * 5),
        (drive.reference, [[2.0, 1.0, 0.5]] * 5),
        (drive.command, [[0.2, 0.1]] * 5),
        (drive.nis, 1.5 + np.arange(5)),
        (drive.clearance, 0.5 - 0.125 * np.arange(5)),
        (drive.tracks, np.full((5, 8, 5), 0.125 * np.arange(5)).transpose(2, 0, 1)),
    ):
        np.testing.assert_allclose(column, expected, atol=1e-6)
    np.testing.assert_array_equal(drive.level, [np.nan, np.nan, 1.0, 1.0, 1.0])  # by the recorder's clock
    assert drive.report[-1] == "collision monitor: slow"
    assert drive.around.room.walls == pytest.approx((0.0, 0.0, 3.0, 2.0))
    assert drive.around.room.circles[0] == pytest.approx((1.0, 0.5, 0.3))
    assert drive.around.room.boxes[0] == pytest.approx((-1.0, -1.0, 0.4, 0.2, 0.7))
    (seen,) = drive.scans
    assert seen.row == 2
    assert seen.lidar == pytest.approx((0.2 - 0.032, 0.0, 0.0))  # the Burger's LiDAR stands behind its centre
    np.testing.assert_array_equal(seen.scan.ranges, [1.0, 2.0, np.inf, np.nan])  # a missing beam is not a free one


def test_scans_on_another_topic_are_named_and_read_by_name(tmp_path):
    messages = [("/front/scan" if topic == "/scan" else topic, *rest) for topic, *rest in graph_drive()]
    path = write_bag(tmp_path / "bag", messages)
    assert any("add --topics.scan /front/scan" in remark for remark in read(path).remarks)
    assert len(read(path, topics=Topics(scan="/front/scan")).scans) == 1


@pytest.mark.parametrize(("frame", "mount"), [("laser", (-0.05, 0.02, 1.5)), ("other", (-0.032, 0.0, 0.0))])
def test_the_mount_of_the_lidar_is_that_of_tf_static_if_it_states_it(tmp_path, frame, mount):
    tree = make(TF, [ros.transform(0.0, (-0.05, 0.02, 1.5), "laser")])
    tree.transforms[0].header.frame_id = "base"
    messages = [("/tf_static", TF, 10.9, tree), *graph_drive()]
    for topic, _, _, message in messages:
        if topic == "/scan":
            message.header.frame_id = frame
    drive = read(write_bag(tmp_path / "bag", messages))
    (seen,) = drive.scans
    assert seen.mount == pytest.approx(mount)
    assert seen.lidar == pytest.approx((0.2 + mount[0], *mount[1:]))
    assert any("by /tf_static and not by its preset" in remark for remark in drive.remarks) == (frame == "laser")


def test_a_value_holds_for_a_second_and_what_was_not_recorded_is_unknown(tmp_path):
    messages = [("/odom", ODOMETRY, 10.0 + t, odometry(10.0 + t, (0.0, 0.0, 0.0))) for t in (0.0, 0.5, 1.1)]
    messages.append(("/estimate", ODOMETRY, 10.0, odometry(10.0, (3.0, 0.0, 0.0))))
    messages.append(("/reference", POSE, 10.0, make(POSE, header(10.0), pose(7.0, 0.0, 0.0))))
    drive = read(write_bag(tmp_path / "bag", messages), label="the floor")
    np.testing.assert_array_equal(drive.estimate[:, 0], [3.0, 3.0, np.nan])
    assert (drive.around.label, drive.around.room, drive.scans) == ("the floor", None, ())
    assert np.isnan(drive.true_state).all()
    np.testing.assert_array_equal(drive.reference[:, 0], [7.0, 7.0, 7.0])  # a waypoint holds indefinitely


def test_the_bag_of_a_real_turtlebot3_says_what_is_odd_in_it():
    drive = read(recorded("turtlebot3"))
    assert len(drive) == 1254
    assert len(drive.scans) >= 548
    assert drive.scans[0].mount == pytest.approx((-0.032, 0.0, 0.0))
    assert np.abs(drive.twist[:, 1]).max() < 1.0  # not 143.6 rad/s, as its driver says once
    (wound_up,) = drive.remarks
    assert "1 turning rates are more than half a turn to a row, first at 31.747 s" in wound_up
