"""An executor that is fast for the messages on which steps depend.

rclpy's executor collects all entities of all nodes each time it wakes, about fifty for a graph in one process, and wakes for
each message: most of a step would be spent on services that nobody calls. This executor waits separately for the few entities
that a step depends on, and serves all others every `OTHERS` seconds in the same thread.

Fast DDS waits until a time of the system clock (ros2/ros2 #1080): when that clock is set back, a wait lasts longer by as much,
unless a message ends it. So a thread that sleeps by the steady clock ends each wait that lasts longer than asked.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from threading import Thread
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from turtlebot_gym_ros.base.reports import note

MOST = 100
"""Most messages of a topic that are delivered in one turn."""
JOINING = 0.2
"""Longest time after which the first swift entity of an executor that runs already is found, s."""
OTHERS = 0.05
"""Longest time that services, timers and slow topics wait for their turn, s."""
OVERDUE = 0.02
"""Time after its end at which a wait is ended by the steady clock at the latest, s."""


class Swift(CallbackGroup):
    """Subscriptions and timers for which a `SwiftExecutor` waits separately; other executors ignore them."""

    def can_execute(self, entity: Any) -> bool:
        """Return whether rclpy's own loop may wait for an entity."""
        return False


class Unawaited(CallbackGroup):
    """Subscriptions for which no executor waits: whoever polls them takes what is `waiting`.

    rclpy checks every entity of a node each time it wakes; woken by each message, a recorder of 20 topics would take a tenth of
    a core. DDS keeps the messages meanwhile, each with its time of arrival.
    """

    def can_execute(self, entity: Any) -> bool:
        """Return whether rclpy's own loop may wait for an entity."""
        return False


def waiting(subscription: Any, most: int = MOST) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Take the messages that have arrived on a topic, with their info: at most so many, so that a flood cannot block others."""
    with subscription.handle:
        for _ in range(most):
            if (taken := subscription.handle.take_message(subscription.msg_type, subscription.raw)) is None:
                return
            yield taken


def take(subscription: Any, node: Node) -> None:
    """Deliver the messages that have arrived on a topic of a node; whatever one holds, it does not end the node."""
    with_info = subscription._callback_type is Subscription.CallbackType.WithMessageInfo
    for taken in waiting(subscription):
        try:
            subscription.callback(*taken if with_info else taken[:1])
        except Exception as error:
            note(node, subscription.topic_name, error)


class SwiftExecutor(SingleThreadedExecutor):
    """Runs all callbacks in the thread that calls `spin`, those of `Swift` groups without delay."""

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
        self._run(*self._next(timeout_sec))

    def spin(self) -> None:
        """Run until shutdown."""
        while self._context.ok() and not self._is_shutdown:
            subscriptions, timers = self._swift()
            if not subscriptions and not timers:
                self._run(*self._next(JOINING))
                continue
            self._run_swift(subscriptions, timers)
            self._run_others()

    def _swift(self) -> tuple[dict[Any, Node], list[Any]]:
        """Return the swift subscriptions of all nodes, with the nodes, and the swift timers."""
        nodes = self.get_nodes()
        subscriptions = {
            entity: node for node in nodes for entity in node.subscriptions if isinstance(entity.callback_group, Swift)
        }
        return subscriptions, [entity for node in nodes for entity in node.timers if isinstance(entity.callback_group, Swift)]

    def _run_swift(self, subscriptions: Mapping[Any, Node], timers: list[Any]) -> None:
        """Run swift entities until the others are due."""
        until = time.monotonic() + OTHERS
        handle, guard = self._context.handle, self._guard
        assert handle is not None
        if guard is None:  # it is being shut down
            return
        with ExitStack() as held:
            try:  # so that no other thread destroys an entity during the wait, which would end the process
                for entity_handle in (handle, *(entity.handle for entity in (guard, *subscriptions, *timers))):
                    held.enter_context(entity_handle)
            except _rclpy.InvalidHandle:
                return
            waits = _rclpy.WaitSet(len(subscriptions), 1, len(timers), 0, 0, 0, handle)
            while (left := until - time.monotonic()) > 0.0 and not self._is_shutdown:
                waits.clear_entities()
                for entity in subscriptions:
                    waits.add_subscription(entity.handle)
                for entity in timers:
                    waits.add_timer(entity.handle)
                waits.add_guard_condition(guard.handle)
                self._ends = until
                waits.wait(int(left * 1e9))
                self._ends = math.inf
                ready = set(waits.get_ready_entities("subscription"))
                for entity in subscriptions:
                    if entity.handle.pointer in ready:
                        take(entity, subscriptions[entity])
                for entity in timers:
                    if entity.handle.is_timer_ready():
                        entity.handle.call_timer()
                        entity.callback()

    def _run_others(self) -> None:
        """Run the other entities that are ready, at most for as long as the swift ones ran."""
        until = time.monotonic() + OTHERS
        try:
            while not self._is_shutdown and time.monotonic() < until:
                self._run(*(found := self._next(0.0)))
                if not found:
                    return
        except ExternalShutdownException:
            pass

    def _next(self, timeout: float | None) -> tuple[Any, ...]:
        """Return the handler of the next of the other entities that is ready, the entity and its node; () if there is none.

        An entity that another thread destroys during the wait is not ready. In rclpy some kinds of entities then raise, which
        would end this thread, and with it the node.
        """
        self._ends = math.inf if timeout is None else time.monotonic() + timeout
        try:
            return self.wait_for_ready_callbacks(timeout_sec=timeout)
        except (TimeoutException, ShutdownException, _rclpy.InvalidHandle):
            return ()
        finally:
            self._ends = math.inf

    @staticmethod
    def _run(handler: Any = None, entity: Any = None, node: Any = None) -> None:
        """Run a callback, and raise what a timer's raised; what comes from outside ends no node."""
        if handler is None:
            return
        handler()
        if isinstance(error := handler.exception(), Exception) and node is not None and not isinstance(entity, Timer):
            note(node, getattr(entity, "topic_name", type(entity).__name__), error)
        elif error is not None:
            raise error
