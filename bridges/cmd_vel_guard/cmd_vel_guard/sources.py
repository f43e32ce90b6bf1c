"""The sources of the guard's inputs: one for each, and never the guard itself; and names in the graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from cmd_vel_guard.qos import STATIC
from cmd_vel_guard.values import Pose
from turtlebot_gym.mounts import StaticFrames

if TYPE_CHECKING:
    from rclpy.topic_endpoint_info import TopicEndpointInfo

TF_STATIC = "/tf_static"
"""The topic of mounts, which robots share in any namespace, as in tf2; a remapping applies."""

BUTTONS = "emergency_stop"
"""The input that may have many sources."""
COMMANDS = "cmd_vel", "cmd_vel_in", "cmd_vel_teleop"
"""The guard's output, and its inputs of the same type."""


def check_topics(resolve: Callable[[str], str]) -> None:
    """Refuse remappings, which ``resolve`` knows, by which the guard would obey itself, or take one source for two."""
    for first, second in combinations(COMMANDS, 2):
        if (topic := resolve(first)) == resolve(second):
            raise ValueError(f"{first} and {second} must be different topics, got {topic} for both.")


def rivals(subscriptions: Mapping[str, Subscription]) -> str:
    """Return which input has more than one source, or an empty text."""
    counts = {topic: subscription.get_publisher_count() for topic, subscription in subscriptions.items() if topic != BUTTONS}
    return next((f"{count} nodes publish {topic}" for topic, count in counts.items() if count > 1), "")


def hear_mounts(
    node: Node, body: str, wrap: Callable[[Callable[[Any, Mapping[str, Any]], None]], Any] = lambda hear: hear
) -> Callable[[str], Pose | None]:
    """Subscribe a node to ``/tf_static``, and return `StaticFrames.mount` for the robot's frame.

    The type of its messages comes with a ROS installation and is not on PyPI; without it, no mount is ever stated.
    """
    frames = StaticFrames()

    def hear(message: Any, info: Mapping[str, Any]) -> None:
        frames.hear(message)

    try:
        from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
    except ImportError:
        pass
    else:
        node.create_subscription(TFMessage, TF_STATIC, wrap(hear), STATIC)
    return partial(frames.mount, body)


def node_name(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that publishes or subscribes to a topic."""
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def type_name(message_type: type) -> str:
    """Return a message type's name as the graph writes it: "geometry_msgs/msg/Twist"."""
    package, kind, *_ = message_type.__module__.split(".")
    return f"{package}/{kind}/{message_type.__name__}"
