"""Bags: written by rosbags, read without ROS, and what is wrong with one is said with its name and topic."""

import math
import shutil
import sys

import numpy as np
import pytest

from turtlebot_gym.calibration.bags import Topics, is_bag, read_bag

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs rosbags, of the extras [deploy] and [ros]")
typesys = pytest.importorskip("rosbags.typesys")

StoragePlugin, Writer = rosbag2.StoragePlugin, rosbag2.Writer
TYPES = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
T = TYPES.types
ZERO = np.zeros(36)


def stamp(time):
    seconds = math.floor(time)
    return T["builtin_interfaces/msg/Time"](sec=seconds, nanosec=round((time - seconds) * 1e9))


def header(time):
    return T["std_msgs/msg/Header"](stamp=stamp(time), frame_id="odom")


def vector(x=0.0, y=0.0, z=0.0):
    return T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def pose(row):
    x, y, theta = map(float, row)
    turn = T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(theta / 2.0), w=math.cos(theta / 2.0))
    return T["geometry_msgs/msg/Pose"](position=T["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), orientation=turn)


def odometry(time, row, twist, *, lost=False):
    covariance = ZERO.copy()
    covariance[0] = -1.0 if lost else 0.0
    told = T["geometry_msgs/msg/Twist"](linear=vector(x=float(twist[0])), angular=vector(z=float(twist[1])))
    return T["nav_msgs/msg/Odometry"](
        header=header(time),
        child_frame_id="base",
        pose=T["geometry_msgs/msg/PoseWithCovariance"](pose=pose(row), covariance=covariance),
        twist=T["geometry_msgs/msg/TwistWithCovariance"](twist=told, covariance=ZERO),
    )


def write_bag(folder, drawn, *, plugin=StoragePlugin.SQLITE3, truth=True, command=False, rows=None, times=None):
    """Write a drive as a bag; ``times`` are the stamps."""
    times = drawn.time if times is None else times
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        odom = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=TYPES)
        true = writer.add_connection("/ground_truth", "geometry_msgs/msg/PoseStamped", typestore=TYPES) if truth else None
        told = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=TYPES) if command else None
        for k in range(len(drawn.time) if rows is None else rows):
            at = 100_000_000_000 + round(drawn.time[k] * 1e9)

            def add(connection, message, kind, at=at):
                writer.write(connection, at, TYPES.serialize_cdr(message, kind))

            add(odom, odometry(100.0 + times[k], drawn.odometry[k], drawn.twist[k], lost=k == 17), "nav_msgs/msg/Odometry")
            if true is not None:
                here = T["geometry_msgs/msg/PoseStamped"](header=header(100.0 + drawn.time[k]), pose=pose(drawn.truth[k]))
                add(true, here, "geometry_msgs/msg/PoseStamped")
            if told is not None and k + 1 < len(drawn.time):
                v, omega = map(float, drawn.twist[k + 1])
                add(told, T["geometry_msgs/msg/Twist"](linear=vector(x=v), angular=vector(z=omega)), "geometry_msgs/msg/Twist")
    return folder


@pytest.fixture(scope="module")
def short(draw_drive):
    return draw_drive(120)


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_bag_is_read(tmp_path, short, plugin):
    folder = write_bag(tmp_path / "bag", short, plugin=plugin)
    assert is_bag(folder)
    log = read_bag(folder)
    np.testing.assert_allclose(log.time, short.time, atol=1e-6)
    np.testing.assert_allclose(log.twist, short.twist, atol=1e-12)
    np.testing.assert_allclose(log.truth, short.truth, atol=1e-6)
    assert list(np.flatnonzero(np.isnan(log.odometry[:, 0]))) == [17]  # marked as lost
    there = np.arange(120) != 17
    np.testing.assert_allclose(log.odometry[there], short.odometry[there], atol=1e-9)
    assert log.remarks == ()


def test_a_command_holds_until_the_next_one(tmp_path, short):
    folder = write_bag(
        tmp_path / "bag", short, command=True, times=short.time
    )  # commands have no stamp: it is the time of their arrival
    log = read_bag(folder, topics=Topics(twist="/cmd_vel", truth="/ground_truth"))
    np.testing.assert_allclose(log.twist[1:], short.twist[1:], atol=1e-12)


@pytest.mark.parametrize(
    ("topics", "message"),
    [
        (Topics(odom="/odometry"), r"there is no topic '/odometry'; there are /ground_truth, /odom"),
        (Topics(truth="/mocap"), r"there is no topic '/mocap'"),
        (Topics(twist="/odom"), r"topic '/odom' has the type nav_msgs/msg/Odometry; it must be geometry_msgs/msg/TwistStamped"),
    ],
)
def test_missing_and_wrong_topics_are_named(tmp_path, short, topics, message):
    folder = write_bag(tmp_path / "bag", short)
    with pytest.raises(ValueError, match=message) as refusal:
        read_bag(folder, topics=topics)
    assert str(folder) in str(refusal.value)


def test_an_empty_bag_is_refused(tmp_path, short):
    with Writer(tmp_path / "bag", version=9):
        pass
    with pytest.raises(ValueError, match=r"bag: .*(empty|damaged or incomplete)"):
        read_bag(tmp_path / "bag")
    few = write_bag(tmp_path / "few", short, rows=3)
    with pytest.raises(ValueError, match="topic '/odom' has 3 messages"):
        read_bag(few)


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(ValueError, match="there is no such bag"):
        read_bag(tmp_path / "none")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ValueError, match="the bag is damaged or incomplete"):
        read_bag(tmp_path / "folder")
    (tmp_path / "noise.mcap").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(ValueError, match="the bag is damaged or incomplete"):
        read_bag(tmp_path / "noise.mcap")


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_truncated_bag_is_refused_or_its_good_part_used(tmp_path, short, plugin):
    folder = write_bag(tmp_path / "bag", short, plugin=plugin)
    data = next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
    data.write_bytes(data.read_bytes()[: data.stat().st_size // 2])
    said = ""
    try:
        log = read_bag(folder)
    except ValueError as refusal:
        said = str(refusal)
    else:
        assert len(log.time) < 120
        said = log.remarks[-1]
    assert said.startswith(f"{folder}: ")
    assert "cut short" in said or "the bag is damaged or incomplete" in said or "messages" in said
    assert "\n" not in said


def test_messages_whose_time_runs_backwards_are_left_out_and_counted(tmp_path, short):
    times = short.time.copy()
    times[50:53] = times[10]
    log = read_bag(write_bag(tmp_path / "bag", short, times=times))
    assert len(log.time) == 117
    assert "topic '/odom': 3 of 120 messages, first number 51, have a time that does not increase" in log.remarks[0]


def test_without_rosbags_it_is_said_what_to_install(tmp_path, short, monkeypatch):
    folder = write_bag(tmp_path / "bag", short)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(ImportError, match="pip install 'rosbags"):
        read_bag(folder)
    shutil.rmtree(folder)
