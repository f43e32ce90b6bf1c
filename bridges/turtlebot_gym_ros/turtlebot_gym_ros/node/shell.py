"""The shell that turns a block into a node.

It does for all nodes what is not control: conversion of messages, freshness of inputs, parameters, diagnostics, a watchdog for
blocked steps, stop commands and a clean shutdown; its drive (`drives`) decides when the block runs. The block computes in the
executor's thread. No blocked step holds up the watchdog's thread.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from threading import Thread
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Empty
from std_srvs.srv import Empty as Call
from std_srvs.srv import Trigger

from cmd_vel_guard import process
from cmd_vel_guard.declare import declare
from cmd_vel_guard.qos import STREAM
from cmd_vel_guard.reports import ERROR, WARN
from cmd_vel_guard.sent import read_clocks
from turtlebot_gym_ros.base.executor import FastExecutor, FastGroup
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Block, Every
from turtlebot_gym_ros.node.diagnostics import Reporter
from turtlebot_gym_ros.node.drives import make_drive
from turtlebot_gym_ros.node.feed import Inputs
from turtlebot_gym_ros.node.navigate import be_active, offer
from turtlebot_gym_ros.node.outputs import Outputs
from turtlebot_gym_ros.node.switch import Switch

P = TypeVar("P")

WATCH_PERIOD, REPORT_PERIOD = 0.02, 1.0
"""Periods of the watchdog thread and of the diagnostics, s."""


class Shell:
    """A node around a block.

    Besides the block's topics it has the service ``~/reset`` (Trigger), subscribes to ``reset`` (Empty), on which the plant
    announces its resets, and publishes ``/diagnostics``. If an output has a ``stop``, it also has a `Switch`. With
    ``lock_step`` it runs by the steps' stamps (`lockstep`).

    A parameter that is unknown, of the wrong type or out of range, or that ``make`` refuses, raises `ValueError`.

    Args:
        make: Makes the block from its parameters, of the dataclass ``params``: usually its class.
        name: The node's name; None for that of ``make``, in snake case.
        namespace: The namespace of the node and its topics; None for that of the command line.
        overrides: Values of parameters.
        arguments: ROS arguments for this node only: parameters, remappings.
        now: The steady clock, s.
    """

    def __init__(
        self,
        make: Callable[[P], Block],
        params: type[P],
        *,
        name: str | None = None,
        namespace: str | None = None,
        context: Context | None = None,
        overrides: Mapping[str, Any] | None = None,
        arguments: Sequence[str] = (),
        now: Callable[[], float] = lambda: read_clocks()[1],
    ) -> None:
        self.node = Node(
            name or re.sub(r"(?<!^)(?=[A-Z])", "_", make.__name__).lower(),
            namespace=namespace,
            context=context,
            cli_args=["--ros-args", *arguments] if arguments else None,
            parameter_overrides=[Parameter(key, value=value) for key, value in (overrides or {}).items()],
            automatically_declare_parameters_from_overrides=True,
        )
        try:
            self.common, self.params = declare(self.node, Common, params)
            self.block = make(self.params)
            self.now = now
            self._log = self.node.get_logger()
            self._connect()
        except BaseException:
            self.node.destroy_node()
            raise
        self._closing = False
        self._watcher = Thread(target=self._watch, name=f"{self.node.get_name()}_watch", daemon=True)
        self._watcher.start()

    def _connect(self) -> None:
        node, block, lock_step = self.node, self.block, self.common.lock_step
        self._waits: str | None = "has not run yet"
        self._trouble = self._notice = None
        self._steps = self._dropped = 0
        self._is_plant = isinstance(block.trigger, Every) and block.trigger.plant
        self.group = FastGroup(node)
        self.inputs = Inputs(self)
        self.feeds = self.inputs.feeds
        self.outputs = Outputs(node, block.outputs, self.common, self.inputs.resting_on)
        self._drive = make_drive(self)
        self._reporter = Reporter(node, [*self.outputs.endpoints, *self.inputs.connect(self._drive)], plant=self._is_plant)
        node.create_service(Trigger, "~/reset", self._serve_reset)
        for name, call in getattr(block, "services", {}).items():
            node.create_service(Call, name, lambda request, response, call=call: call() or response)
        if self._is_plant:
            self._announce = node.create_publisher(Empty, "reset", STREAM)
        elif not lock_step:  # in lock-step the stamps show where an episode begins
            node.create_subscription(Empty, "reset", lambda message: self.reset("the plant was reset"), STREAM)
        rests = any(feed.declared.halts for feed in self.feeds.values())
        self._resume = node.create_publisher(Empty, "resume", STREAM) if rests else None
        self.switch = Switch(self) if self.outputs.moving else None
        if self.switch:
            self.at_rest = self.switch.at_rest
        self._action = offer(node, block, self.feeds, self.common)
        if name := getattr(block, "nav2_name", ""):
            be_active(node, name)

    def step(self, stamp: int) -> bool:
        """Run the block once at a stamp, ns, publish the result, and return whether it ran."""
        now, switch, drive = self.now(), self.switch, self._drive
        if switch and not switch.safety.enabled:
            return False
        self._waits = self._missing(now)
        if self._waits:
            drive.pause()
            if switch:
                switch.stop(self._waits)
            return False
        dt = drive.interval(stamp)
        ticket = switch.safety.begin(now=now) if switch else None
        try:
            outputs = self.block.step(dt, **self.inputs.take(now, stamp))
            messages = {key: self.outputs.message(key, value, stamp) for key, value in outputs.items()}
        except BaseException as error:  # a block may be any code: whatever it raises stops the robot, even SystemExit
            self._fault(f"{type(error).__name__}: {error}")
            return False
        finally:
            if switch:
                switch.safety.end()
        self._steps += 1
        notice = getattr(self.block, "notice", None)
        if notice and notice != self._notice:
            self._log.warning(notice)
        self._notice = notice
        if switch:
            return self._move(switch, ticket, messages, stamp)
        self._trouble = None
        self.outputs.publish_answer(messages, stamp)
        if self._action:
            self._action.look()
        return True

    def _move(self, switch: Switch, ticket: object, messages: Mapping[str, Any], stamp: int) -> bool:
        """Publish the result of a step, unless it was stopped meanwhile; a block that omits its command is done."""
        with switch.safety.lock:  # so that nothing is published after a stop's zeros
            answers = ticket is switch.safety.ticket
            if not all(key in messages for key in self.outputs.moving):
                if answers:
                    switch.stop("done")
                    if self.common.lock_step:  # at rest, but time advances
                        self.outputs.publish_answer(self.outputs.stops(stamp), stamp)
            elif answers and (stale := self._missing(self.now())):  # it was suspended during the step
                self._waits = stale
                switch.stop(stale)
                answers = False
            elif switch.safety.activate(ticket):
                self.outputs.publish_answer(messages, stamp)
            else:
                self._dropped += 1
                answers = False
        switch.watch()
        return answers

    def _missing(self, now: float) -> str | None:
        why = self.inputs.missing(now) or self._drive.missing()
        return why or (self.inputs.halted(now) if self.switch else None) or None

    def _fault(self, why: str) -> None:
        if why != self._trouble:
            self._log.error(f"fault: {why}")
        self._trouble = why
        if self.switch:
            self.switch.stop(f"fault: {why}", disable=True)

    def restart(self) -> None:
        """Begin anew when the block may move the robot again: what stopped it before does not count any more."""
        self._trouble = None
        for feed in self.feeds.values():
            feed.begin()
        if self._resume:
            self._resume.publish(Empty())
        self.begin_anew()

    def pause(self) -> None:
        """Let the block go on after a gap in the messages on which it runs."""
        getattr(self.block, "pause", self.block.reset)()
        self._drive.reset()

    def begin_anew(self) -> None:
        """Reset the block and its drive."""
        self.block.reset()
        self._drive.reset()

    def reset(self, why: str) -> None:
        """Clear all inputs and reset the block; a robot stops until they have arrived again."""
        if self.switch:
            self.switch.stop(why)
        for feed in self.feeds.values():
            feed.forget()
        self.begin_anew()

    def _serve_reset(self, request: Any, response: Any) -> Any:
        self.reset("reset")
        if self._is_plant:
            self._drive.new_episode()
            self._announce.publish(Empty())
        response.success, response.message = True, "reset"
        return response

    def _watch(self) -> None:
        """In the watchdog's thread, stop a robot whose inputs have become stale, and report."""
        next_report = self.now() + REPORT_PERIOD
        context = self.node.context
        while not self._closing and not time.sleep(WATCH_PERIOD) and context.ok():  # an Event may wait by the system clock
            now = self.now()
            self.inputs.look()
            if self.switch:
                with self.switch.safety.lock:  # so that what is enabled now does not stop by what it forgets
                    if (why := self.inputs.halted(now)) and self.switch.safety.enabled:
                        self._fault(why)
                if self.switch.safety.phase == "active" and (stale := self._missing(now)):
                    self._waits = stale
                    self.switch.stop(stale)
                self.switch.watch()
            if now >= next_report:
                next_report = now + REPORT_PERIOD
                try:
                    self._report(now)
                except Exception as error:  # an error in a report must not end the watchdog
                    self._log.error(f"no diagnostics: {error}")

    def _report(self, now: float) -> None:
        remarks = [*(f"{feed.topic}: {feed.refusal}" for feed in self.feeds.values() if feed.refusal), self._notice]
        faults = self._drive.trouble(), self._trouble and f"fault: {self._trouble}", getattr(self.block, "fault", None)
        problems = [(WARN, why) for why in remarks if why] + [(ERROR, why) for why in faults if why]
        state = self.switch.safety.state if self.switch else (self._waits or "runs")
        values = {"state": state, "steps": self._steps, "results dropped": self._dropped} | getattr(self.block, "figures", {})
        for feed in self.feeds.values():
            values |= feed.figures(now)
        self._reporter.publish(problems, state, values)

    def close(self) -> None:
        """Stop the robot if it moves, wait until messages are delivered unless the context has ended, and destroy the node."""
        if self._closing:
            return
        self._closing = True
        self._watcher.join()
        if self.node.context.ok():
            if self.switch:
                self.switch.close()
            self.outputs.flush()
            if self._action:
                self._action.close()
        self.node.destroy_node()


def run(make: Callable[[P], Block], params: type[P], argv: Sequence[str] | None = None, *, name: str | None = None) -> int:
    """Run a block as a node until a signal ends it; see `Shell` for its arguments, and `process.run` for the command line."""
    return process.run([partial(Shell, make, params, name=name)], argv, executor=FastExecutor, in_thread=True)
