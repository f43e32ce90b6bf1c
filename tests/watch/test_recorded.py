"""Recorded drives: what a bag, snapshots and tables say is in the track, at the time at which it was said."""

import math

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from turtlebot_gym_agents.watch import read_recorded
from turtlebot_gym_agents.watch.bag import _grid

TYPES = get_typestore(Stores.ROS2_JAZZY)
KINDS = {
    "/odom": "nav_msgs/msg/Odometry",
    "/true_state": "nav_msgs/msg/Odometry",
    "/estimate": "nav_msgs/msg/Odometry",
    "/reference": "geometry_msgs/msg/PoseStamped",
    "/nis": "diagnostic_msgs/msg/DiagnosticArray",
    "/clearance": "sensor_msgs/msg/Range",
    "/scan": "sensor_msgs/msg/LaserScan",
    "/obstacles": "visualization_msgs/msg/MarkerArray",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


def make(kind, *values, **named):
    return TYPES.types[kind](*values, **named)


def stamp_of(seconds):
    return make("builtin_interfaces/msg/Time", int(seconds), round((seconds - int(seconds)) * 1e9))


def header(seconds, frame="odom"):
    return make("std_msgs/msg/Header", stamp_of(seconds), frame)


def vector(x, y, z=0.0):
    return make("geometry_msgs/msg/Vector3", x, y, z)


def pose(x, y, theta):
    turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(theta / 2.0), math.cos(theta / 2.0))
    return make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", x, y, 0.0), turn)


def odometry(seconds, x, *, y=0.0, theta=0.0, v=0.2, variances=(0.0, 0.0, 0.0), measured=True):
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = variances
    covariance[0] = covariance[0] if measured else -1.0
    twist = make("geometry_msgs/msg/Twist", vector(v, 0.0), vector(0.0, 0.0, 0.1))
    return make(
        KINDS["/odom"],
        header(seconds),
        "base",
        make("geometry_msgs/msg/PoseWithCovariance", pose(x, y, theta), covariance),
        make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
    )


def diagnostics(seconds, name, text, level=0, **values):
    pairs = [make("diagnostic_msgs/msg/KeyValue", key, str(value)) for key, value in values.items()]
    status = make("diagnostic_msgs/msg/DiagnosticStatus", level, name, text, "", pairs)
    return make(KINDS["/nis"], header(seconds), [status])


