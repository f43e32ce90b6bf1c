"""What runs a block: the clock, the messages of an input, or the steps of lock-step.

The rules are in `triggers` and `lockstep`. A drive is told of each value that has come (`Drive.heard`), and calls the node's
``step`` when it is time for one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage

from turtlebot_gym_ros.node.block import Block, Every, On
from turtlebot_gym_ros.node.chain import Chain
from turtlebot_gym_ros.node.feed import Feed
from turtlebot_gym_ros.node.lockstep import RESEND, Answers, Plant, Turn, trigger_of
from turtlebot_gym_ros.node.outputs import Outputs
from turtlebot_gym_ros.node.qos import STREAM
from turtlebot_gym_ros.node.swift import Swift
from turtlebot_gym_ros.node.triggers import Grid, Messages, SimulatedGrid


@dataclass(frozen=True, kw_only=True)
class Hands:
    """What a drive may do with its node."""

    node: Node
    feeds: Mapping[str, Feed]
    outputs: Outputs
    now: Callable[[], float]
    """The steady clock, s."""
    step: Callable[[int], bool]
    """Runs the block once, at a stamp in ns, and publishes what comes of it; returns whether it did."""
    begin: Callable[[], None]
    """Resets the block and this drive."""
    may_move: Callable[[], bool]
    """Returns whether what was answered may be answered again."""


class Drive(Protocol):
    """What the shell asks of whatever runs its block."""

    @property
    def sets_clock(self) -> bool:
        """Whether it sets ``/clock``, and does not live by it."""
        ...

    @property
    def period(self) -> float:
        """Time that a step may take, s; 0 where it does not matter."""
        ...

    def present(self) -> int:
        """Return the present of the clock that the block runs by, ns."""
        ...

    def takes(self, key: str, stamp: int) -> bool:
        """Return whether a value of a stamp counts, or refuse by a `ValueError` a stamp that cannot be."""
        ...

    def heard(self, key: str, stamp: int) -> None:
        """Take note of a value that has come, and run the block if that makes a step."""
        ...

    def missing(self) -> str | None:
        """Return what keeps it from making steps, beside its inputs."""
        ...

    def trouble(self) -> str | None:
        """Return what a person should know of."""
        ...

    def interval(self, stamp: int) -> float:
        """Return the time since the last step, s."""
        ...

    def pause(self) -> None:
        """Note that a step was left out."""
        ...

    def reset(self) -> None:
        """Let the next step be the first."""
        ...

    def new_episode(self) -> None:
        """Note that the plant was reset."""
        ...


class Running:
    """What all drives have in common."""

    sets_clock = False
    period = 0.0

    def __init__(self, hands: Hands) -> None:
        self._hands = hands

    def present(self) -> int:
        """Return the present of the ROS clock, ns."""
        return self._hands.node.get_clock().now().nanoseconds

    def takes(self, key: str, stamp: int) -> bool:
        """Take any stamp."""
        return True

    def heard(self, key: str, stamp: int) -> None:
        """Wait for something else."""

    def missing(self) -> str | None:
        """Return nothing."""
        return None

    def trouble(self) -> str | None:
        """Return nothing."""
        return None

    def pause(self) -> None:
        """Take no note."""

    def new_episode(self) -> None:
        """Take no note."""


class ByClock(Running):
    """Steps on a grid of the ROS clock, or of a simulated time that it sets itself."""

    def __init__(self, hands: Hands, trigger: Every) -> None:
        super().__init__(hands)
        if trigger.speed == 0.0:
            raise ValueError("speed must be positive, unless lock_step is true: 0 is as fast as the nodes answer.")
        self.sets_clock = trigger.speed not in (None, 1.0)
        self.period = trigger.period
        self._grid = (SimulatedGrid if self.sets_clock else Grid)(trigger)
        self._watch = Clock(clock_type=ClockType.STEADY_TIME) if self.sets_clock else hands.node.get_clock()
        self._clock = hands.node.create_publisher(ClockMessage, "/clock", STREAM) if self.sets_clock else None
        hands.node.create_timer(trigger.period / (trigger.speed or 1.0), self._tick, clock=self._watch)
        self.interval, self.reset = self._grid.interval, self._grid.reset

    def present(self) -> int:
        """Return the present of the grid's time, ns."""
        return self._grid.present if isinstance(self._grid, SimulatedGrid) else super().present()

    def missing(self) -> str | None:
        """Return whose ear is missing: a schedule would run on while its listeners are still to be found."""
        return self._hands.outputs.unheard()

    def _tick(self) -> None:
        for stamp in self._grid.due_until(self._watch.now().nanoseconds):
            if self._clock:
                self._clock.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))
            self._hands.step(stamp)


class ByMessages(Running):
    """Steps on the messages of an input."""

    def __init__(self, hands: Hands, trigger: On) -> None:
        super().__init__(hands)
        self._rule = rule = Messages(trigger)
        self.period = trigger.period
        self.interval, self.pause, self.reset = rule.interval, rule.pause, rule.reset

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


