"""Run a block in lock-step: by the steps of the plant, which the other nodes answer. The rules are in `lockstep`."""

from __future__ import annotations

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Header

from turtlebot_gym_ros.node.block import Block, Every
from turtlebot_gym_ros.node.chain import Chain
from turtlebot_gym_ros.node.drives import ByClock, ByMessages, Drive, Hands
from turtlebot_gym_ros.node.lockstep import RESEND, Answers, Plant, Turn, trigger_of
from turtlebot_gym_ros.node.qos import LOCK_STEP, STREAM
from turtlebot_gym_ros.node.swift import Swift


class ByAnswers(Drive):
    """Drives a block that answers the steps of lock-step."""

    def __init__(self, hands: Hands, rule: Answers) -> None:
        self._hands = hands
        self._rule = rule

    def present(self) -> int:
        """Return 0: a message that answers no step, such as a stop, has no time."""
        return 0

    def takes(self, key: str, stamp: int) -> bool:
        """Refuse stamps of a real robot."""
        self._rule.check(key, stamp)
        return True

    def heard(self, key: str, stamp: int) -> None:
        """Answer the step if its inputs are complete, or repeat the answer."""
        hands, rule = self._hands, self._rule
        steps = {name: feed.step for name, feed in hands.feeds.items()}
        turn, gap = rule.hear(key, steps)
        if gap:
            hands.node.get_logger().info(f"{gap}: a new episode.")
            hands.begin()
            turn, _ = rule.hear(key, steps)
        stamp = steps[rule.messages.input] or 0
        if turn is Turn.REPEAT and hands.may_move():
            hands.outputs.publish_again()
        if turn is Turn.HOLD and hands.outputs.moving and hands.may_move():
            hands.outputs.publish_again(stamp)  # the plant waits for a command in every step
        if turn is Turn.HOLD or (turn is Turn.STEP and hands.step(stamp)):
            rule.answer(stamp)

    def missing(self) -> str | None:
        """Return that steps are too slow for the block."""
        return self._rule.messages.slow

    def trouble(self) -> str | None:
        """Return the same as `missing`."""
        return self._rule.messages.slow

    def interval(self, stamp: int) -> float:
        """Return the time between the stamps, s."""
        return self._rule.messages.interval(stamp)

    def reset(self) -> None:
        """Answer the current step again, as the first."""
        self._rule.reset()


class AsPlant(Drive):
    """Drives the plant: takes each step when the previous one has been answered, and reports nodes that do not answer."""

    sets_clock = True

    def __init__(self, hands: Hands, trigger: Every, block: Block) -> None:
        self._hands = hands
        self._rule = Plant(trigger, now=hands.now())
        self._answers = {key: hands.feeds[key] for key, each in block.inputs.items() if each.lock_step == "same"}
        if not self._answers:
            raise ValueError("lock_step must be false for a plant without an input that answers it.")
        self._chain = Chain(hands.node, trigger.through, list(self._answers.values()))
        self._started = False
        self._clock = hands.node.create_publisher(ClockMessage, "clock", STREAM)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        hands.node.create_timer(0.5 * RESEND, self._tick, clock=steady)
        self._later = hands.node.create_timer(1.0, self._go_on, clock=steady, callback_group=Swift())
        self._later.cancel()
        if trigger.witness:
            hands.node.create_subscription(Header, trigger.witness, self._witness, LOCK_STEP, callback_group=Swift())

    def present(self) -> int:
        """Return the stamp of the step that awaits its answer, ns."""
        return self._rule.present

    def takes(self, key: str, stamp: int) -> bool:
        """Take the first answer to the current step; ignore stops and answers to other steps."""
        feed = self._answers.get(key)
        return feed is None or stamp == self._rule.present != feed.stamp

    def heard(self, key: str, stamp: int) -> None:
        """Take the next step if this one has been answered and the witness has received it."""
        answered = self._rule.answers(feed.stamp for feed in self._answers.values())
        if self._started and answered and self._rule.is_witnessed:
            self._go_on()

    def _witness(self, message: Header) -> None:
        """Record the recorder's progress, and continue if nothing else was missing."""
        waited = not self._rule.is_witnessed
        self._rule.witnessed = Time.from_msg(message.stamp).nanoseconds
        if waited:
            self.heard("", 0)

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
        """Take the first step, or resend a step without an answer."""
        now = self._hands.now()
        if not self._started:
            self._go_on()
        elif self._rule.resend(now) and self._later.is_canceled():
            self._hands.outputs.publish_again()
        self._chain.watch(self._rule.present if self._rule.is_overdue(now) else None)

    def trouble(self) -> str | None:
        """Return which node has not answered for long."""
        return self._chain.missing

    def interval(self, stamp: int) -> float:
        """Return the period, s."""
        return self._rule.period

    def new_episode(self) -> None:
        """Take the first step of an episode now, whether or not the previous one was answered."""
        self._rule.begin_episode()
        self._go_on()


def make_drive(hands: Hands, block: Block, *, lock_step: bool) -> Drive:
    """Return the drive of a block.

    Args:
        hands: Access to the node.
        block: The block.
        lock_step: Whether time is simulated and waits for the answer.

    Raises:
        ValueError: If the block cannot run that way.
    """
    trigger = block.trigger
    if not lock_step:
        return ByClock(hands, trigger) if isinstance(trigger, Every) else ByMessages(hands, trigger)
    answers = trigger_of(trigger, block.inputs)
    if answers is not None:
        return ByAnswers(hands, Answers(answers, block.inputs))
    assert isinstance(trigger, Every)
    return AsPlant(hands, trigger, block)
