"""Poses on ``/tf`` and ``/tf_static``; they need tf2_msgs, which comes with a ROS installation and is not on PyPI."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from turtlebot_gym_ros.node.block import Mount
from turtlebot_gym_ros.node.parameters import Common
from turtlebot_gym_ros.node.qos import LATCHED

BROADCAST = QoSProfile(depth=100)
"""The quality of service of tf2's own broadcaster."""


class Transforms:
    """Publishes the transform from an Odometry's frame to its child frame, and once the transforms to the robot's sensors.

    As in tf2, the topic is ``/tf`` in any namespace: robots share one tree, and the frames' prefix distinguishes them. The
    transform from ``odom`` to the robot must have one owner, so this is off by default.

    Args:
        node: The node.
        mounts: Mounts of the sensors; their height is unknown.
        common: Names of the frames.

    Raises:
        ValueError: If ``tf2_msgs`` is not installed.
    """

    def __init__(self, node: Node, mounts: Sequence[Mount], common: Common) -> None:
        try:
            from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
        except ImportError:
            raise ValueError(
                "publish_tf needs tf2_msgs, which a ROS installation has and PyPI does not: source one, or leave it false."
            ) from None
        self._message = TFMessage
        self._publisher = node.create_publisher(TFMessage, "/tf", BROADCAST)
        if mounts:
            self._static = node.create_publisher(TFMessage, "/tf_static", LATCHED)
            self._static.publish(TFMessage(transforms=[_fixed(each, common) for each in mounts]))

    def publish(self, odometry: Odometry) -> None:
        """Publish a pose as a transform, unless it was not measured."""
        if odometry.pose.covariance[0] < 0.0:
            return
        pose, transform = odometry.pose.pose, TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
        translation = transform.transform.translation
        translation.x, translation.y, translation.z = pose.position.x, pose.position.y, pose.position.z
        transform.transform.rotation = pose.orientation
        self._publisher.publish(self._message(transforms=[transform]))


def _fixed(mount: Mount, common: Common) -> TransformStamped:
    """Return the static transform from the robot's frame to a sensor's."""
    told = TransformStamped(header=Header(frame_id=common.body), child_frame_id=common.sensor(mount))
    told.transform.translation.x, told.transform.translation.y = mount.x, mount.y
    told.transform.rotation.z, told.transform.rotation.w = math.sin(0.5 * mount.yaw), math.cos(0.5 * mount.yaw)
    return told
