"""pykal's ``ROSNode`` on this package's shell: a callback over arrays becomes a node, with the same arguments.

    from turtlebot_gym_ros import ROSNode  # instead of: from pykal.ros.ros_node import ROSNode

What is different:

* A node that publishes on a topic ``cmd_vel`` stops the robot, with zeros for a second, when its callback fails, is skipped or
  takes longer than 0.5 s, and at ``stop``. It obeys ``emergency_stop``, and starts enabled.
* A callback is skipped, not called in vain, while an argument without a default is missing.
* Messages whose array has no stamp get the present one, and the world's frame. pykal sends the stamp 0.
* Subscriptions match publishers of any reliability. ``stop`` destroys the node, and ``start`` makes it anew.

References:
    pykal, ``src/pykal/ros/ros_node.py``, https://github.com/nehalsinghmangat/pykal
"""

from __future__ import annotations

import atexit
import inspect
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from threading import Thread, current_thread
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_default_context

from turtlebot_gym.config import POSITIVE, build, refusal
from turtlebot_gym_ros.base.discovery import prepare
from turtlebot_gym_ros.base.executor import best_executor
from turtlebot_gym_ros.base.names import type_name
from turtlebot_gym_ros.node.arrays import checked, fields_of, size_of, value_of
from turtlebot_gym_ros.node.block import Every, Input, Output
from turtlebot_gym_ros.node.shell import Shell
from turtlebot_gym_ros.node.stale import Received, Stale

_NONE = inspect.Parameter.empty


@dataclass(frozen=True, kw_only=True)
class _Params:
    """Such a node has no parameters of its own."""


class _Block:
    """The callback as a block."""

    def __init__(self, owner: ROSNode, params: _Params) -> None:
        self._owner = owner
        self.trigger = Every(1.0 / owner.rate_hz)
        self.inputs = {
            name: Input(topic=topic, type=tuple, message=kind, read=received.read, max_age=None, required=False, reliable=False)
            for name, (topic, kind, received) in owner.received.items()
        }
        self.outputs = {topic: _output(topic, kind) for topic, (_, kind) in owner.published.items()}
        self.notice: str | None = None

    def reset(self) -> None:
        """Do nothing: the callback keeps its own state."""

    def step(self, dt: float, /, **inputs: Any) -> dict[str, NDArray[np.float64]]:
        """Call the callback, and return the arrays to publish."""
        self.notice, returned = self._owner.call()
        sent = {}
        for topic, (key, kind) in self._owner.published.items():
            if key in returned:
                try:
                    sent[topic] = checked(f"{key}, for {topic},", returned[key], fields_of(kind))
                except (ValueError, TypeError) as error:
                    self.notice = self._owner.fail(f"publish:{topic}", error)
        if sent:  # a command that is left out beside other outputs is to stand
            sent |= {
                topic: output.stop for topic, output in self.outputs.items() if output.stop is not None and topic not in sent
            }
        return sent


def _output(topic: str, kind: type) -> Output:
    """Return the output of a topic; one that moves a robot stops it with zeros."""
    moves = topic.rpartition("/")[2] == "cmd_vel"
    return Output(topic=topic, type=value_of(kind), stop=np.zeros(size_of(fields_of(kind)) or 0) if moves else None)


