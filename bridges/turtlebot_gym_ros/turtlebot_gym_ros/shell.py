"""The shell that turns a block into a node.

It owns, once for all nodes, what has nothing to do with control: conversion of messages, freshness of inputs, triggers,
parameters, diagnostics, the watch over a blocked step, stop commands and a clean end. The block computes in the executor's
thread. A thread of its own watches by the steady clock, which neither a paused ``/clock`` nor a blocked step can hold up.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from threading import Event, Thread
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Bool, Empty, Header, String
from std_srvs.srv import SetBool, Trigger

from turtlebot_gym.parameters import Command
from turtlebot_gym_ros.block import Block, Every
from turtlebot_gym_ros.convert import conversion
from turtlebot_gym_ros.diagnostics import ERROR, WARN, Endpoint, Problem, graph_problems, report, type_name
from turtlebot_gym_ros.feed import Feed
from turtlebot_gym_ros.parameters import Common, declare
from turtlebot_gym_ros.qos import LATCHED, SENSOR, STREAM, overridable
from turtlebot_gym_ros.safety import Safety
from turtlebot_gym_ros.triggers import Grid, Messages

P = TypeVar("P")

WATCH_PERIOD = 0.02
"""Period of the watching thread, s."""
CLOCK_SILENCE = 0.5
"""A ROS clock that stands still for longer stops the robot, s."""
CLOCK_JUMP = 5.0
"""A ROS clock that leaps ahead by more, or back at all, resets the block and stops the robot, s."""
NO_OBSTACLE_AVOIDANCE = "It drives without obstacle avoidance: whoever enables it watches the robot."


class Shell:
    """A node around a block.

    Besides the block's topics it has ``~/reset`` (Trigger), hears ``reset`` (Empty), by which the plant tells all others that it
    was reset, and publishes ``/diagnostics``. Where an output has a ``stop``, there are also ``~/enable`` (SetBool), ``~/state``
    (String, latched: "silent: why", "active", "stopping: why") and ``emergency_stop`` (Bool).

    Args:
        make: Makes the block from its parameters: usually its class.
        params: The dataclass of its parameters.
        name: The node's name; None for that of ``make``, in snake case.
        context: The rclpy context; None for the default one.
        overrides: Values of parameters.
        arguments: ROS arguments of this node alone, such as remappings.
        now: The steady clock, s.

    Raises:
        ValueError: If a parameter is unknown, of the wrong type or out of range, or ``make`` refuses it.
    """

    def __init__(
        self,
        make: Callable[[P], Block],
        params: type[P],
        *,
        name: str | None = None,
        context: Context | None = None,
        overrides: Mapping[str, Any] | None = None,
        arguments: Sequence[str] = (),
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.node = Node(
            name or re.sub(r"(?<!^)(?=[A-Z])", "_", make.__name__).lower(),
            context=context,
            cli_args=["--ros-args", *arguments] if arguments else None,
            parameter_overrides=[Parameter(key, value=value) for key, value in (overrides or {}).items()],
            automatically_declare_parameters_from_overrides=True,
        )
        try:
            self.common, self.params = declare(self.node, Common, params)
            self.block = make(self.params)
            self._now = now
            self._log = self.node.get_logger()
            self._connect()
        except BaseException:
            self.node.destroy_node()
            raise
        self._closing = Event()
        self._watcher = Thread(target=self._watch, name=f"{self.node.get_name()}_watch", daemon=True)
        self._watcher.start()

    def _connect(self) -> None:
        """Create the node's topics, services and timer."""
        node, block, stamped = self.node, self.block, self.common.enable_stamped_cmd_vel
        moves = any(output.stop is not None for output in block.outputs.values())
        self.safety = Safety(enabled=self.common.start_enabled) if moves else None
        self._waits: str | None = "has not run yet"
        self._trouble: str | None = None
        self._known: set[Problem] = set()
        self._steps = self._overruns = self._dropped = 0

        self._publishers: dict[str, Any] = {}
        self._writers = {key: conversion(output.type, stamped=stamped) for key, output in block.outputs.items()}
        self._feeds = {key: Feed(item, conversion(item.type, stamped=stamped)) for key, item in block.inputs.items()}
        self._endpoints: list[Endpoint] = []
        for key, output in block.outputs.items():
            publisher = node.create_publisher(
                self._writers[key].message, output.topic, STREAM, qos_overriding_options=overridable()
            )
            self._publishers[key] = publisher
            message = type_name(self._writers[key].message)
            self._endpoints.append(Endpoint(publisher.topic_name, message, True, output.stop is not None))
        for key, feed in self._feeds.items():
            subscription = node.create_subscription(
                feed.conversion.message,
                feed.declared.topic,
                lambda message, key=key: self._receive(key, message),
                STREAM if feed.declared.reliable else SENSOR,
                qos_overriding_options=overridable(),
            )
            feed.topic = subscription.topic_name
            self._endpoints.append(Endpoint(feed.topic, type_name(feed.conversion.message), False))

        trigger = block.trigger
        self._plant = isinstance(trigger, Every) and trigger.speed is not None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        if isinstance(trigger, Every):
            self._rule = Grid(trigger)
            self._sets_clock = trigger.speed not in (None, 1.0)
            clock = self._steady if self._sets_clock else node.get_clock()
            node.create_timer(trigger.period / (trigger.speed or 1.0), self._timer, clock=clock)
        else:
            self._rule = Messages(trigger)
            self._sets_clock = False
        if self._sets_clock:
            self._clock = node.create_publisher(ClockMessage, "/clock", STREAM)

        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", STREAM)
        node.create_service(Trigger, "~/reset", self._serve_reset)
        if self._plant:
            self._announce = node.create_publisher(Empty, "reset", STREAM)
        else:
            node.create_subscription(Empty, "reset", lambda message: self.reset("the plant was reset"), STREAM)
        if self.safety:
            node.create_service(SetBool, "~/enable", self._serve_enable)
            self._state = node.create_publisher(String, "~/state", LATCHED)
            self._told: str | None = None
            node.create_subscription(Bool, "emergency_stop", self._hear_emergency, SENSOR)
            self._tell()
        self._simulated_time = node.get_parameter("use_sim_time").value and not self._sets_clock
        self._clock_at, self._clock_moved = 0, self._now()
        threshold = JumpThreshold(min_forward=Duration(seconds=CLOCK_JUMP), min_backward=Duration(nanoseconds=-1))
        self._jumps = node.get_clock().create_jump_callback(threshold, post_callback=self._jumped)

    # What runs the block, in the executor's thread.

    def _time(self) -> int:
        """Return the present of the clock that the block runs by, ns."""
        if self._sets_clock and isinstance(self._rule, Grid):
            return self._rule.simulated(self._steady.now().nanoseconds)
        return self.node.get_clock().now().nanoseconds

    def _receive(self, key: str, message: Any) -> None:
        """Take in a message, and run the block where it is the trigger."""
        feed = self._feeds[key]
        is_trigger = isinstance(self._rule, Messages) and self._rule.input == key
        stamp = Time.from_msg(message.header.stamp).nanoseconds if hasattr(message, "header") else self._time()
        try:
            value = feed.read(message, self.common.frame)
            if is_trigger:
                self._rule.check(stamp)  # type: ignore[union-attr]
        except ValueError as error:
            if feed.refuse(str(error)):
                self._log.warning(f"{feed.topic}: refused: {error}")
            return
        feed.accept(value, self._now())
        if is_trigger:
            due, gap = self._rule.due(stamp)  # type: ignore[union-attr]
            if gap:
                self._log.warning(f"{feed.topic}: {gap}; starting again from this message.")
                self._restart()
            if due:
                self._step(stamp)

    def _timer(self) -> None:
        for stamp in self._rule.due_until(self._time()):  # type: ignore[union-attr]
            if self._sets_clock:
                self._clock.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))
            self._step(stamp)

    def _step(self, stamp: int) -> None:
        """Run the block once, and publish what comes of it."""
        now, safety = self._now(), self.safety
        if safety and not safety.enabled:
            return
        self._waits = self._missing(now)
        if self._waits:
            self._rule.pause()
            if safety:
                safety.stop(self._waits, now=now)
                self._send_stops()
            return
        dt = self._rule.interval(stamp)
        ticket = safety.begin(now=now) if safety else 0
        try:
            outputs = self.block.step(dt, **{key: feed.take(now) for key, feed in self._feeds.items()})
            messages = {key: self._message(key, value, stamp) for key, value in outputs.items()}
        except Exception as error:  # a block is anybody's code: whatever it raises stops the robot
            self._fault(f"{type(error).__name__}: {error}")
            return
        finally:
            if safety:
                safety.end()
        self._steps += 1
        self._overruns += self._now() - now > self._rule.period > 0.0
        if not safety:
            self._trouble = None
            self._publish(messages)
            return
        with safety.lock:  # so that nothing is published behind a stop's zeros
            if all(key in messages for key, output in self.block.outputs.items() if output.stop is not None):
                if safety.activate(ticket):
                    self._publish(messages)
                else:
                    self._dropped += 1
            elif ticket == safety.ticket:
                safety.stop("done", now=self._now())
        self._send_stops()
        self._tell()

    def _missing(self, now: float) -> str | None:
        """Return what a step has to wait for, if anything."""
        if self._simulated_time and not self.node.get_clock().now().nanoseconds:
            return "waits for /clock"
        return next((why for feed in self._feeds.values() if (why := feed.missing(now))), self._rule.slow)

    def _message(self, key: str, value: Any, stamp: int) -> Any:
        """Return the message of an output: commands are stamped now, all else at the step's stamp."""
        writer, is_command = self._writers[key], self.block.outputs[key].type is Command
        frame = self.common.frame if writer.in_world else self.common.body_frame
        at = self._time() if is_command else stamp
        message = writer.write(value, Header(stamp=Time(nanoseconds=at).to_msg(), frame_id=frame))
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = self.common.body_frame
        return message

    def _publish(self, messages: Mapping[str, Any]) -> None:
        for key, publisher in self._publishers.items():
            if key in messages:
                publisher.publish(messages[key])

    def _fault(self, why: str) -> None:
        """Report what a step has come to, and stop until enabled again."""
        if why != self._trouble:
            self._log.error(f"fault: {why}")
        self._trouble = why
        if self.safety:
            self.safety.stop(f"fault: {why}", now=self._now(), disable=True)
            self._send_stops()
            self._tell()

    def _restart(self) -> None:
        self.block.reset()
        self._rule.reset()

    def reset(self, why: str) -> None:
        """Forget all inputs and reset the block; a robot is stopped until they have come again."""
        if self.safety:
            self.safety.stop(why, now=self._now())
            self._send_stops()
        for feed in self._feeds.values():
            feed.forget()
        self._restart()

    # What is asked of the node.

    def _serve_reset(self, request: Any, response: Any) -> Any:
        self.reset("reset")
        if self._plant:
            self._announce.publish(Empty())
        response.success, response.message = True, "reset"
        return response

    def _serve_enable(self, request: Any, response: Any) -> Any:
        refusal = self.enable() if request.data else self.disable()
        response.success = refusal is None
        response.message = refusal or (f"enabled. {NO_OBSTACLE_AVOIDANCE}" if request.data else "disabled")
        return response

    def enable(self) -> str | None:
        """Let the block move the robot, as soon as its inputs are there; or return why not."""
        if self.safety is None:
            return "this node moves nothing"
        if not self.safety.enabled:
            refusal = self.safety.enable(now=self._now())
            if refusal:
                return refusal
            self._trouble = None
            self._restart()
            self._log.warning(f"enabled. {NO_OBSTACLE_AVOIDANCE}")
        self._tell()
        return None

    def disable(self) -> None:
        """Stop the robot, and leave it to others a second later."""
        if self.safety:
            self.safety.stop("not enabled", now=self._now(), disable=True)
            self._send_stops()
            self._tell()

    def _hear_emergency(self, message: Bool) -> None:
        assert self.safety
        self.safety.hear_emergency(message.data, now=self._now())
        self._send_stops()
        self._tell()

    def _jumped(self, jump: Any) -> None:
        """Start again after a leap of the ROS clock; a robot that moved must be enabled again."""
        if self._sets_clock:
            return
        if self.safety and self.safety.phase == "active":
            self.safety.stop("fault: the clock jumped", now=self._now(), disable=True)
        self.reset("the clock jumped")

    # What watches, in a thread of its own.

    def _watch(self) -> None:
        next_report = self._now() + 1.0
        while not self._closing.wait(WATCH_PERIOD):
            now = self._now()
            if self.safety:
                self._watch_safety(self.safety, now)
            if now >= next_report:
                next_report = now + 1.0
                self._report(now)

    def _watch_safety(self, safety: Safety, now: float) -> None:
        if self._simulated_time:
            at = self.node.get_clock().now().nanoseconds
            if at != self._clock_at:
                self._clock_at, self._clock_moved = at, now
        if safety.phase == "active":
            stale = self._missing(now)
            if now - self._clock_moved > CLOCK_SILENCE and self._simulated_time:
                stale = "/clock stands still"
            if stale:
                self._waits = stale
                safety.stop(stale, now=now)
        self._send_stops()
        self._tell()

    def _send_stops(self) -> None:
        """Send what stops the robot, if it is time to."""
        if not self.safety:
            return
        with self.safety.lock:
            if self.safety.tick(now=self._now()):
                self._publish_stops()

    def _publish_stops(self) -> None:
        stops = {key: output.stop for key, output in self.block.outputs.items() if output.stop is not None}
        self._publish({key: self._message(key, stop, self._time()) for key, stop in stops.items()})

    def _tell(self) -> None:
        """Publish the state where it has changed."""
        assert self.safety
        with self.safety.lock:
            state = self.safety.state
            if state != self._told:
                self._told = state
                self._state.publish(String(data=state))

    def _own_problems(self) -> list[Problem]:
        """Return what is wrong with this node itself."""
        refused = [Problem(WARN, f"{feed.topic}: {feed.refusal}") for feed in self._feeds.values() if feed.refusal]
        slow = [Problem(ERROR, self._rule.slow)] if self._rule.slow else []
        return refused + slow + ([Problem(ERROR, self._trouble)] if self._trouble else [])

    def _report(self, now: float) -> None:
        around = graph_problems(self.node, self._endpoints, plant=self._plant)
        for problem in around:
            if problem not in self._known:
                (self._log.error if problem.level == ERROR else self._log.warning)(problem.text)
        self._known = set(around)
        problems = around + self._own_problems()
        state = self.safety.state if self.safety else (self._waits or "runs")
        values = {"state": state, "steps": self._steps, "overruns": self._overruns, "results dropped": self._dropped}
        for feed in self._feeds.values():
            values |= feed.figures(now)
        self._diagnostics.publish(report(self.node, problems, state, values))

    def close(self) -> None:
        """Stop the robot if it moves, wait until that is heard, and destroy the node."""
        if self._closing.is_set():
            return
        self._closing.set()
        self._watcher.join()
        if self.safety:
            with self.safety.lock:
                moved = self.safety.phase != "silent"
                self.safety.stop("the node ends", now=self._now(), disable=True)
            for _ in range(3 if moved else 0):
                self._publish_stops()
                time.sleep(0.03)
            for publisher in self._publishers.values() if moved else ():
                publisher.wait_for_all_acked(Duration(seconds=0.5))
            self._tell()
        self._jumps.unregister()
        self.node.destroy_node()
