"""The switch of a node that moves a robot: `Safety` with its services, its topics and its zeros."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from turtlebot_gym_ros.node.outputs import Outputs
from turtlebot_gym_ros.node.qos import LATCHED, SENSOR
from turtlebot_gym_ros.node.safety import Safety

NO_OBSTACLE_AVOIDANCE = "It drives without obstacle avoidance: whoever enables it watches the robot."


class Switch:
    """The service ``~/enable`` (SetBool), and the topics ``~/state`` and ``emergency_stop``.

    The state (String, latched) is "silent: why", "active" or "stopping: why". An emergency stop (Bool) is to be published at
    5 Hz or more, pressed or not: once heard, half a second of silence stops the robot as well.

    Args:
        node: The node.
        outputs: Its outputs.
        enabled: Whether it starts enabled.
        now: The steady clock, s.
        restart: Called when it is enabled: the block begins anew.
        blocked: A step that takes longer is a fault, s; infinite where time waits for it, None for the usual limit.
    """

    def __init__(
        self,
        node: Node,
        outputs: Outputs,
        *,
        enabled: bool,
        now: Callable[[], float],
        restart: Callable[[], None],
        blocked: float | None = None,
    ) -> None:
        self.safety = Safety(enabled=enabled) if blocked is None else Safety(enabled=enabled, blocked=blocked)
        self._outputs, self._now, self._restart, self._log = outputs, now, restart, node.get_logger()
        self._told: str | None = None
        self._state = node.create_publisher(String, "~/state", LATCHED)
        node.create_service(SetBool, "~/enable", self._serve)
        node.create_subscription(Bool, "emergency_stop", self._hear_emergency, SENSOR)
        self._tell()

    def enable(self) -> str | None:
        """Let the block move the robot, as soon as its inputs are there; or return why not."""
        if not self.safety.enabled:
            refusal = self.safety.enable(now=self._now())
            if refusal:
                return refusal
            self._restart()
            self._log.warning(f"enabled. {NO_OBSTACLE_AVOIDANCE}")
        self._tell()
        return None

    def disable(self) -> None:
        """Stop the robot, and leave it to others a second later."""
        self.stop("not enabled", disable=True)

    def stop(self, reason: str, *, disable: bool = False) -> None:
        """Stop the robot until the next step or, where disabled, until it is enabled again."""
        self.safety.stop(reason, now=self._now(), disable=disable)
        self.watch()

    def watch(self) -> None:
        """Send a stop if one is due, and tell the state if it has changed."""
        with self.safety.lock:  # so that nothing else is published between the decision and the zeros
            if self.safety.tick(now=self._now()):
                self._outputs.publish_stops()
            self._tell()

    def _tell(self) -> None:
        with self.safety.lock:
            state = self.safety.state
            if state != self._told:
                self._told = state
                self._state.publish(String(data=state))

    def _serve(self, request: Any, response: Any) -> Any:
        refusal = self.enable() if request.data else self.disable()
        response.success = refusal is None
        response.message = refusal or (f"enabled. {NO_OBSTACLE_AVOIDANCE}" if request.data else "disabled")
        return response

    def _hear_emergency(self, message: Bool) -> None:
        self.safety.hear_emergency(message.data, now=self._now())
        self.watch()

    def close(self) -> None:
        """Stop the robot if it moves."""
        moved = self.safety.phase != "silent"
        self.safety.stop("the node ends", now=self._now(), disable=True)
        for _ in range(3 if moved else 0):
            self._outputs.publish_stops()
            time.sleep(0.03)
        self._tell()