class ROSNode:
    """A callback as a node: ``callback(tk, **inputs)`` returns arrays by name; see `arrays` for their order.

    Args:
        node_name: The node's name.
        callback: Called at each step with the time since the start, s, and the arrays of the inputs that have arrived.
        subscribes_to: Topic, message type and the callback's argument for each input.
        publishes_to: Key of the returned array, message type and topic for each output.
        rate_hz: Steps a second.
        use_single_threaded_executor: True: callbacks of a node run one after the other.
        qos_profile: None: set the ROS parameters ``qos_overrides`` instead.
        stale_config: Fields of `Stale` by argument.
        required_topics: Arguments without which the callback is skipped.
        error_callback: Called as ``error_callback(context, error)`` with pykal's contexts: "callback", "publish:TOPIC",
            "required_topics" and "heartbeat:ARGUMENT".
        enable_diagnostics: Accepted; counts are kept in any case, and ``/diagnostics`` is published.
        heartbeat_config: Longest age of an input by argument, s, beyond which the error callback gets a ``TimeoutError``.
        validate_callback_signature: Whether to compare the callback's arguments with the inputs.

    Raises:
        ValueError: If an argument is refused, or a message type has no array.
    """

    def __init__(
        self,
        *,
        node_name: str,
        callback: Callable[..., Mapping[str, Any] | None],
        subscribes_to: Sequence[tuple[str, type, str]] | None = None,
        publishes_to: Sequence[tuple[str, type, str]] | None = None,
        rate_hz: float = 10.0,
        use_single_threaded_executor: bool = True,
        qos_profile: None = None,
        stale_config: Mapping[str, Mapping[str, Any]] | None = None,
        required_topics: Collection[str] | None = None,
        error_callback: Callable[[str, Exception], None] | None = None,
        enable_diagnostics: bool = False,
        heartbeat_config: Mapping[str, float] | None = None,
        validate_callback_signature: bool = True,
    ) -> None:
        if qos_profile is not None:
            raise ValueError("qos_profile must be None: set the ROS parameters qos_overrides.TOPIC.publisher... instead.")
        if not use_single_threaded_executor:
            raise ValueError("use_single_threaded_executor must be True: the callbacks of a node run one after the other.")
        self.rate_hz = POSITIVE.check("rate_hz", rate_hz)
        self._name, self._callback, self._required = node_name, callback, dict.fromkeys(required_topics or ())
        stale = {name: build(Stale, given, f"stale_config[{name!r}]") for name, given in (stale_config or {}).items()}
        self._error_callback, beats = error_callback, dict(heartbeat_config or {})
        self.received = {
            name: (topic, type_name(kind), Received(fields_of(kind), stale.get(name, Stale()), beats.get(name)))
            for topic, kind, name in _entries("subscribes_to", "(topic, message type, argument)", subscribes_to, at=0)
        }
        """Topic, type and latest array of each input."""
        entries = _entries("publishes_to", "(key, message type, topic)", publishes_to, at=2)
        self.published = {topic: (key, kind) for key, kind, topic in entries}
        """Key and type of each output."""
        for topic, (_, kind) in self.published.items():
            _output(topic, kind)
        for what, names in (("required_topics", self._required), ("stale_config", stale), ("heartbeat_config", beats)):
            for name in [one for one in names if one not in self.received]:
                raise refusal(what, f"arguments of subscribes_to ({', '.join(self.received) or 'none'})", name)
        parameters = inspect.signature(callback).parameters
        if validate_callback_signature:
            _require_arguments(parameters, self.received)
        self._required |= {name: None for name in self.received if name in parameters and parameters[name].default is _NONE}
        self.shell: Shell | None = None
        """The node's shell, once there is one."""
        self._executor: Any = None
        self._steps = self._errors = 0
        self._born = 0.0

    def call(self) -> tuple[str | None, Mapping[str, Any]]:
        """Call the callback with what has arrived; return a complaint, if any, and what it returned."""
        assert self.shell is not None
        now = self.shell.node.get_clock().now()
        taken = {name: received.take(now.nanoseconds * 1e-9) for name, (_, _, received) in self.received.items()}
        inputs = {name: value for name, value in taken.items() if value is not None}
        missing = [name for name in self._required if name not in inputs]
        if missing:
            return self.fail("required_topics", ValueError(f"waits for {', '.join(missing)}")), {}
        for name, (_, _, received) in self.received.items():
            age = time.monotonic() - received.arrived
            if received.timeout is not None and received.count and age > received.timeout:
                self.fail(f"heartbeat:{name}", TimeoutError(f"{name} is {age:.2f} s old, more than {received.timeout} s"))
        try:
            returned = self._callback((now - self._begun).nanoseconds * 1e-9, **inputs)
        except Exception as error:
            self._errors += 1
            return self.fail("callback", error), {}
        self._steps += 1
        return None, returned if isinstance(returned, Mapping) else {}

    def fail(self, context: str, error: Exception) -> str:
        """Report an error to the error callback, and return it as a line."""
        if self._error_callback is not None:
            self._error_callback(context, error)
        return f"{context}: {type(error).__name__}: {' '.join(str(error).split())}"

    def create_node(self) -> Node:
        """Create the node, unless there is one, in rclpy's default context, and return it."""
        if self.shell is None:
            prepare()
            if not get_default_context().ok():
                rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's own end it before zeros can be sent
            self.shell = Shell(partial(_Block, self), _Params, name=self._name, overrides={"start_enabled": True})
            self._begun, self._born = self.shell.node.get_clock().now(), time.monotonic()
            atexit.register(self.stop)
        return self.shell.node

    def start(self) -> None:
        """Run the node in a thread."""
        if self.is_running():
            return
        node = self.create_node()
        self._executor = best_executor()(context=node.context)
        self._executor.add_node(node)
        self._thread = Thread(target=self._spin, args=(self._executor,), name=self._name, daemon=True)
        self._thread.start()

    def _spin(self, executor: Any) -> None:
        """Run until `stop`, or until somebody shuts rclpy down."""
        try:
            executor.spin()
        except Exception:  # rclpy's own executors raise when it is shut down
            if executor.context.ok():
                raise
        finally:
            if executor is self._executor:
                self.stop()

    def stop(self) -> None:
        """Stop the robot if the node moves one, and destroy the node."""
        atexit.unregister(self.stop)
        shell, executor, self.shell, self._executor = self.shell, self._executor, None, None
        if executor is not None:
            executor.shutdown(timeout_sec=0.5)
            if self._thread is not current_thread():
                self._thread.join(2.0)
        if shell is not None:
            shell.close()

    destroy = stop

    def is_running(self) -> bool:
        """Return whether the node runs."""
        return self._executor is not None and self._thread.is_alive()

    def latest_inputs(self) -> dict[str, NDArray[np.float64]]:
        """Return the latest arrays by argument."""
        return {name: one.value.copy() for name, (_, _, one) in self.received.items() if one.value is not None}

    def get_diagnostics(self) -> dict[str, Any]:
        """Return uptime, counts and rates: the keys of pykal, without its latencies."""
        now = time.monotonic()
        uptime = now - self._born if self.shell else 0.0
        topics = {
            name: {
                "msg_count": one.count,
                "rate_hz": one.count / uptime if uptime else 0.0,
                "last_msg_age": now - one.arrived if one.count else None,
            }
            for name, (_, _, one) in self.received.items()
        }
        rate = self._steps / uptime if uptime else 0.0
        counts = {"callback_count": self._steps, "callback_errors": self._errors, "callback_rate_hz": rate}
        return {"uptime_seconds": uptime, **counts, "topics": topics}


