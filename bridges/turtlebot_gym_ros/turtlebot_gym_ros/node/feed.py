"""A node's inputs: their latest values and ages, refused messages, and what of them a step can use."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.time import Time
from sensor_msgs.msg import TimeReference

from cmd_vel_guard.executor import PolledGroup
from cmd_vel_guard.qos import LATCHED, LOCK_STEP, SENSOR, STREAM
from cmd_vel_guard.sent import Age, Ages, SystemClock, read_clocks
from cmd_vel_guard.sources import hear_mounts, node_name, type_name
from turtlebot_gym.config import short_repr
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.base.executor import take
from turtlebot_gym_ros.node.block import Input, Stamped
from turtlebot_gym_ros.node.convert import conversion_of
from turtlebot_gym_ros.node.diagnostics import Endpoint
from turtlebot_gym_ros.node.geometry import Conversion
from turtlebot_gym_ros.node.triggers import SECOND

if TYPE_CHECKING:
    from turtlebot_gym_ros.node.drives import Scheduler
    from turtlebot_gym_ros.node.shell import Shell

NEW = Age(0.0, 0.0, False, "its arrival")
"""The age of a message that has no times."""
LOOK_PERIOD = 0.2
"""Time after which the graph is asked anew who publishes an input, s."""


class Feed:
    """One input of a node, whose ages are by this computer's ``clock``; in lock-step stamps count instead.

    ``mount`` returns the pose of a frame on the robot, if it is known. Without ``headers`` stamps are of a simulated clock.
    """

    def __init__(
        self,
        declared: Input,
        conversion: Conversion,
        *,
        lock_step: bool,
        clock: SystemClock,
        headers: bool = True,
        group: CallbackGroup | None = None,
        mount: Callable[[str], Pose | None] = lambda frame: None,
    ) -> None:
        self.declared = replace(declared, max_age=None) if lock_step else declared
        self._lock_step, self._headers, self._group, self._mount_of = lock_step, headers, group, mount
        self._waits_for_others = not (lock_step or declared.wakes)
        self.conversion, self.ages = conversion, Ages(clock)
        self.stamp: int | None = None
        """Stamp of the latest value, ns."""
        self.measured_at: int | None = None
        """Stamp of the measurement that the latest value is, or, if it lasts, of the end of this time so far, ns."""
        self.refusal: str | None = None
        self.cause = ""
        """Cause of the latest `Disagreement`, if the input halts."""
        self.on_refusal: Callable[[str], object] = lambda why: None
        """Called with the reason for which a message is refused."""
        self._newest: tuple[int, int | None] | None = None  # a step, and the stamp of the newest value up to it, if any
        self._latest: tuple[Any, float] | None = None  # replaced atomically, since two threads read it
        self._mount: Pose | None = None
        self._sources: set[bytes] | None = None
        self._replaced, self._looked = "", -math.inf
        self._refused = self._received = 0

    def connect(self, node: Node, hear: Any, newest_told: Callable[[], None]) -> Endpoint:
        """Subscribe to its topic, and return it as an endpoint for the diagnostics.

        ``hear`` is called with each message and its info, ``newest_told`` when the step of the newest value becomes known.
        """
        kind, qos = self.conversion.message, STREAM if self.declared.reliable else SENSOR
        if self._lock_step and self.declared.lock_step == "newest":

            def tell(message: TimeReference) -> None:
                newest = Time.from_msg(message.time_ref).nanoseconds
                self._newest = Time.from_msg(message.header.stamp).nanoseconds, newest or None
                newest_told()

            topic = f"{self.declared.topic}/newest"
            self._teller = node.create_subscription(TimeReference, topic, tell, LOCK_STEP, callback_group=self._group)
        self._subscription = node.create_subscription(
            kind,
            self.declared.topic,
            hear,
            LATCHED if self.declared.latched else (LOCK_STEP if self._lock_step else qos),
            callback_group=PolledGroup() if self._waits_for_others else self._group,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._node = node
        self.topic: str = self._subscription.topic_name
        return Endpoint(self.topic, type_name(kind), False, sole=self.declared.sole)

    def poll(self) -> None:
        """Read the messages of an input that does not wake the node."""
        if self._waits_for_others:
            take(self._subscription, self._node)

    @property
    def step(self) -> int | None:
        """Stamp of the lock-step step to which the latest value belongs, ns; None if unknown."""
        if self.declared.lock_step != "newest":
            return self.stamp
        step, newest = self._newest or (None, None)
        return step if newest == self.stamp else None

    def age(self, message: Any, info: Mapping[str, Any], steady: float) -> Age:
        """Return a message's age at a steady time, s, if ages count; raise `ValueError` if it is too old."""
        if (limit := self.declared.max_age) is None:
            return NEW
        age = self.ages.age_of(info, getattr(message, "header", None) if self._headers else None, steady)
        if why := age.complaint(limit, lasts=self.declared.lasts):
            raise ValueError(why)
        return age

    def read(self, message: Any, frame: str) -> Any:
        """Return a message's value; raise `ValueError` if it is none, or of another frame than ``frame``."""
        if self.conversion.in_world and message.header.frame_id != frame:
            received = short_repr(message.header.frame_id)
            raise ValueError(f"its frame is {received} instead of {frame!r} (the parameters frame_prefix and frame)")
        if self.declared.aged and not self.conversion.in_world:
            self._mount = self._mount_of(message.header.frame_id)
        return self.conversion.read(message)

    def accept(self, value: Any, now: float, stamp: int, age: Age = NEW, sent: int = 0) -> None:
        """Store a value with its stamp, ns, as the latest one; without, 0, ``sent`` is its time by the node's clock, ns."""
        self._latest, self.stamp, self.refusal = (value, now - age.since(self.declared.lasts)), stamp, None
        self.cause = value.cause if self.declared.halts else ""
        self.measured_at = stamp + round(min(self.declared.lasts, age.measured) * SECOND) if stamp else sent
        self._received += 1

    def refuse(self, why: str) -> bool:
        """Record that a message was refused, and return whether the reason is new."""
        news = self.refusal is None
        self.refusal = f"refused: {why}"
        self._refused += 1
        self.on_refusal(why)
        return news

    def begin(self) -> None:
        """Estimate the leads of the senders' clocks anew, forget what stopped the robot, and take the next source as right."""
        self.ages.begin()
        self.cause, self._replaced, self._sources = "", "", None

    def forget(self) -> None:
        """Forget the latest value, unless nobody will say it again, and all that is known of the senders' clocks."""
        if self.declared.latched:
            return
        self._latest = self.stamp = self._newest = None
        self.ages.begin()

    def _is_fresh(self, now: float) -> bool:
        latest, limit = self._latest, self.declared.max_age
        return latest is not None and (limit is None or now - latest[1] <= limit)

    def rivals(self) -> str:
        """Return that several nodes publish it where one may, if so."""
        count = self._subscription.get_publisher_count() if self.declared.sole else 0
        return f"{count} nodes publish {self.topic}, where one may; a killed one counts for 20 s" if count > 1 else ""

    def replaced(self, now: float) -> str:
        """Return that another node, whatever its name, publishes it than first since `begin`, where one may, if so."""
        if not self.declared.sole or self._lock_step:
            return ""
        if self._subscription.get_publisher_count() != 1:
            self._looked = -math.inf
        elif self._is_fresh(now) and now >= self._looked + LOOK_PERIOD:
            self._looked = now
            kind = type_name(self.conversion.message)
            there = [info for info in self._node.get_publishers_info_by_topic(self.topic) if info.topic_type == kind]
            sources = {bytes(info.endpoint_gid) for info in there}
            if self._sources is None:
                self._sources = sources or None
            elif not sources <= self._sources:
                names = " and ".join(map(node_name, there))
                self._replaced = f"{self.topic} has another source, {names}: enable again if it is the right one"
        return self._replaced

    def missing(self, now: float) -> str | None:
        """Return why a step has to wait for this input, if so."""
        if why := self.rivals():
            return why
        if not self.declared.required or self._is_fresh(now):
            return None
        return f"waits for {self.topic}" if self._latest is None else f"{self.topic} is older than {self.declared.max_age} s"

    def take(self, now: float, stamp: int) -> Any:
        """Return the value for a step at a stamp, ns; None if it is missing."""
        latest = self._latest
        value = latest[0] if latest is not None and self._is_fresh(now) else None
        if self.declared.once:
            self._latest = None
        if value is not None and self.declared.aged and self.stamp is not None:
            return Stamped(value, (stamp - self.stamp) / SECOND, self._mount)
        return value

    def figures(self, now: float) -> dict[str, str]:
        """Return its figures for the diagnostics."""
        age = f"{now - self._latest[1]:.2f} s ago" if self._latest else "never"
        return {self.topic: f"{age}, {self._received} received, {self._refused} refused{self.ages.figures()}"}


