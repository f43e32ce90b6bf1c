"""A block's outputs as topics, and the mounts of its sensors on ``/tf_static``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.time import Time
from sensor_msgs.msg import TimeReference
from std_msgs.msg import Header

from cmd_vel_guard.qos import LATCHED, LOCK_STEP, STREAM
from cmd_vel_guard.sources import type_name
from turtlebot_gym.values import Command, Pose
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Output, Stamped, Transform
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.diagnostics import Endpoint
from turtlebot_gym_ros.node.geometry import transform_to
from turtlebot_gym_ros.node.triggers import SECOND


class Outputs:
    """The publishers of a block, and the conversion of its values to messages; ``time`` returns the stamp of a command, ns."""

    def __init__(self, node: Node, declared: Mapping[str, Output], common: Common, time: Callable[[], int]) -> None:
        lock_step, self._body = common.lock_step, common.fixed(common.body_frame)
        self._declared, self._common, self._time = declared, common, time
        self._ways = {key: conversion(output.type, stamped=common.enable_stamped_cmd_vel) for key, output in declared.items()}
        self._publishers = {}
        for key, output in declared.items():
            qos = LATCHED if output.latched else LOCK_STEP if lock_step else STREAM
            kind, override = self._ways[key].message, QoSOverridingOptions.with_default_policies()
            self._publishers[key] = node.create_publisher(kind, output.topic, qos, qos_overriding_options=override)
        newest = {key: f"{output.topic}/newest" for key, output in declared.items() if lock_step and output.newest}
        self._tellers = {key: node.create_publisher(TimeReference, topic, LOCK_STEP) for key, topic in newest.items()}
        mounts = [output.mount for output in declared.values() if output.mount]
        if mounts and (tf := next((key for key, output in declared.items() if output.type is Transform), None)):
            kind, header = self._ways[tf].message, Header(frame_id=self._body)
            there = [transform_to(common.fixed(mount.frame), Pose(mount.x, mount.y, mount.yaw), header) for mount in mounts]
            self._static = node.create_publisher(kind, "/tf_static", LATCHED)
            self._static.publish(kind(transforms=there))
        self.moving = [key for key, output in declared.items() if output.stop is not None]
        """Names of the outputs that move the robot."""
        self._last: Mapping[str, Any] = {}
        self._step = 0

    @property
    def endpoints(self) -> list[Endpoint]:
        """The topics as endpoints for the diagnostics."""
        return [
            Endpoint(publisher.topic_name, type_name(self._ways[key].message), True, key in self.moving)
            for key, publisher in self._publishers.items()
        ]

    def message(self, key: str, value: Any, stamp: int) -> Any:
        """Return the message of an output's value.

        Commands, and stops among them, are stamped with the time of the measurement on which they rest, see `feed.resting_on`;
        other values with the step's stamp, ns, less their age. In lock-step commands have the step's stamp too, since they
        answer a step. A value that is not finite raises `ValueError`.
        """
        if isinstance(value, Stamped):
            value, stamp = value.value, stamp - round(value.age * SECOND)
        way, mount, is_command = self._ways[key], self._declared[key].mount, self._declared[key].type is Command
        body = self._common.fixed(mount.frame) if mount else self._body
        frame = self._common.fixed(self._declared[key].frame) if way.in_world else body
        rests = is_command and not self._common.lock_step
        at = self._time() if rests else stamp
        message = way.write(value, Header(stamp=Time(nanoseconds=at).to_msg(), frame_id=frame))
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = self._body
        for transform in getattr(message, "transforms", ()):
            child = transform.child_frame_id
            transform.child_frame_id = self._common.fixed(child) if child else self._body
        return message

    def publish(self, messages: Mapping[str, Any]) -> None:
        """Publish messages in the order of the declared outputs."""
        for key, publisher in self._publishers.items():
            if key in messages:
                publisher.publish(messages[key])

    def publish_answer(self, messages: Mapping[str, Any], stamp: int) -> None:
        """Publish the messages of a step, which may have to be repeated, and which messages are the newest."""
        held = {key: self._last[key] for key in self._tellers if key in self._last}
        steps = {key: message for key, message in messages.items() if not self._declared[key].latched}
        self._last, self._step = {**held, **steps}, stamp
        self.publish(messages)
        self._tell_newest()

    def _tell_newest(self) -> None:
        """Publish the stamps of the newest messages of outputs that are absent from some steps; 0 if there is none."""
        for key, teller in self._tellers.items():
            header = Header(stamp=Time(nanoseconds=self._step).to_msg())
            newest = self._last[key].header.stamp if key in self._last else Time().to_msg()
            teller.publish(TimeReference(header=header, time_ref=newest))

    def publish_again(self, stamp: int | None = None) -> None:
        """Publish the last answer again, with another stamp, ns, if given."""
        if stamp is not None:
            self._step = stamp
            for key in self._last.keys() - self._tellers.keys():
                self._last[key].header.stamp = Time(nanoseconds=stamp).to_msg()
        self.publish(self._last)
        self._tell_newest()

    def stops(self, stamp: int = 0) -> dict[str, Any]:
        """Return the messages that stop the robot; in lock-step they answer the step of a stamp, ns, if any."""
        return {key: self.message(key, self._declared[key].stop, stamp) for key in self.moving}

    def flush(self) -> None:
        """Wait until listeners have all messages, at most 0.5 s each, since Fast DDS drops undelivered ones."""
        for publisher in (*self._publishers.values(), *self._tellers.values()):
            publisher.wait_for_all_acked(Duration(seconds=0.5))
