"""Whatever a bag holds, it is read, or refused with one line."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from fuzzing import answered, fuzzed, mutated
from hypothesis import strategies as st

from turtlebot_gym.calibration.bags import Topics, read_bag

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs rosbags, of the extras [deploy] and [ros]")
typesys = pytest.importorskip("rosbags.typesys")

from turtlebot_gym_agents.watch import read_recorded

FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
TYPES = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
T = TYPES.types
NUMBERS = st.one_of(st.floats(width=64), st.sampled_from([math.nan, math.inf, 1e308, -1.0, 0.0, 1e9]))


def vector(x=0.0, z=0.0):
    return T["geometry_msgs/msg/Vector3"](x=x, y=0.0, z=z)


def odometry(time, x, y, w, v, omega, first=0.01):
    stamp = T["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(time % 1.0 * 1e9))
    covariance = np.full(36, 0.0)
    covariance[0] = first
    pose = T["geometry_msgs/msg/Pose"](
        position=T["geometry_msgs/msg/Point"](x=x, y=y, z=0.0),
        orientation=T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sqrt(max(1.0 - w * w, 0.0)), w=w),
    )
    return T["nav_msgs/msg/Odometry"](
        header=T["std_msgs/msg/Header"](stamp=stamp, frame_id="odom"),
        child_frame_id="base_footprint",
        pose=T["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
        twist=T["geometry_msgs/msg/TwistWithCovariance"](
            twist=T["geometry_msgs/msg/Twist"](linear=vector(x=v), angular=vector(z=omega)), covariance=np.zeros(36)
        ),
    )


def bag(rows, *, kinds=("nav_msgs/msg/Odometry", "nav_msgs/msg/Odometry"), plugin=rosbag2.StoragePlugin.MCAP):
    """Write a bag with /odom and /ground_truth, and return its file."""
    folder = Path(tempfile.mkdtemp(dir=FOLDER)) / "bag"
    with rosbag2.Writer(folder, version=9, storage_plugin=plugin) as writer:
        for topic, kind in zip(("/odom", "/ground_truth"), kinds, strict=True):
            connection = writer.add_connection(topic, kind, typestore=TYPES)
            for at, row in enumerate(rows):
                message = odometry(*row) if kind == "nav_msgs/msg/Odometry" else T["std_msgs/msg/String"](data="x")
                writer.write(connection, 10**11 + at * 10**8, TYPES.serialize_cdr(message, kind))
    (file,) = [path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")]
    return file


ROWS = [(100.0 + 0.1 * k, 0.02 * k, 0.001 * k, math.cos(0.01 * k), 0.2, 0.02 * math.cos(k)) for k in range(40)]
FILES = {plugin: bag(ROWS, plugin=plugin).read_bytes() for plugin in rosbag2.StoragePlugin}


def read_both(path):
    """Read a bag for calibration and for the view; each may refuse it."""
    log = answered("bags, calibration", lambda: read_bag(path, topics=Topics()))
    if log is not None:
        assert np.isfinite(log.time).all()
        assert np.isfinite(log.twist).all()
    answered("bags, view", lambda: read_recorded(path))


def test_the_bags_are_read():
    for plugin, content in FILES.items():
        path = FOLDER / f"good.{'mcap' if plugin is rosbag2.StoragePlugin.MCAP else 'db3'}"
        path.write_bytes(content)
        assert len(read_bag(path).time) == len(ROWS)
        assert read_recorded(path)


@fuzzed(25, 400, data=st.data())
def test_damaged_bags(data):
    plugin = data.draw(st.sampled_from([rosbag2.StoragePlugin.MCAP, rosbag2.StoragePlugin.MCAP, rosbag2.StoragePlugin.SQLITE3]))
    path = FOLDER / f"damaged.{'mcap' if plugin is rosbag2.StoragePlugin.MCAP else 'db3'}"
    path.write_bytes(data.draw(mutated(FILES[plugin])))
    read_both(path)


@fuzzed(15, 200, data=st.data())
def test_bags_whose_messages_say_anything(data):
    rows = [list(row) for row in ROWS]
    for _ in range(data.draw(st.integers(1, 4))):
        at, column = data.draw(st.integers(0, len(rows) - 1)), data.draw(st.integers(1, 6))
        rows[at][column : column + 1] = [data.draw(NUMBERS)]
        rows[at][0] = abs(data.draw(st.sampled_from([rows[at][0], 0.0, 2e9, 99.0])))
    kinds = data.draw(st.sampled_from([("nav_msgs/msg/Odometry",) * 2, ("nav_msgs/msg/Odometry", "std_msgs/msg/String")]))
    read_both(bag(rows, kinds=kinds))
