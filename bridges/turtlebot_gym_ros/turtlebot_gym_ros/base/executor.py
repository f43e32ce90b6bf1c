"""An executor that is fast for the messages on which steps depend; like that of the guard, it uses private names of rclpy.

For each message rclpy's executor collects all entities, about fifty for a graph in one process: a step of lock-step takes twice
the CPU. Its EventsExecutor does not work in this release. `FastExecutor` waits apart for the few that a step depends on,
and serves all others every `OTHERS` seconds in the same thread; in other executors nodes work, too, only slower.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription

from cmd_vel_guard.executor import SteadyExecutor, waiting
from cmd_vel_guard.reports import note

MOST = 100
"""Most messages of a topic that are delivered in one turn."""
JOINING = 0.2
"""Longest time after which the first fast entity of an executor that runs already is found, s."""
OTHERS = 0.05
"""Longest time that services, timers and slow topics wait for their turn, s."""


class FastGroup(MutuallyExclusiveCallbackGroup):
    """Subscriptions and timers for which a `FastExecutor` waits separately; other executors run them like the node's others.

    Of the node's default group at most one callback runs at a time, theirs included.
    """

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._all: Any = node.default_callback_group
        self.can_execute, self.beginning_execution = self._all.can_execute, self._all.beginning_execution
        self.ending_execution = self._all.ending_execution

    def add_entity(self, entity: Any) -> None:
        """Add an entity to this group, and to the node's default group, whose turns count."""
        super().add_entity(entity)
        self._all.add_entity(entity)


def take(subscription: Any, node: Node) -> None:
    """Deliver the messages that have arrived on a topic of a node; whatever one holds, it does not end the node."""
    with_info = subscription._callback_type is Subscription.CallbackType.WithMessageInfo
    for taken in waiting(subscription, MOST):
        try:
            subscription.callback(*taken if with_info else taken[:1])
        except Exception as error:
            note(node, subscription.topic_name, error)


class FastExecutor(SteadyExecutor):
    """Runs all callbacks in the thread that calls `spin`, those of a `FastGroup` without delay."""

    def can_execute(self, entity: Any) -> bool:
        """Return whether rclpy's own loop may wait for an entity."""
        return not _is_fast(entity) and super().can_execute(entity)

    def spin(self) -> None:
        """Run until shutdown."""
        while self._context.ok() and not self._is_shutdown:
            nodes = self.get_nodes()
            subscriptions = {entity: node for node in nodes for entity in node.subscriptions if _is_fast(entity)}
            timers = [entity for node in nodes for entity in node.timers if _is_fast(entity)]
            if not subscriptions and not timers:
                self.run_next(JOINING)
                continue
            self._run_fast(subscriptions, timers)
            until = time.monotonic() + OTHERS
            with suppress(ExternalShutdownException):
                while not self._is_shutdown and time.monotonic() < until and self.run_next(0.0):
                    pass

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


def _is_fast(entity: Any) -> bool:
    return isinstance(entity.callback_group, FastGroup)
