"""The switch of a node that moves a robot: `Safety` with its services, its topics and its zeros."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from cmd_vel_guard.qos import EVERY, LATCHED, PROMPT
from cmd_vel_guard.sent import Ages
from turtlebot_gym_ros.node.safety import Safety

if TYPE_CHECKING:
    from turtlebot_gym_ros.node.shell import Shell

BLOCKED = 0.5
"""Longest time that a step may take, s."""
BLIND = "It sees no obstacles: watch the robot while it is enabled."
SEEING = "It sees only the obstacles that its LiDAR sees: watch the robot while it is enabled."


class Switch:
    """The service ``~/enable`` (SetBool), and the topics ``~/state`` and ``emergency_stop``.

    The state (String, latched) is "silent: why", "active" or "stopping: why". Each emergency-stop button (Bool) must publish at
    5 Hz or more, reliably, pressed or not. Any press, however short, stops the robot until it is enabled again; while a button
    is silent the robot stands: see `emergency`. Enabling is refused while any button is pressed, or one that was heard is
    silent.

    A step that takes longer than `BLOCKED` is a fault, but for lock-step, where time waits. Whoever enables the node is warned
    of obstacles, by whether it sees them.
    """

    def __init__(self, shell: Shell) -> None:
        node, common = shell.node, shell.common
        self.safety = Safety(enabled=common.start_enabled, blocked=math.inf if common.lock_step else BLOCKED)
        self._shell, self._now, self._log = shell, shell.now, node.get_logger()
        self._ages = Ages(shell.inputs.clock)
        self._told: str | None = None
        self._warning = f"enabled. {SEEING if shell.inputs.sees else BLIND}"
        self._state = node.create_publisher(String, "~/state", LATCHED)
        node.create_service(SetBool, "~/enable", self._serve)
        hear: Any = self._hear_emergency  # also takes the message's times, which rclpy supports but its types do not show
        promptly: Any = partial(hear, prompt=True)
        self._buttons = node.create_subscription(Bool, "emergency_stop", hear, EVERY, callback_group=shell.group)
        self._promptly = node.create_subscription(Bool, "emergency_stop", promptly, PROMPT, callback_group=shell.group)
        self._tell()

    def enable(self) -> str | None:
        """Let the block move the robot as soon as its inputs arrive, or return why not."""
        if refusal := self._shell.inputs.rivals():
            return refusal
        with self.safety.lock:
            if not self.safety.enabled:
                if refusal := self.safety.enable(now=self._now(), buttons=self._buttons.get_publisher_count()):
                    return refusal
                self._log.warning(self._warning)
            if self.safety.phase != "active":  # it may wait for inputs that a clock, set meanwhile, makes look old
                self._ages.begin()
                self._shell.restart()
            self._tell()
            return None

    def stop(self, reason: str, *, disable: bool = False) -> None:
        """Stop the robot until the next step or, if disabled, until it is enabled again."""
        self.safety.stop(reason, now=self._now(), disable=disable)
        self.watch()

    def watch(self) -> None:
        """Send a stop if one is due, and publish the state if it has changed."""
        self._shell.inputs.look()
        self.safety.count_buttons(self._buttons.get_publisher_count(), now=self._now())
        with self.safety.lock:  # so that nothing else is published between the decision and the zeros
            if self.safety.tick(now=self._now()):
                self._shell.outputs.publish(self._shell.outputs.stops())
            self._tell()

    def _tell(self) -> None:
        with self.safety.lock:
            state = self.safety.state
            if state != self._told:
                self._told = state
                self._state.publish(String(data=state))

    def _serve(self, request: Any, response: Any) -> Any:
        refusal = self.enable() if request.data else self.stop("not enabled", disable=True)
        response.success = refusal is None
        response.message = refusal or (self._warning if request.data else "disabled")
        return response

    def _hear_emergency(self, message: Bool, info: Mapping[str, Any], *, prompt: bool = False) -> None:
        age = self._ages.age_of(info, None, self._shell.inputs.look()).sent
        now, number = self._now(), info["publication_sequence_number"]
        self.safety.hear_emergency(message.data, now=now, sent=now - age, number=number, prompt=prompt)
        self.watch()

    @contextmanager
    def at_rest(self) -> Iterator[None]:
        """Stop the robot, and let no step move it within the context."""
        with self.safety.lock:
            self.stop("suspended")
            self._shell.outputs.flush()
            yield

    def close(self) -> None:
        """Stop the robot if it moves."""
        moved = self.safety.phase != "silent"
        self.safety.stop("the node ends", now=self._now(), disable=True)
        if moved:
            for _ in range(3):
                self._shell.outputs.publish(self._shell.outputs.stops())
                time.sleep(0.03)
        self._tell()