class Inputs:
    """The subscriptions of a shell's block, and the conversion of messages to its values."""

    def __init__(self, shell: Shell) -> None:
        node, common, inputs = shell.node, shell.common, shell.block.inputs
        self._node, self._common, self._now = node, common, shell.now
        self.clock, self._lock = SystemClock(), Lock()
        self.look()
        declared = {key: item for key, item in inputs.items() if not (common.lock_step and item.lock_step == "absent")}
        self.sees = any(source.type is Scan for source in declared.values())
        """Whether the block sees obstacles."""
        headers = not node.get_parameter("use_sim_time").value
        options = {"lock_step": common.lock_step, "clock": self.clock, "headers": headers, "group": shell.group}
        if self.sees:
            options["mount"] = hear_mounts(node, common.fixed(common.body_frame))
        ways = {key: conversion_of(source, stamped=common.enable_stamped_cmd_vel) for key, source in declared.items()}
        self.feeds = {key: Feed(source, ways[key], **options) for key, source in declared.items()}
        """The inputs by name."""

    def connect(self, drive: Scheduler) -> list[Endpoint]:
        """Subscribe for a drive, which is notified of each new value; return the topics for the diagnostics."""
        self._drive = drive
        told = {key: partial(drive.on_message, key, 0) for key in self.feeds}
        return [feed.connect(self._node, partial(self.receive, key), told[key]) for key, feed in self.feeds.items()]

    def look(self) -> float:
        """Compare the clocks, for the ages of messages, and return the steady time; call this at least every 20 ms."""
        with self._lock:  # the watchdog looks, too
            system, steady = read_clocks()
            self.clock.look(system=system, steady=steady)
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
        return next((why for feed in self.feeds.values() if (why := feed.cause or feed.replaced(now))), "")

    def rivals(self) -> str:
        """Return which input has several sources where one may be, or an empty text."""
        return next((why for feed in self.feeds.values() if (why := feed.rivals())), "")

    def take(self, now: float, stamp: int) -> dict[str, Any]:
        """Return the values for a step at a stamp, ns."""
        return {key: feed.take(now, stamp) for key, feed in self.feeds.items() if not feed.declared.halts}


def resting_on(feeds: Iterable[Feed], present: int) -> int:
    """Return the stamp of a command, ns: the oldest among the newest measurements of required inputs; the present without one.

    A measurement that lasts counts from its end, and one without a stamp is dated by the time at which it was sent.
    """
    resting = [feed.measured_at for feed in feeds if feed.declared.required and feed.declared.measured]
    return min((time for time in resting if time is not None), default=present)
