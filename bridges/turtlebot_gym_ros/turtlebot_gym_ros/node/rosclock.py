"""Watch over the ROS clock: a simulated one may be missing, stand still or leap."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node

SILENCE = 0.5
"""Time after which a simulated clock that stands still stops the robot, s."""
JUMP = 5.0
"""Leap ahead above which the block is reset and the robot stops, s; so it is for any leap back."""


class RosClock:
    """Watches the ROS clock by the steady one.

    Args:
        node: The node.
        ignore: Whether the node does not follow the clock, because it publishes it.
        jumped: Called after a leap, in the executor's thread.
        now: Current time of the steady clock, s.
    """

    def __init__(self, node: Node, *, ignore: bool, jumped: Callable[[], None], now: float) -> None:
        self._clock, self._ignore = node.get_clock(), ignore
        self._at, self._moved = 0, now

        def leap(jump: Any) -> None:
            if not ignore:
                jumped()

        threshold = JumpThreshold(min_forward=Duration(seconds=JUMP), min_backward=Duration(nanoseconds=-1))
        self._jumps = self._clock.create_jump_callback(threshold, post_callback=leap)

    def trouble(self, now: float) -> str | None:
        """Return why a step cannot rely on the time, if so.

        Args:
            now: Current time of the steady clock, s.
        """
        if self._ignore or not self._clock.ros_time_is_active:  # pyright: ignore[reportAttributeAccessIssue]  # use_sim_time may be set while the node runs
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
