"""Where sensors are mounted on the robot, as ``/tf_static`` states it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.node import Node

from turtlebot_gym.mounts import StaticFrames
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.base.qos import STATIC

TOPIC = "/tf_static"
"""The topic, which robots share in any namespace, as in tf2; a remapping applies."""


def hear_mounts(
    node: Node, body: str, count: Callable[[Mapping[str, Any]], None] = lambda info: None
) -> Callable[[str], Pose | None]:
    """Subscribe a node to ``/tf_static``, and return `StaticFrames.mount` for the robot's frame.

    The type of its messages comes with a ROS installation and is not on PyPI; without it, no mount is ever stated.

    Args:
        node: The node.
        body: The robot's frame, with its prefix.
        count: Called with each message's info.
    """
    frames = StaticFrames()

    def hear(message: Any, info: Mapping[str, Any]) -> None:
        count(info)
        frames.hear(message)

    try:
        from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
    except ImportError:
        pass
    else:
        callback: Any = hear  # rclpy supports the info, but its types do not show it
        node.create_subscription(TFMessage, TOPIC, callback, STATIC)
    return partial(frames.mount, body)