def _entries(what: str, rule: str, given: Sequence[Any] | None, *, at: int) -> list[tuple[Any, Any, Any]]:
    """Return entries of three, whose topics are different."""
    entries = list(given or ())
    for entry in entries:
        if not isinstance(entry, (tuple, list)) or len(entry) != 3 or not all(isinstance(entry[i], str) for i in (0, 2)):
            raise refusal(f"each of {what}", rule, entry)
        fields_of(entry[1])
    topics = [entry[at] for entry in entries]
    if twice := [topic for topic in topics if topics.count(topic) > 1]:
        raise ValueError(f"{what} must name each topic once, but names {twice[0]} {topics.count(twice[0])} times.")
    return entries


def _require_arguments(parameters: Mapping[str, inspect.Parameter], inputs: Collection[str]) -> None:
    """Require that a callback takes ``tk`` first, and no argument that is no input."""
    names = [name for name, one in parameters.items() if one.kind is not one.VAR_KEYWORD]
    if names[:1] != ["tk"]:
        raise refusal("callback", "a function whose first argument is tk", names)
    has_more = len(names) < len(parameters)
    for name in names[1:]:
        if name not in inputs and not has_more:
            raise refusal("callback", f"a function of tk and of arguments of subscribes_to ({', '.join(inputs)})", name)
