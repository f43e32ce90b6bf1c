"""ROS 2 messages and bags written by rosbags, from numbers."""

import math

import numpy as np
import pytest

from turtlebot_gym.tracking.tracker import FLOAT32, POINT_FIELDS

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs rosbags, of the extras [deploy] and [ros]")
typesys = pytest.importorskip("rosbags.typesys")

Plugin = rosbag2.StoragePlugin
TYPES = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
ODOMETRY, POSE, POINT = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PointStamped"
TRANSFORM, TF, TWIST = "geometry_msgs/msg/TransformStamped", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/Twist"
NIS, REPORT = "geometry_msgs/msg/Vector3Stamped", "diagnostic_msgs/msg/DiagnosticArray"
RANGE, SCAN = "sensor_msgs/msg/Range", "sensor_msgs/msg/LaserScan"
MARKERS, CLOUD = "visualization_msgs/msg/MarkerArray", "sensor_msgs/msg/PointCloud2"


def make(kind, *values, **named):
    return TYPES.types[kind](*values, **named)


def stamp(seconds):
    whole = math.floor(seconds)
    return make("builtin_interfaces/msg/Time", whole, round((seconds - whole) * 1e9))


def header(seconds, frame="odom"):
    return make("std_msgs/msg/Header", stamp(seconds), frame)


def vector(x=0.0, y=0.0, z=0.0):
    return make("geometry_msgs/msg/Vector3", float(x), float(y), float(z))


def point(x, y):
    return make("geometry_msgs/msg/Point", float(x), float(y), 0.0)


def turn(theta):
    return make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(theta / 2.0), math.cos(theta / 2.0))


def pose(x, y, theta):
    return make("geometry_msgs/msg/Pose", point(x, y), turn(theta))


def twist(v, omega):
    return make(TWIST, vector(v), vector(z=omega))


def odometry(seconds, place, speeds=(0.0, 0.0), *, variances=(0.0, 0.0, 0.0), measured=True):
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = variances
    covariance[0] = covariance[0] if measured else -1.0
    stated = make("geometry_msgs/msg/PoseWithCovariance", pose(*place), covariance)
    return make(
        ODOMETRY, header(seconds), "base", stated, make("geometry_msgs/msg/TwistWithCovariance", twist(*speeds), np.zeros(36))
    )


def transform(seconds, place, child="base", frame="world"):
    x, y, theta = place
    return make(TRANSFORM, header(seconds, frame), child, make("geometry_msgs/msg/Transform", vector(x, y), turn(theta)))


def diagnostics(seconds, name, text, level=0):
    return make(REPORT, header(seconds), [make("diagnostic_msgs/msg/DiagnosticStatus", level, name, text, "", [])])


def marker(kind, at, size, points=()):
    colour, always = make("std_msgs/msg/ColorRGBA", 0.0, 0.0, 0.0, 1.0), make("builtin_interfaces/msg/Duration", 0, 0)
    texture = make("sensor_msgs/msg/CompressedImage", header(0.0), "", np.zeros(0, np.uint8))
    mesh = make("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8))
    form = header(10.0), "obstacles", 0, kind, 0, at, size, colour, always, False
    corners = [point(x, y) for x, y in points]
    return make("visualization_msgs/msg/Marker", *form, corners, [], "", texture, [], "", "", mesh, False)


def room():
    corners = [(-3.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-3.0, 2.0), (-3.0, -2.0)]
    walls = marker(4, pose(0.0, 0.0, 0.0), vector(0.05), corners)
    circle, box = marker(3, pose(1.0, 0.5, 0.0), vector(0.6, 0.6, 0.3)), marker(1, pose(-1.0, -1.0, 0.7), vector(0.4, 0.2, 0.3))
    return make(MARKERS, [walls, circle, box])


def tracks(seconds, numbers):
    """Return tracks as points, one for each row of numbers."""
    fields = [make("sensor_msgs/msg/PointField", name, 4 * at, FLOAT32, 1) for at, name in enumerate(POINT_FIELDS)]
    data = np.frombuffer(np.pad(numbers, ((0, 0), (0, 1))).astype("<f4").tobytes(), np.uint8)
    number, size = len(numbers), 4 * len(POINT_FIELDS)
    return make(CLOUD, header(seconds, "base"), 1, number, fields, False, size, number * size, data, True)


def write_bag(folder, messages, *, plugin=Plugin.SQLITE3, silent=()):
    """Write messages, each given as its topic, its type, when it was received, and itself; ``silent``: topics without any."""
    with rosbag2.Writer(folder, version=9, storage_plugin=plugin) as writer:
        opened = {topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in silent}
        for topic, kind, received, message in messages:
            if topic not in opened:
                opened[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(opened[topic], round(received * 1e9), TYPES.serialize_cdr(message, kind))
    return folder


def write_ros_1(path, messages):
    """Write messages as a bag of ROS 1."""
    rosbag1, noetic = pytest.importorskip("rosbags.rosbag1"), typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    noetic.register(typesys.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    heads = iter(range(10**6))

    def of_ros_1(value):
        """Return a message of ROS 1: its header has a number."""
        if isinstance(value, list):
            return [of_ros_1(each) for each in value]
        if not hasattr(value, "__msgtype__"):
            return value
        parts = {name: of_ros_1(part) for name, part in vars(value).items() if name != "__msgtype__"}
        numbered = {"seq": next(heads)} if value.__msgtype__ == "std_msgs/msg/Header" else {}
        return noetic.types[value.__msgtype__](**numbered, **parts)

    with rosbag1.Writer(path) as writer:
        opened = {}
        for topic, kind, received, message in messages:
            if topic not in opened:
                opened[topic] = writer.add_connection(topic, kind, typestore=noetic)
            writer.write(opened[topic], round(received * 1e9), noetic.serialize_ros1(of_ros_1(message), kind))
    return path
