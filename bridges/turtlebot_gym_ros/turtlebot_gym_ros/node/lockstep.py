"""Lock-step: time goes on when the step before has been answered. Rules on stamps, without ROS.

The plant publishes a step's outputs at its stamp; each node on the way answers with that same stamp; the plant takes the next
step when the answer to this one has come, never before and never twice. Until then time stands still, and the plant sends its
outputs again every `RESEND` seconds: who has answered the step already repeats the answer, who has not answers now. So the
order of launching, late joiners, lost messages and nodes that start again change nothing: a node that computes the same from
the same values gives the same drive, to the bit, on any machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum

from turtlebot_gym_ros.node.block import Every, Input, On
from turtlebot_gym_ros.node.triggers import SECOND, Messages

RESEND = 0.2
"""Time after which a step that is not answered is published again, s, by the steady clock."""
OVERDUE = 2.0
"""Time after which the plant says who has not answered, s, by the steady clock."""
AHEAD = 200
"""So many steps at most is a plant ahead of its witness, a recorder on a busy machine."""
EPISODE_GAP = 60
"""Between two episodes the stamps leap by so much, s: no message is ever lost here, so who finds a gap begins anew."""
WALL = 1_000_000_000 * SECOND
"""Stamps from here on, the year 2001, are a wall clock's: of a robot, which does not wait."""


def trigger_of(trigger: Every | On, inputs: Mapping[str, Input]) -> On | None:
    """Return on what a block runs in lock-step; None for the plant.

    Raises:
        ValueError: If it cannot run in lock-step.
    """
    for each in inputs.values():
        if each.lock_step == "refused":
            raise ValueError(f"lock_step must be false where {each.topic} is heard: its messages belong to no step.")
    if isinstance(trigger, On):
        return trigger
    if trigger.answers is not None:
        return On(trigger.answers)
    if trigger.speed is None:
        raise ValueError("lock_step must be false for a block that runs by the clock: it answers nobody.")
    return None


class Turn(Enum):
    """What a message makes a node do."""

    WAIT = "nothing: the step's other inputs are still to come, or it has been answered"
    STEP = "answer the step"
    HOLD = "answer the step with the last answer: the block steps more rarely"
    REPEAT = "give the same answer again"


class Answers:
    """The rule of a node that answers the steps.

    Args:
        trigger: The input that it answers.
        inputs: All inputs, by name.
    """

    def __init__(self, trigger: On, inputs: Mapping[str, Input]) -> None:
        self.messages = Messages(trigger)
        self._input = trigger.input
        self._tied = {trigger.input, *(key for key, each in inputs.items() if each.lock_step in ("same", "newest"))}
        self.reset()

    def reset(self) -> None:
        """Let the next step be the first."""
        self.messages.reset()
        self._met: int | None = None
        self._answered: int | None = None

    def check(self, key: str, stamp: int) -> None:
        """Refuse what is not simulated, of the inputs that belong to a step.

        Raises:
            ValueError: If the stamp is a wall clock's.
        """
        if key in self._tied and stamp >= WALL:
            raise ValueError("its stamp is a wall clock's, but lock_step is for simulated time")

    def hear(self, key: str, stamps: Mapping[str, int | None]) -> tuple[Turn, str | None]:
        """Return what to do now that an input has come.

        Args:
            key: Its name.
            stamps: The stamps of the steps to which the latest values of all inputs belong, ns.

        Returns:
            The turn, and what to say of a gap, where the block must be reset first.
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
        """Note that a step has been answered."""
        self._answered = stamp


class Plant:
    """The rule of the plant: its steps, and when their outputs are sent again.

    Args:
        trigger: Its period and its highest speed.
        now: The present by the steady clock, s.
    """

    def __init__(self, trigger: Every, *, now: float) -> None:
        self.period = trigger.period
        self._period_ns = round(trigger.period * SECOND)
        self._interval = trigger.period / trigger.speed if trigger.speed else 0.0
        self.present = SECOND - self._period_ns
        """The stamp of the step that is to be answered, ns."""
        self._leap = False
        self.witnessed: int | None = None
        """Stamp up to which the witness has heard, ns; None before its first word."""
        self._waits_for_witness = trigger.witness is not None
        self._due = now
        self._began = self._sent = now

    def answers(self, stamps: Iterable[int | None]) -> bool:
        """Return whether inputs with these stamps answer the present step."""
        return all(stamp == self.present for stamp in stamps)

    @property
    def is_witnessed(self) -> bool:
        """Return whether the witness, if there is one, has heard the steps so far but a few; of an episode's first one, that
        one."""
        if not self._waits_for_witness:
            return True
        return self.witnessed is not None and abs(self.present - self.witnessed) <= AHEAD * self._period_ns

    def wait(self, now: float) -> float:
        """Return how long the next step has to wait for its time, s; 0 if not at all."""
        return max(self._due - now, 0.0)

    def advance(self, now: float) -> int:
        """Go on to the next step, and return its stamp, ns."""
        self.present += EPISODE_GAP * SECOND if self._leap else self._period_ns
        self._leap = False
        self._due = max(self._due, now - self._interval) + self._interval
        self._began = self._sent = now
        return self.present

    def begin_episode(self) -> None:
        """Let the next step be the first of an episode."""
        self._leap = True

    def resend(self, now: float) -> bool:
        """Return whether the outputs are to be sent again, and take it that they are."""
        if now - self._sent < RESEND:
            return False
        self._sent = now
        return True

    def is_overdue(self, now: float) -> bool:
        """Return whether the answer has been awaited for long."""
        return now - self._began > OVERDUE


def missing_link(stamp: int, heard: Mapping[str, int | None], speakers: Mapping[str, Iterable[str]]) -> str:
    """Return in words who has not answered a step.

    Args:
        stamp: Of the step, ns.
        heard: The newest stamp on each topic on the way, in the order of the way, ns.
        speakers: The nodes that publish there.
    """
    topic = next((topic for topic, newest in heard.items() if newest != stamp), None)
    if topic is None:
        return f"waits for the recorder, which has not heard the steps up to {stamp / SECOND:.3f} s"
    names = ", ".join(sorted(speakers[topic]))
    waits = f"waits for {topic} of the step at {stamp / SECOND:.3f} s"
    return f"{waits}: {names} has not answered" if names else f"{waits}: nobody publishes it"
