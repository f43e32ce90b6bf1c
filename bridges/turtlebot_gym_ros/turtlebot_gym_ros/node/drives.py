"""What runs a block in real time: the clock, or the messages of an input. In lock-step: `answering`.

The rules are in `triggers`. A drive is told of each value that has come (`Drive.heard`), and calls the node's
``step`` when it is time for one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage

from turtlebot_gym_ros.node.block import Every, On
from turtlebot_gym_ros.node.feed import Feed
from turtlebot_gym_ros.node.outputs import Outputs
from turtlebot_gym_ros.node.qos import STREAM
from turtlebot_gym_ros.node.triggers import Grid, Messages, SimulatedGrid

QUIET = 0.3
"""Time without steps after a reset of a plant that does not run in lock-step, s, by the steady clock."""


@dataclass(frozen=True, kw_only=True)
class Hands:
    """What a drive may do with its node."""

    node: Node
    feeds: Mapping[str, Feed]
    outputs: Outputs
    now: Callable[[], float]
    """The steady clock, s."""
    step: Callable[[int], bool]
    """Runs the block once at a stamp, ns, and publishes the result; returns whether it did."""
    begin: Callable[[], None]
    """Resets the block and this drive."""
    may_move: Callable[[], bool]
    """Returns whether what was answered may be answered again."""


class Drive(Protocol):
    """What the shell asks of whatever runs its block. Who subclasses it overrides what differs."""

    _hands: Hands
    sets_clock: bool = False
    """Whether it sets ``clock``, and does not live by it."""
    period: float = 0.0
    """Time that a step may take, s; 0 where it does not matter."""

    def present(self) -> int:
        """Return the present of the clock that the block runs by, ns: the ROS clock's."""
        return self._hands.node.get_clock().now().nanoseconds

    def takes(self, key: str, stamp: int) -> bool:
        """Return whether a value of a stamp counts, or refuse by a `ValueError` a stamp that cannot be."""
        return True

    def heard(self, key: str, stamp: int) -> None:
        """Take note of a value that has come, and run the block if that makes a step."""

    def missing(self) -> str | None:
        """Return what keeps it from making steps, beside its inputs."""
        return None

    def trouble(self) -> str | None:
        """Return what a person should know of."""
        return None

    def interval(self, stamp: int) -> float:
        """Return the time since the last step, s."""
        ...

    def pause(self) -> None:
        """Note that a step was left out."""

    def reset(self) -> None:
        """Let the next step be the first."""

    def new_episode(self) -> None:
        """Note that the plant was reset."""


class ByClock(Drive):
    """Steps on a grid of the ROS clock, or of a simulated time that it sets itself."""

    def __init__(self, hands: Hands, trigger: Every) -> None:
        self._hands = hands
        if trigger.speed == 0.0:
            raise ValueError("speed must be positive, unless lock_step is true: 0 is as fast as the nodes answer.")
        self._quiet_until = -math.inf
        self.sets_clock = trigger.speed not in (None, 1.0)
        self.period = trigger.period
        self._grid = (SimulatedGrid if self.sets_clock else Grid)(trigger)
        self._watch = Clock(clock_type=ClockType.STEADY_TIME) if self.sets_clock else hands.node.get_clock()
        self._clock = hands.node.create_publisher(ClockMessage, "clock", STREAM) if self.sets_clock else None
        hands.node.create_timer(trigger.period / (trigger.speed or 1.0), self._tick, clock=self._watch)

    def present(self) -> int:
        """Return the present of the grid's time, ns."""
        return self._grid.present if isinstance(self._grid, SimulatedGrid) else super().present()

    def interval(self, stamp: int) -> float:
        """Return the period, s."""
        return self._grid.interval(stamp)

    def missing(self) -> str | None:
        """Return whose ear is missing: a schedule would run on while its listeners are still to be found."""
        return self._hands.outputs.unheard()

    def _tick(self) -> None:
        for stamp in self._grid.due_until(self._watch.now().nanoseconds):
            if self._clock:
                self._clock.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))
            if self._hands.now() >= self._quiet_until:
                self._hands.step(stamp)

    def new_episode(self) -> None:
        """Be quiet until all have heard of the reset: a filter that hears of it late would begin with a later step."""
        self._quiet_until = self._hands.now() + QUIET


class ByMessages(Drive):
    """Steps on the messages of an input."""

    def __init__(self, hands: Hands, trigger: On) -> None:
        self._hands = hands
        self._rule = Messages(trigger)
        self.period = trigger.period

    def takes(self, key: str, stamp: int) -> bool:
        """Refuse what comes twice or late."""
        if key == self._rule.input:
            self._rule.check(stamp)
        return True

    def heard(self, key: str, stamp: int) -> None:
        """Step, if the message is due."""
        if key != self._rule.input:
            return
        due, gap = self._rule.due(stamp)
        if gap:
            self._hands.node.get_logger().warning(f"{self._hands.feeds[key].topic}: {gap}; starting again from this message.")
            self._hands.begin()
        if due:
            self._hands.step(stamp)

    def missing(self) -> str | None:
        """Return that messages come too slowly."""
        return self._rule.slow

    def trouble(self) -> str | None:
        """Return the same."""
        return self._rule.slow

    def interval(self, stamp: int) -> float:
        """Return the time between the stamps, s."""
        return self._rule.interval(stamp)

    def pause(self) -> None:
        """Let the next step be like the first."""
        self._rule.pause()

    def reset(self) -> None:
        """Let the next message be the first."""
        self._rule.reset()