def marker(kind, at, size, points=()):
    return make(
        "visualization_msgs/msg/Marker",
        header(10.0), "obstacles", 0, kind, 0, at, size, make("std_msgs/msg/ColorRGBA", 0.0, 0.0, 0.0, 1.0),
        make("builtin_interfaces/msg/Duration", 0, 0), False,
        [make("geometry_msgs/msg/Point", x, y, 0.0) for x, y in points], [], "",
        make("sensor_msgs/msg/CompressedImage", header(0.0), "", np.zeros(0, np.uint8)), [], "", "",
        make("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8)), False,
    )  # fmt: skip


def room():
    corners = [(-3.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-3.0, 2.0), (-3.0, -2.0)]
    return make(
        KINDS["/obstacles"],
        [
            marker(4, pose(0.0, 0.0, 0.0), vector(0.05, 0.0), corners),
            marker(3, pose(1.0, 0.5, 0.0), vector(0.6, 0.6, 0.3)),
            marker(1, pose(-1.0, -1.0, 0.7), vector(0.4, 0.2, 0.3)),
        ],
    )


def scan(seconds):
    ranges = np.array([1.0, 2.0, np.inf, 0.01], np.float32)
    return make(
        KINDS["/scan"], header(seconds, "laser"), 0.0, 4.712, 1.5708, 0.0, 0.0, 0.1, 3.5, ranges, np.zeros(0, np.float32)
    )


def write(folder, said, *, namespace="", storage=StoragePlugin.SQLITE3):
    """Write messages, each with the time at which it was received."""
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        open_ = {
            topic: writer.add_connection(topic if topic == "/diagnostics" else namespace + topic, KINDS[topic], typestore=TYPES)
            for topic in {topic for topic, _, _ in said}
        }
        for topic, received, message in said:
            writer.write(open_[topic], round(received * 1e9), TYPES.serialize_cdr(message, KINDS[topic]))


def drive():
    """Return what is said in a drive of five steps of 0.1 s along x, recorded a second late."""
    said = [
        ("/obstacles", 11.0, room()),
        ("/diagnostics", 11.15, diagnostics(500.0, "/cmd_vel_guard", "collision monitor: slow", 1)),
    ]
    for k in range(5):
        at = 10.0 + 0.1 * k
        said += [
            ("/odom", at + 1.0, odometry(at, 0.1 * k + 0.03, measured=k != 2)),
            ("/true_state", at + 1.0, odometry(at, 0.1 * k, v=0.9)),
            ("/estimate", at + 1.0, odometry(at, 0.1 * k + 0.01, variances=(0.04, 0.09, 0.01))),
            ("/nis", at + 1.0, diagnostics(at, "innovation", "as expected", nis=1.5 + k)),
            ("/clearance", at + 1.0, make(KINDS["/clearance"], header(at), 0, 6.28, -math.inf, math.inf, 0.5 - 0.125 * k, 0.0)),
            ("/diagnostics", at + 1.0, diagnostics(500.0, "/kalman_filter", "not the guard", 2)),
        ]
    said += [("/reference", 11.0, make(KINDS["/reference"], header(10.0), pose(2.0, 1.0, 0.5))), ("/scan", 11.2, scan(10.2))]
    said += [("/odom", 11.41, odometry(10.4, 0.43))]  # said again, as in lock-step
    return sorted(said, key=lambda each: each[1])


@pytest.mark.parametrize(("namespace", "storage"), [("", StoragePlugin.SQLITE3), ("/robot1", StoragePlugin.MCAP)])
def test_a_bag_by_hand(tmp_path, namespace, storage):
    write(tmp_path / "bag", drive(), namespace=namespace, storage=storage)
    track = read_recorded(tmp_path / "bag")
    np.testing.assert_allclose(track.drive.time, [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    np.testing.assert_allclose(track.drive.true_state[:, 0], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    np.testing.assert_allclose(track.drive.true_state[:, 3], 0.9)
    np.testing.assert_allclose(track.drive.odometry[:, 0], [0.03, 0.13, np.nan, 0.33, 0.43])  # a lost measurement is none
    np.testing.assert_allclose(track.drive.estimate[:, 0], [0.01, 0.11, 0.21, 0.31, 0.41])
    np.testing.assert_allclose(track.drive.covariance[:, [0, 1, 2], [0, 1, 2]], [[0.04, 0.09, 0.01]] * 5)
    np.testing.assert_allclose(track.drive.reference, [[2.0, 1.0, 0.5]] * 5)
    np.testing.assert_allclose(track.drive.command, [[0.2, 0.1]] * 5)
    np.testing.assert_allclose(track.nis, [1.5, 2.5, 3.5, 4.5, 5.5])
    np.testing.assert_allclose(track.clearance, [0.5, 0.375, 0.25, 0.125, 0.0])
    np.testing.assert_array_equal(track.level, [np.nan, np.nan, 1.0, 1.0, 1.0])  # by the recorder's clock
    assert track.report[-1] == "collision monitor: slow"
    assert track.around.room.walls == pytest.approx((0.0, 0.0, 3.0, 2.0))
    assert track.around.room.circles[0] == pytest.approx((1.0, 0.5, 0.3))
    assert track.around.room.boxes[0] == pytest.approx((-1.0, -1.0, 0.4, 0.2, 0.7))
    (seen,) = track.scans
    assert seen.row == 2
    assert seen.lidar == pytest.approx((0.2 - 0.032, 0.0, 0.0))  # the Burger's LiDAR stands behind its centre
    assert seen.scan.ranges.tolist() == [1.0, 2.0, np.inf, np.inf]


def test_a_map_by_hand():
    half = math.radians(30.0) / 2.0
    turned = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half))
    origin = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", -1.0, 2.5, 0.0), turned)
    info = make("nav_msgs/msg/MapMetaData", stamp_of(0.0), 0.05, 3, 2, origin)
    grid = _grid(make("nav_msgs/msg/OccupancyGrid", header(0.0, "map"), info, np.array([0, 100, -1, 50, 0, 0], np.int8)))
    assert grid.cells.tolist() == [[0, 100, -1], [50, 0, 0]]
    assert grid.resolution == 0.05
    assert grid.origin == pytest.approx((-1.0, 2.5, math.radians(30.0)))


def test_a_bag_of_odometry_alone(tmp_path):
    write(tmp_path / "bag", [each for each in drive() if each[0] == "/odom"])
    track = read_recorded(tmp_path / "bag", label="the floor")
    assert track.around.label == "the floor"
    assert track.around.room is None
    assert np.isnan(track.drive.true_state).all()
    assert np.isnan(track.drive.estimate).all()
    assert track.rows == 5


def test_a_bag_without_odometry_is_refused(tmp_path):
    write(tmp_path / "bag", [each for each in drive() if each[0] != "/odom"])
    with pytest.raises(ValueError, match="two messages on odom, got 0; there are clearance"):
        read_recorded(tmp_path / "bag")


SNAPSHOTS = """time,odom_x,odom_y,odom_theta,odom_v,odom_omega,true_state_x,true_state_y,true_state_theta,\
true_state_v,true_state_omega,estimate_x,estimate_y,estimate_theta,estimate_v,estimate_omega,\
reference_x,reference_y,reference_theta,cmd_vel_v,cmd_vel_omega
7.0,,,,,,,,,,,,,,,,,,,,
7.1,1.0,2.0,0.1,0.2,0.0,,,,,,1.5,2.5,0.2,0.2,0.0,3.0,4.0,0.0,0.2,0.1
7.2,1.1,2.0,0.1,0.2,0.0,1.0,2.1,0.1,0.2,0.0,1.6,2.5,0.2,0.2,0.0,3.0,4.0,0.0,0.2,0.1
7.3,,,,,,,,,,,,,,,,,,,,
"""


def test_snapshots_by_hand(tmp_path):
    (tmp_path / "snapshots.csv").write_text(SNAPSHOTS)
    track = read_recorded(tmp_path / "snapshots.csv")
    np.testing.assert_allclose(track.drive.time, [0.0, 0.1], atol=1e-9)  # from odometry to odometry
    np.testing.assert_array_equal(track.drive.odometry, [[1.0, 2.0, 0.1], [1.1, 2.0, 0.1]])
    np.testing.assert_array_equal(track.drive.true_state[:, 0], [np.nan, 1.0])
    np.testing.assert_array_equal(track.drive.command, [[0.2, 0.1]] * 2)


def test_snapshots_without_odometry_are_refused(tmp_path):
    lines = SNAPSHOTS.splitlines()
    (tmp_path / "snapshots.csv").write_text("\n".join([lines[0], lines[1], lines[4]]))
    with pytest.raises(ValueError, match="no row has odometry"):
        read_recorded(tmp_path / "snapshots.csv")


def test_a_table_is_replayed(tmp_path):
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(30)]
    (tmp_path / "drive.csv").write_text("\n".join(["t,vx,gyro,px,py,theta", *rows]))
    track = read_recorded(tmp_path / "drive.csv", noise="clean")
    np.testing.assert_allclose(track.drive.true_state[:, 0], 0.02 * np.arange(30), atol=1e-9)
    np.testing.assert_allclose(track.drive.estimate[:, 0], track.drive.true_state[:, 0], atol=1e-3)


def test_what_is_no_drive_is_refused(tmp_path):
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n3,4\n")
    with pytest.raises(ValueError, match="column"):
        read_recorded(tmp_path / "notes.csv")
    with pytest.raises(OSError, match=r"nowhere\.csv"):
        read_recorded(tmp_path / "nowhere.csv")