class ByAnswers(Running):
    """Answers the steps of lock-step."""

    def __init__(self, hands: Hands, rule: Answers) -> None:
        super().__init__(hands)
        self._rule = rule
        self.interval, self.reset = rule.messages.interval, rule.reset

    def present(self) -> int:
        """Return 0: what answers no step, such as a stop, has no time."""
        return 0

    def takes(self, key: str, stamp: int) -> bool:
        """Refuse the stamps of a robot."""
        self._rule.check(key, stamp)
        return True

    def heard(self, key: str, stamp: int) -> None:
        """Answer the step if it is complete, or once more."""
        hands, rule = self._hands, self._rule
        turn, gap = rule.hear(key, {name: feed.stamp for name, feed in hands.feeds.items()})
        if gap:
            hands.node.get_logger().info(f"{gap}: a new episode.")
            hands.begin()
            turn, _ = rule.hear(key, {name: feed.stamp for name, feed in hands.feeds.items()})
        if turn is Turn.REPEAT and hands.may_move():
            hands.outputs.publish_again()
        if turn is Turn.HOLD and hands.outputs.moving and hands.may_move():
            hands.outputs.publish_again(stamp)  # the plant waits for a command in every step
        if turn is Turn.HOLD or (turn is Turn.STEP and hands.step(stamp)):
            rule.answer(stamp)

    def missing(self) -> str | None:
        """Return that steps come too slowly for the block."""
        return self._rule.messages.slow

    def trouble(self) -> str | None:
        """Return the same."""
        return self._rule.messages.slow


class AsPlant(Running):
    """Takes the steps of lock-step, each when the one before has been answered, and says who does not answer."""

    sets_clock = True

    def __init__(self, hands: Hands, trigger: Every, block: Block) -> None:
        super().__init__(hands)
        self._rule = Plant(trigger, now=hands.now())
        self._answers = {key: hands.feeds[key] for key, each in block.inputs.items() if each.lock_step == "same"}
        if not self._answers:
            raise ValueError("lock_step must be false for a plant that no input answers.")
        self._chain = Chain(hands.node, trigger.through, list(self._answers.values()))
        self._started = False
        self._clock = hands.node.create_publisher(ClockMessage, "/clock", STREAM)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        hands.node.create_timer(0.5 * RESEND, self._tick, clock=steady)
        self._later = hands.node.create_timer(1.0, self._go_on, clock=steady, callback_group=Swift())
        self._later.cancel()

    def present(self) -> int:
        """Return the stamp of the step that is to be answered, ns."""
        return self._rule.present

    def takes(self, key: str, stamp: int) -> bool:
        """Take one answer to the present step, the first; a stop, or what answered another step, is left aside."""
        feed = self._answers.get(key)
        return feed is None or stamp == self._rule.present != feed.stamp

    def heard(self, key: str, stamp: int) -> None:
        """Take the next step if this one has been answered."""
        if self._started and self._rule.answers(feed.stamp for feed in self._answers.values()):
            self._go_on()

    def _go_on(self) -> None:
        """Take the next step, or set the timer for it."""
        self._later.cancel()
        now = self._hands.now()
        wait = self._rule.wait(now)
        if wait > 0.0:
            self._later.timer_period_ns = round(wait * 1e9)
            self._later.reset()
            return
        self._started = True
        stamp = self._rule.advance(now)
        self._clock.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))
        self._hands.step(stamp)

    def _tick(self) -> None:
        """Take the first step, or see to a step that is not answered."""
        now = self._hands.now()
        if not self._started:
            self._go_on()
        elif self._rule.resend(now) and self._later.is_canceled():
            self._hands.outputs.publish_again()
        self._chain.watch(self._rule.present if self._rule.is_overdue(now) else None)

    def trouble(self) -> str | None:
        """Return who has not answered for long."""
        return self._chain.missing

    def interval(self, stamp: int) -> float:
        """Return the period, s."""
        return self._rule.period

    def reset(self) -> None:
        """Go on with the steps: the stamps never go back."""

    def new_episode(self) -> None:
        """Take the first step of an episode now, whether the one before was answered or not."""
        self._rule.begin_episode()
        self._go_on()


def make_drive(hands: Hands, block: Block, *, lock_step: bool) -> Drive:
    """Return what runs a block.

    Args:
        hands: What it may do with the node.
        block: The block.
        lock_step: Whether time is simulated and waits for the answer.

    Raises:
        ValueError: If the block cannot run so.
    """
    trigger = block.trigger
    if not lock_step:
        return ByClock(hands, trigger) if isinstance(trigger, Every) else ByMessages(hands, trigger)
    answers = trigger_of(trigger, block.inputs)
    if answers is not None:
        return ByAnswers(hands, Answers(answers, block.inputs))
    assert isinstance(trigger, Every)
    return AsPlant(hands, trigger, block)
