"""An executor that is fast for the messages on which steps depend, and the only module that uses private names of rclpy.

rclpy's executor collects all entities of all nodes each time it wakes, about fifty for a graph in one process, and wakes for
each message: most of a step would be spent on services that nobody calls. `FastExecutor` waits separately for the few entities
that a step depends on, and serves all others every `OTHERS` seconds in the same thread. In other executors these entities
belong to their node's default group, so nodes work there, too, only slower.

Fast DDS waits until a time of the system clock (ros2/ros2 #1080): when that clock is set back, a wait lasts longer by as much,
unless a message ends it. So a thread that sleeps by the steady clock ends each wait that lasts longer than asked.

Where rclpy lacks the private names, `PRIVATE` is false: `best_executor` is then rclpy's own, and all topics are waited for.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from threading import Thread
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.context import Context
from rclpy.executors import Executor, ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from turtlebot_gym_ros.base.reports import note

try:
    from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
except ImportError:
    _rclpy: Any = None
_NAMES = (
    (_rclpy, ("WaitSet", "InvalidHandle", "Subscription")),
    (getattr(_rclpy, "Subscription", None), ("take_message",)),
    (Subscription, ("CallbackType",)),
)
PRIVATE = all(hasattr(owner, name) for owner, names in _NAMES for name in names)
"""Whether rclpy has the private names that this module uses."""
MOST = 100
"""Most messages of a topic that are delivered in one turn."""
JOINING = 0.2
"""Longest time after which the first fast entity of an executor that runs already is found, s."""
OTHERS = 0.05
"""Longest time that services, timers and slow topics wait for their turn, s."""
OVERDUE = 0.02
"""Time after its end at which a wait is ended by the steady clock at the latest, s."""


class FastGroup(MutuallyExclusiveCallbackGroup):
    """Subscriptions and timers for which a `FastExecutor` waits separately; other executors run them like the node's others.

    Args:
        node: Their node, of whose default group at most one callback runs at a time, theirs included.
    """

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._all = node.default_callback_group

    def add_entity(self, entity: Any) -> None:
        """Add an entity to this group, and to the node's default group."""
        super().add_entity(entity)
        self._all.add_entity(entity)

    def can_execute(self, entity: Any) -> bool:
        """Return whether no callback of the node runs."""
        return self._all.can_execute(entity)

    def beginning_execution(self, entity: Any) -> bool:
        """Take the node's turn, and return whether it was free."""
        return self._all.beginning_execution(entity)

    def ending_execution(self, entity: Any) -> None:
        """Give the node's turn back."""
        self._all.ending_execution(entity)


class PolledGroup(FastGroup):
    """Subscriptions for which no executor waits: whoever polls them takes what is `waiting`.

    rclpy checks every entity of a node each time it wakes; woken by each message, a recorder of 20 topics would take a tenth of
    a core. DDS keeps the messages meanwhile, each with its time of arrival.
    """

    def can_execute(self, entity: Any) -> bool:
        """Return whether an executor must wait for an entity, since it cannot be polled."""
        return not PRIVATE and super().can_execute(entity)


def waiting(subscription: Any, most: int = MOST) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Take the messages that have arrived on a topic, with their info: at most so many, so that a flood cannot block others."""
    if not PRIVATE:
        return
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


class FastExecutor(SingleThreadedExecutor):
    """Runs all callbacks in the thread that calls `spin`, those of a `FastGroup` without delay."""

    def __init__(self, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        self._ends = math.inf  # steady time at which the current wait should end
        Thread(target=self._end_waits, name="steady", daemon=True).start()

    def can_execute(self, entity: Any) -> bool:
        """Return whether rclpy's own loop may wait for an entity."""
        return not isinstance(entity.callback_group, FastGroup) and super().can_execute(entity)

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
            subscriptions, timers = self._fast()
            if not subscriptions and not timers:
                self._run(*self._next(JOINING))
                continue
            self._run_fast(subscriptions, timers)
            self._run_others()

    def _fast(self) -> tuple[dict[Any, Node], list[Any]]:
        """Return the fast subscriptions of all nodes, with the nodes, and the fast timers."""
        nodes = self.get_nodes()
        subscriptions = {entity: node for node in nodes for entity in node.subscriptions if _is_fast(entity)}
        return subscriptions, [entity for node in nodes for entity in node.timers if _is_fast(entity)]

    def _run_fast(self, subscriptions: Mapping[Any, Node], timers: list[Any]) -> None:
        """Run fast entities until the others are due."""
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
        """Run the other entities that are ready, at most for as long as the fast ones ran."""
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


def _is_fast(entity: Any) -> bool:
    """Return whether a `FastExecutor` waits separately for an entity."""
    return isinstance(entity.callback_group, FastGroup) and not isinstance(entity.callback_group, PolledGroup)


def best_executor() -> type[Executor]:
    """Return the executor in which nodes run: `FastExecutor` where rclpy has what it needs, otherwise rclpy's own."""
    return FastExecutor if PRIVATE else SingleThreadedExecutor
