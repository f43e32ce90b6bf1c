"""The ROS clock as a node lives by it: where it is simulated, it may be missing, stand still, or leap."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node

SILENCE = 0.5
"""A simulated clock that stands still for longer stops the robot, s."""
JUMP = 5.0
"""A clock that leaps ahead by more, or back at all, resets the block and stops the robot, s."""


class RosClock:
    """Watches the ROS clock by the steady one.

    Args:
        node: The node.
        ignore: Whether the node does not live by it, because it sets it itself.
        jumped: Called when it has leapt, in the executor's thread.
        now: The present by the steady clock, s.
    """

    def __init__(self, node: Node, *, ignore: bool, jumped: Callable[[], None], now: float) -> None:
        self._clock = node.get_clock()
        self._simulated = bool(node.get_parameter("use_sim_time").value) and not ignore
        self._at, self._moved = 0, now

        def leap(jump: Any) -> None:
            if not ignore:
                jumped()

        threshold = JumpThreshold(min_forward=Duration(seconds=JUMP), min_backward=Duration(nanoseconds=-1))
        self._jumps = self._clock.create_jump_callback(threshold, post_callback=leap)

    def trouble(self, now: float) -> str | None:
        """Return why a step cannot rely on the time, if it cannot.

        Args:
            now: The present by the steady clock, s.
        """
        if not self._simulated:
            return None
        at = self._clock.now().nanoseconds
        if at != self._at:
            self._at, self._moved = at, now
        if not at:
            return "waits for /clock"
        return "/clock stands still" if now - self._moved > SILENCE else None

    def close(self) -> None:
        """Stop watching."""
        self._jumps.unregister()
