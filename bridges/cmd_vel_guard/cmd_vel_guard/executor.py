"""An executor that waits by the steady clock, and messages that are polled; both use private names of rclpy.

Fast DDS waits until a time of the system clock (ros2/ros2 #1080): when that clock is set back, a wait lasts longer by as much,
unless a message ends it. So a thread that sleeps by the steady clock ends each wait that lasts longer than asked.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from threading import Thread
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.timer import Timer

from cmd_vel_guard.reports import note

OVERDUE = 0.02
"""Time after its end at which a wait is ended by the steady clock at the latest, s."""


class PolledGroup(CallbackGroup):
    """Subscriptions for which no executor waits: whoever polls them takes what is `waiting`.

    rclpy checks every entity of a node each time it wakes; woken by each message, a recorder of 20 topics would take a tenth of
    a core. DDS keeps the messages meanwhile, each with its time of arrival.
    """

    def can_execute(self, entity: Any) -> bool:
        """Return whether an executor may wait for an entity."""
        return False


def waiting(subscription: Any, most: int) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Take the messages that have arrived on a topic, with their info: at most so many, so that a flood cannot block others."""
    with subscription.handle:
        for _ in range(most):
            if (taken := subscription.handle.take_message(subscription.msg_type, subscription.raw)) is None:
                return
            yield taken


class SteadyExecutor(SingleThreadedExecutor):
    """Runs all callbacks in the thread that calls `spin_once`, and waits by the steady clock."""

    def __init__(self, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        self._ends = math.inf  # steady time at which the current wait should end
        Thread(target=self._end_waits, name="steady", daemon=True).start()

    def _end_waits(self) -> None:
        """End waits that are overdue. Of Python's waits, only a sleep is by the steady clock in all versions."""
        while not self._is_shutdown:
            time.sleep(OVERDUE)
            if time.monotonic() > self._ends:
                with suppress(_rclpy.InvalidHandle, AttributeError):  # it is being shut down
                    self.wake()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Run the callback that is ready next, and wait for it at most so long, s."""
        self.run_next(timeout_sec)

    def run_next(self, timeout_sec: float | None) -> bool:
        """Do the same, and return whether there was one. Only what a timer's callback raises is raised."""
        self._ends = math.inf if timeout_sec is None else time.monotonic() + timeout_sec
        try:
            handler, entity, node = self.wait_for_ready_callbacks(timeout_sec=timeout_sec)
        except (TimeoutException, ShutdownException, _rclpy.InvalidHandle):  # the last one: an entity is being destroyed
            return False
        finally:
            self._ends = math.inf
        handler()
        if isinstance(error := handler.exception(), Exception) and node is not None and not isinstance(entity, Timer):
            note(node, getattr(entity, "topic_name", type(entity).__name__), error)
        elif error is not None:
            raise error
        return True
