"""A block's inputs as topics: their messages on the way to the drive, and what of them a step can use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node

from cmd_vel_guard.sent import SystemClock, read_clocks
from cmd_vel_guard.sources import hear_mounts
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Input
from turtlebot_gym_ros.node.convert import conversion_of
from turtlebot_gym_ros.node.diagnostics import Endpoint
from turtlebot_gym_ros.node.drives import Scheduler
from turtlebot_gym_ros.node.feed import Feed, resting_on
from turtlebot_gym_ros.node.triggers import SECOND


class Inputs:
    """The subscriptions of a block, and the conversion of messages to its values.

    Args:
        node: The node.
        declared: The block's inputs.
        common: Frames, and whether velocities are stamped.
        headers: Whether the headers' stamps are by a system clock, not by a simulated one.
        group: The callback group of the messages; None for the node's default one.
        now: The steady clock, s.
    """

    def __init__(
        self,
        node: Node,
        declared: Mapping[str, Input],
        common: Common,
        *,
        headers: bool,
        group: CallbackGroup | None,
        now: Callable[[], float],
    ) -> None:
        self._node, self._common, self._now, self._clock = node, common, now, SystemClock()
        self.look()
        self.sees = any(source.type is Scan for source in declared.values())
        """Whether the block sees obstacles."""
        mount = hear_mounts(node, common.body) if self.sees else lambda frame: None
        self.feeds = {
            key: Feed(
                source,
                conversion_of(source, stamped=common.enable_stamped_cmd_vel),
                lock_step=common.lock_step,
                clock=self._clock,
                headers=headers,
                group=group,
                mount=mount,
            )
            for key, source in declared.items()
        }
        """The inputs by name."""
        self.halting = [feed for feed in self.feeds.values() if feed.declared.halts]
        """The inputs that may stop the robot."""

    def connect(self, drive: Scheduler) -> list[Endpoint]:
        """Subscribe for a drive, which is notified of each new value; return the topics for the diagnostics."""
        self._drive = drive
        return [
            feed.connect(self._node, partial(self.receive, key), partial(drive.on_message, key, 0))
            for key, feed in self.feeds.items()
        ]

    def look(self) -> float:
        """Compare the clocks, for the ages of messages, and return the steady time; call this at least every 20 ms."""
        system, steady = read_clocks()
        self._clock.look(system=system, steady=steady)
        return steady

    def receive(self, key: str, message: Any, info: Mapping[str, Any]) -> None:
        """Handle a message, and run the block if it makes a step due."""
        feed, drive = self.feeds[key], self._drive
        if feed.declared.wakes:
            for other in self.feeds.values():
                other.poll()
        try:
            at = message.header.stamp if hasattr(message, "header") else None
            stamp = at.sec * SECOND + at.nanosec if at else drive.present()
            if stamp < 0:
                raise ValueError(f"its stamp is {stamp / SECOND:g} s: a time before 1970")
            age = feed.age(message, info, self.look())
            value = feed.read(message, self._common.fixed(feed.declared.frame))
            if not drive.accepts(key, stamp):
                return
        except Exception as error:  # whatever a message holds, it is refused, and ends no node
            why = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
            if feed.refuse(why):
                self._node.get_logger().warning(f"{feed.topic}: refused: {why}")
            return
        sent = 0 if stamp else drive.present() - round(age.sent * SECOND)  # reading the clock takes long
        feed.accept(value, self._now(), stamp, age, sent)
        drive.on_message(key, stamp)

    def resting_on(self) -> int:
        """Return the stamp of a command, ns: outside lock-step, that of the measurement on which it rests."""
        present = self._drive.present()
        return present if self._common.lock_step else resting_on(self.feeds.values(), present)

    def missing(self, now: float) -> str | None:
        """Return which input a step must wait for, if any."""
        return next((why for feed in self.feeds.values() if (why := feed.missing(now))), None)

    def halted(self, now: float) -> str:
        """Return the cause that an input gives for stopping the robot until it is enabled again, or an empty text."""
        return next((why for feed in self.feeds.values() if (why := feed.cause or feed.replaced(self._node, now))), "")

    def rivals(self) -> str:
        """Return which input has several sources where one may be, or an empty text."""
        return next((why for feed in self.feeds.values() if (why := feed.rivals())), "")

    def take(self, now: float, stamp: int) -> dict[str, Any]:
        """Return the values for a step at a stamp, ns."""
        return {key: feed.take(now, stamp) for key, feed in self.feeds.items() if not feed.declared.halts}

    def begin(self) -> None:
        """Let each input begin anew, when the robot is enabled."""
        for feed in self.feeds.values():
            feed.begin()

    def forget(self) -> None:
        """Forget the latest values."""
        for feed in self.feeds.values():
            feed.forget()
