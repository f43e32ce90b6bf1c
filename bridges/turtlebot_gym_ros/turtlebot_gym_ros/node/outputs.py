"""A block's outputs as topics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from turtlebot_gym.values import Command
from turtlebot_gym_ros.node.block import Output
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.diagnostics import Endpoint, type_name
from turtlebot_gym_ros.node.parameters import Common
from turtlebot_gym_ros.node.qos import LOCK_STEP, STREAM, overridable


class Outputs:
    """The publishers of a block, and how its values become messages.

    Args:
        node: The node.
        declared: The block's outputs.
        common: Frames, and whether velocities are stamped.
        time: The present by the clock that the block runs by, ns.
    """

    def __init__(self, node: Node, declared: Mapping[str, Output], common: Common, time: Callable[[], int]) -> None:
        qos = LOCK_STEP if common.lock_step else STREAM
        self._declared, self._common, self._time = declared, common, time
        self._ways = {key: conversion(each.type, stamped=common.enable_stamped_cmd_vel) for key, each in declared.items()}
        self._publishers = {
            key: node.create_publisher(self._ways[key].message, each.topic, qos, qos_overriding_options=overridable())
            for key, each in declared.items()
        }
        self.moving = [key for key, each in declared.items() if each.stop is not None]
        """Names of the outputs that move the robot."""
        self._last: Mapping[str, Any] = {}

    @property
    def endpoints(self) -> list[Endpoint]:
        """The topics, as the diagnostics want them."""
        return [
            Endpoint(publisher.topic_name, type_name(self._ways[key].message), True, key in self.moving)
            for key, publisher in self._publishers.items()
        ]

    def message(self, key: str, value: Any, stamp: int) -> Any:
        """Return the message of an output's value.

        Commands are stamped now, all else with the step's stamp, ns; in lock-step commands are as well, since they answer a
        step.

        Raises:
            ValueError: If the value is not finite.
        """
        way, is_command = self._ways[key], self._declared[key].type is Command
        frame = self._common.frame if way.in_world else self._common.body_frame
        now = is_command and not self._common.lock_step
        at = Time(nanoseconds=self._time() if now else stamp).to_msg()
        message = way.write(value, Header(stamp=at, frame_id=frame))
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = self._common.body_frame
        return message

    def publish(self, messages: Mapping[str, Any]) -> None:
        """Publish messages, in the order in which the outputs are declared."""
        for key, publisher in self._publishers.items():
            if key in messages:
                publisher.publish(messages[key])

    def publish_answer(self, messages: Mapping[str, Any]) -> None:
        """Publish messages that may have to be published again."""
        self._last = messages
        self.publish(messages)

    def publish_again(self, stamp: int | None = None) -> None:
        """Publish the last answer again, under another stamp, ns, where one is given."""
        if stamp is not None:
            for message in self._last.values():
                message.header.stamp = Time(nanoseconds=stamp).to_msg()
        self.publish(self._last)

    def stops(self, stamp: int = 0) -> dict[str, Any]:
        """Return what stops the robot; in lock-step it answers the step of a stamp, ns, and none without."""
        return {key: self.message(key, self._declared[key].stop, stamp) for key in self.moving}

    def publish_stops(self) -> None:
        """Publish what stops the robot."""
        self.publish(self.stops())

    def unheard(self) -> str | None:
        """Return what to wait for where nobody listens to an output that moves the robot."""
        topics = (each.topic_name for key in self.moving if not (each := self._publishers[key]).get_subscription_count())
        return next((f"waits for a listener on {topic}" for topic in topics), None)

    def flush(self) -> None:
        """Wait until whoever listens has what was published, for half a second each at most: Fast DDS drops what it has not."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=0.5))
