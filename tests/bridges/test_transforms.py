"""Poses on /tf, mounts on /tf_static: with a stand-in for tf2_msgs, and the refusal without it."""

import math
import sys
from dataclasses import dataclass, field
from importlib.util import find_spec
from types import ModuleType

import pytest
from geometry_msgs.msg import TransformStamped
from std_msgs.msg import Header

from cmd_vel_guard.qos import LATCHED
from turtlebot_gym import values
from turtlebot_gym.values import Command, Pose
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Mount
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.outputs import BROADCAST, _Transforms


@dataclass
class StandInTFMessage:
    """Stands in for tf2_msgs/msg/TFMessage, whose only field this is."""

    transforms: list[TransformStamped] = field(default_factory=list)


class StandInNode:
    """A node whose one publisher keeps what it is given."""

    def __init__(self):
        self.made, self.heard = [], []

    def create_publisher(self, kind, topic, qos):
        self.made.append((kind, topic, qos))
        return self

    def publish(self, message):
        self.heard.append(message)


@pytest.fixture
def tf2_msgs(monkeypatch):
    module = ModuleType("tf2_msgs.msg")
    module.TFMessage = StandInTFMessage
    monkeypatch.setitem(sys.modules, "tf2_msgs", ModuleType("tf2_msgs"))
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", module)


def odometry(*, measured=True):
    header = Header(frame_id="robot1/odom")
    header.stamp.sec = 7
    message = conversion(values.Odometry).write(values.Odometry(Pose(1.0, -2.0, 0.5), Command(0.1, 0.2), measured), header)
    message.child_frame_id = "robot1/base_footprint"
    return message


def test_a_pose_is_the_transform_to_its_child_frame(tf2_msgs):
    node, message = StandInNode(), odometry()
    _Transforms(node, [], Common()).publish(message)
    assert node.made == [(StandInTFMessage, "/tf", BROADCAST)]
    (transform,) = node.heard[0].transforms
    assert (transform.header, transform.child_frame_id) == (message.header, "robot1/base_footprint")
    moved = transform.transform.translation
    assert (moved.x, moved.y, moved.z) == (1.0, -2.0, 0.0)
    assert transform.transform.rotation == message.pose.pose.orientation


def test_mounts_are_said_once_together_for_whoever_comes(tf2_msgs):
    node, mounts = StandInNode(), [Mount("base_scan", -0.032, 0.0, 0.0), Mount("camera", 0.05, -0.02, math.pi / 2.0)]
    _Transforms(node, mounts, Common(frame_prefix="robot1/"))
    assert node.made[1] == (StandInTFMessage, "/tf_static", LATCHED)
    (message,) = node.heard
    assert [transform.header.frame_id for transform in message.transforms] == ["robot1/base_footprint"] * 2
    assert [transform.child_frame_id for transform in message.transforms] == ["robot1/base_scan", "robot1/camera"]
    lidar, camera = (transform.transform for transform in message.transforms)
    assert (lidar.translation.x, lidar.translation.y, lidar.translation.z) == (-0.032, 0.0, 0.0)
    assert (lidar.rotation.x, lidar.rotation.y, lidar.rotation.z, lidar.rotation.w) == (0.0, 0.0, 0.0, 1.0)
    assert (camera.translation.x, camera.translation.y) == (0.05, -0.02)
    assert (camera.rotation.z, camera.rotation.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))


heard, mounted = [], []


def test_without_a_ros_installation_it_is_refused_on_one_line(launch):
    if find_spec("tf2_msgs"):
        pytest.skip("tf2_msgs is installed here")
    process = launch("-m", "turtlebot_gym_ros", "kalman_filter", "--ros-args", "-p", "publish_tf:=true")
    _, stderr = process.communicate(timeout=30.0)
    assert process.returncode == 2
    assert stderr == (
        "error: publish_tf needs tf2_msgs, which PyPI lacks: source a ROS installation, or take ROS from RoboStack with pixi.\n"
    )
