"""How a block is driven: by the clock, by the messages of an input, or in lock-step, by the steps of a plant.

The rules are in `triggers` and `lockstep`, without ROS. A scheduler is notified of each new value (`on_message`), and calls the
shell's ``step`` when one is due.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage

from cmd_vel_guard.qos import STREAM
from turtlebot_gym_ros.node.block import Every, On
from turtlebot_gym_ros.node.lockstep import RESEND, Answers, Plant, Turn, trigger_of
from turtlebot_gym_ros.node.triggers import SECOND, Messages, StampGrid

if TYPE_CHECKING:
    from turtlebot_gym_ros.node.shell import Shell


class Scheduler:
    """Runs a block, by the rule of the input whose messages make its steps, or each period, s, of its own."""

    def __init__(self, shell: Shell, messages: Messages | None = None, *, period: float = 0.0) -> None:
        self._shell, self._messages, self._period = shell, messages, period

    def present(self) -> int:
        """Return the current time of the block's clock, ns: the ROS clock."""
        return self._shell.node.get_clock().now().nanoseconds

    def accepts(self, key: str, stamp: int) -> bool:
        """Return whether a value with a stamp counts; raise `ValueError` for an impossible stamp."""
        return True

    def on_message(self, key: str, stamp: int) -> None:
        """Handle a new value, and run the block if a step is due."""

    def missing(self) -> str | None:
        """Return what prevents steps, besides missing inputs."""
        return self._messages.slow if self._messages else None

    def trouble(self) -> str | None:
        """Return a problem to report to users."""
        return self.missing()

    def interval(self, stamp: int) -> float:
        """Return the time since the last step, s."""
        return self._messages.interval(stamp) if self._messages else self._period

    def pause(self) -> None:
        """Record that a step was skipped."""

    def reset(self) -> None:
        """Let the next step be the first."""

    def new_episode(self) -> None:
        """Record that the plant was reset."""


class _ByClock(Scheduler):
    """Steps on a grid of the ROS clock, in real time."""

    def __init__(self, shell: Shell, trigger: Every) -> None:
        super().__init__(shell, period=trigger.period)
        self._grid = StampGrid(trigger.period)
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # the system clock may be set back
        shell.node.create_timer(trigger.period, self._tick, clock=steady, callback_group=shell.group)

    def _tick(self) -> None:
        for stamp in self._grid.due_until(self.present()):
            self._shell.step(stamp)


class _ByMessages(Scheduler):
    """Steps on the messages of an input."""

    def __init__(self, shell: Shell, trigger: On) -> None:
        self._rule = Messages(trigger)
        super().__init__(shell, self._rule)
        self.pause, self.reset = self._rule.pause, self._rule.reset

    def accepts(self, key: str, stamp: int) -> bool:
        """Refuse repeated and late messages."""
        if key == self._rule.input:
            self._rule.check(stamp)
        return True

    def on_message(self, key: str, stamp: int) -> None:
        """Step, if the message is due."""
        if key != self._rule.input:
            return
        due, gap = self._rule.due(stamp)
        if gap:
            self._shell.node.get_logger().warning(f"{self._shell.feeds[key].topic}: {gap}; starting again from this message.")
            self._shell.pause()
        if due:
            self._shell.step(stamp)


class _ByAnswers(Scheduler):
    """Answers the steps of lock-step."""

    def __init__(self, shell: Shell, rule: Answers) -> None:
        super().__init__(shell, rule.messages)
        self._rule = rule
        self.reset = rule.reset

    def present(self) -> int:
        """Return 0: a message that answers no step, such as a stop, has no time."""
        return 0

    def accepts(self, key: str, stamp: int) -> bool:
        """Refuse stamps of a real robot."""
        self._rule.check(key, stamp)
        return True

    def on_message(self, key: str, stamp: int) -> None:
        """Answer the step if its inputs are complete, or repeat the answer."""
        shell, rule = self._shell, self._rule
        steps = {name: feed.step for name, feed in shell.feeds.items()}
        turn, gap = rule.hear(key, steps)
        if gap:
            shell.node.get_logger().info(f"{gap}: a new episode.")
            shell.begin_anew()
            turn, _ = rule.hear(key, steps)
        stamp = steps[rule.messages.input] or 0
        may_repeat = shell.switch is None or shell.switch.safety.enabled
        if turn is Turn.REPEAT and may_repeat:
            shell.outputs.publish_again()
        if turn is Turn.HOLD and shell.outputs.moving and may_repeat:
            shell.outputs.publish_again(stamp)  # the plant waits for a command in every step
        if turn is Turn.HOLD or (turn is Turn.STEP and shell.step(stamp)):
            rule.answer(stamp)


class _AsPlant(Scheduler):
    """Takes each step of lock-step when the previous one has been answered."""

    def __init__(self, shell: Shell, trigger: Every) -> None:
        super().__init__(shell, period=trigger.period)
        self._clock = shell.node.create_publisher(ClockMessage, "clock", STREAM)
        self._rule = Plant(trigger.period, now=shell.now())
        self._answers = {key: feed for key, feed in shell.feeds.items() if feed.declared.lock_step == "same"}
        if not self._answers:
            raise ValueError("lock_step must be false for a plant without an input that answers it.")
        shell.node.create_timer(0.5 * RESEND, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def present(self) -> int:
        """Return the stamp of the step that awaits its answer, ns."""
        return self._rule.present

    def accepts(self, key: str, stamp: int) -> bool:
        """Take the first answer to the current step; ignore stops and answers to other steps."""
        feed = self._answers.get(key)
        return feed is None or stamp == self._rule.present != feed.stamp

    def on_message(self, key: str, stamp: int) -> None:
        """Take the next step if this one has been answered."""
        if self._rule.answers(feed.stamp for feed in self._answers.values()):
            self._go_on()

    def _go_on(self) -> None:
        """Take the next step."""
        stamp = self._rule.advance(self._shell.now())
        self._clock.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))
        self._shell.step(stamp)

    def _tick(self) -> None:
        """Take the first step, or resend a step without an answer."""
        if not self._rule.has_begun:
            self._go_on()
        elif self._rule.resend(self._shell.now()):
            self._shell.outputs.publish_again()

    def trouble(self) -> str | None:
        """Return what has not answered for long; the diagnostics of the nodes between say which of them waits for what."""
        if not self._rule.is_overdue(self._shell.now()):
            return None
        topics = ", ".join(feed.topic for feed in self._answers.values() if feed.stamp != self._rule.present)
        return f"time stands still: waits for {topics} of the step at {self._rule.present / SECOND:.3f} s"

    def new_episode(self) -> None:
        """Take the first step of an episode now, even if the previous one was not answered."""
        self._rule.begin_episode()
        self._go_on()


def make_drive(shell: Shell) -> Scheduler:
    """Return the drive of a shell's block, or raise `ValueError` if the block cannot be driven that way."""
    trigger, inputs = shell.block.trigger, shell.block.inputs
    if not shell.common.lock_step:
        return _ByClock(shell, trigger) if isinstance(trigger, Every) else _ByMessages(shell, trigger)
    answers = trigger_of(trigger, inputs)
    if answers is not None:
        return _ByAnswers(shell, Answers(answers, inputs))
    assert isinstance(trigger, Every)
    return _AsPlant(shell, trigger)
