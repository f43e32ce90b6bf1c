"""Lock-step: time advances when the previous step has been answered. Rules on stamps, without ROS.

The plant publishes a step's outputs with its stamp; each node in the loop answers with the same stamp; the plant takes the next
step when the answer to this one has arrived, never earlier and never twice. Until then time stands still, and the plant resends
its outputs every `RESEND` seconds: nodes that have already answered the step repeat their answer, and the others answer now. So
the launch order, late joiners, lost messages and restarted nodes change nothing: if nodes compute the same from the same
values, the drive is bit-identical on any machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum

from turtlebot_gym_ros.node.block import Every, Input, On
from turtlebot_gym_ros.node.triggers import SECOND, Messages

RESEND = 0.2
"""Time after which a step without an answer is published again, s, by the steady clock."""
OVERDUE = 2.0
"""Time after which the plant reports which node has not answered, s, by the steady clock."""
EPISODE_GAP = 60
"""Leap of the stamps between two episodes, s: no message is ever lost here, so nodes that see a gap restart."""
WALL = 1_000_000_000 * SECOND
"""Stamps from this one on, the year 2001, come from a wall clock, and so from a robot, which does not wait."""


def trigger_of(trigger: Every | On, inputs: Mapping[str, Input]) -> On | None:
    """Return the trigger of a block in lock-step; None for the plant. Raise `ValueError` if the block cannot run so."""
    for item in inputs.values():
        if item.lock_step == "refused":
            raise ValueError(f"lock_step must be false with an input on {item.topic}: its messages belong to no step.")
    if isinstance(trigger, On):
        return trigger
    if trigger.answers is not None:
        return On(trigger.answers)
    if not trigger.plant:
        raise ValueError("lock_step must be false for a block that runs by the clock: it answers no step.")
    return None


class Turn(Enum):
    """Reaction of a node to a message."""

    WAIT = "nothing: the step's other inputs are still to come, or it has been answered"
    STEP = "answer the step"
    HOLD = "answer the step with the last answer: the block steps more rarely"
    REPEAT = "give the same answer again"


class Answers:
    """The rule of a node that answers the steps of an input, by its trigger and all inputs by name."""

    def __init__(self, trigger: On, inputs: Mapping[str, Input]) -> None:
        self.messages = Messages(trigger)
        self._input = trigger.input
        self._tied = {trigger.input, *(key for key, item in inputs.items() if item.lock_step in ("same", "newest"))}
        self.reset()

    def reset(self) -> None:
        """Let the next step be the first."""
        self.messages.reset()
        self._met: int | None = None
        self._answered: int | None = None

    def check(self, key: str, stamp: int) -> None:
        """Raise `ValueError` for a wall clock's stamp on an input that belongs to a step."""
        if key in self._tied and stamp >= WALL:
            raise ValueError("its stamp is a wall clock's, but lock_step is for simulated time")

    def hear(self, key: str, stamps: Mapping[str, int | None]) -> tuple[Turn, str | None]:
        """Return the reaction to a new value of an input, and the description of a gap if the block must be reset first.

        ``stamps`` are those of the steps to which the latest values of all inputs belong, ns.
        """
        stamp = stamps[self._input]
        if key not in self._tied or stamp is None or any(stamps[other] != stamp for other in self._tied):
            return Turn.WAIT, None
        if stamp == self._answered:
            return (Turn.REPEAT if key == self._input else Turn.WAIT), None
        gap = None
        if stamp != self._met:
            self._met = stamp
            self._is_due, gap = self.messages.due(stamp)
        return (Turn.STEP if self._is_due else Turn.HOLD), gap

    def answer(self, stamp: int) -> None:
        """Record that a step has been answered."""
        self._answered = stamp


class Plant:
    """The rule of the plant: its steps, a period apart, s, and when to resend their outputs; ``now`` is the steady clock, s."""

    def __init__(self, period: float, *, now: float) -> None:
        self._period_ns = round(period * SECOND)
        self.present = SECOND - self._period_ns
        """Stamp of the step that awaits its answer, ns."""
        self._leap = False
        self._began = self._sent = now

    @property
    def has_begun(self) -> bool:
        """Whether it has taken a step."""
        return self.present >= SECOND

    def answers(self, stamps: Iterable[int | None]) -> bool:
        """Return whether inputs with these stamps answer the current step."""
        return self.has_begun and all(stamp == self.present for stamp in stamps)

    def advance(self, now: float) -> int:
        """Advance to the next step, and return its stamp, ns."""
        self.present += EPISODE_GAP * SECOND if self._leap else self._period_ns
        self._leap = False
        self._began = self._sent = now
        return self.present

    def begin_episode(self) -> None:
        """Let the next step be the first of an episode."""
        self._leap = True

    def resend(self, now: float) -> bool:
        """Return whether to resend the outputs now, and assume that the caller does."""
        if now - self._sent < RESEND:
            return False
        self._sent = now
        return True

    def is_overdue(self, now: float) -> bool:
        """Return whether the answer is overdue."""
        return now - self._began > OVERDUE
