"""A pose on ``/tf``, where that can exist: its message, `tf2_msgs/TFMessage`, comes with a ROS installation, not from PyPI."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

BROADCAST = QoSProfile(depth=100)
"""The quality of service of tf2's own broadcaster."""


class Transforms:
    """Publishes the transform from an Odometry's frame to its child frame.

    The topic is ``/tf`` in any namespace, as tf2 has it: robots share one tree, and the frames' prefix tells them apart. The
    transform from ``odom`` to the robot has one owner, so this is off by default.

    Args:
        node: The node.

    Raises:
        ValueError: If ``tf2_msgs`` is not installed.
    """

    def __init__(self, node: Node) -> None:
        try:
            from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
        except ImportError:
            raise ValueError(
                "publish_tf needs tf2_msgs, which a ROS installation has and PyPI does not: source one, or leave it false."
            ) from None
        self._message = TFMessage
        self._publisher = node.create_publisher(TFMessage, "/tf", BROADCAST)

    def publish(self, odometry: Odometry) -> None:
        """Publish a pose as a transform; one that was not measured is left out."""
        if odometry.pose.covariance[0] < 0.0:
            return
        pose, transform = odometry.pose.pose, TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
        translation = transform.transform.translation
        translation.x, translation.y, translation.z = pose.position.x, pose.position.y, pose.position.z
        transform.transform.rotation = pose.orientation
        self._publisher.publish(self._message(transforms=[transform]))
