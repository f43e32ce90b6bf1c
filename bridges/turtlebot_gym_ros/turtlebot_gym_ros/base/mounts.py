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
    node: Node, body: str, wrap: Callable[[Callable[[Any, Mapping[str, Any]], None]], Any] = lambda hear: hear
) -> Callable[[str], Pose | None]:
    """Subscribe a node to ``/tf_static``, and return `StaticFrames.mount` for the robot's frame.

    The type of its messages comes with a ROS installation and is not on PyPI; without it, no mount is ever stated.

    Args:
        node: The node.
        body: The robot's frame, with its prefix.
        wrap: Returns the callback for a message and its info that stands around the given one.
    """
    frames = StaticFrames()

    def hear(message: Any, info: Mapping[str, Any]) -> None:
        frames.hear(message)

    try:
        from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
    except ImportError:
        pass
    else:
        node.create_subscription(TFMessage, TOPIC, wrap(hear), STATIC)
    return partial(frames.mount, body)
