"""The rule of the emergency stop, for any number of buttons. Does not depend on ROS and takes steady times as arguments.

Every button publishes whether it is pressed, at 5 Hz or more (10 Hz on a radio), reliably, pressed or not, and says ``true``
for as long as it is pressed. It is heard twice: *reliably*, each message in its order, so that a lost one holds up all later
ones until it has been sent again, which takes Fast DDS up to 3 s; and *promptly*, at best effort, where lost ones are missing.
The rule, in full:

* **A press is a stop until a person enables again**, however short, from any button, and however late it is heard.
* **So is what may have hidden one**: messages that are lost for good, if the next one is heard more than 0.5 s after the one
  before them was sent (when the next one was sent may be wrong by a clock that was set);
  10 s without a message from a button that was heard before, reliably or promptly; the end of a button; 0.5 s in which this
  process did not run.
* **The robot stands while a button is silent**, from 0.5 s after it *sent* the last message that was heard. The robot resumes
  by itself 0.5 s after the button is heard again, if no button is pressed and all that was sent until then has arrived.
* A message that is lost between two others in less than 0.5 s, both ``false``, stops nothing: no press of 0.5 s can hide there.
  If it is sent again and says ``true``, it is a press.
* A release needs every button: as many as were ever heard at the same time must be heard now, none may be pressed, and 0.5 s
  must have passed since the last ``true`` from any of them, and since what could hide one.

ROS does not say which publisher sent a message, but DDS numbers what each publisher sends: 1, 2, 3, ... The numbers of one
button increase, so buttons are distinguished by taking each message as the successor of the nearest lower number heard. That
gives the fewest publishers that can have sent the sequence (patience sorting), and two alternating publishers are distinguished
from the second message of either. The first number of a button means nothing, unless a known button can have sent as many
messages meanwhile: then it cannot be told from a gap. A button that was never heard cannot be detected, nor one of several if
the middleware gives no numbers; then all count as one, no gap is visible, and the 0.5 s after a ``true`` prevent a second
button's release from hiding the first. One that publishes at best effort is heard promptly only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SILENCE = 0.5
"""Silence of a button, once heard, that makes the robot stand, s; also the time for which a press holds for all buttons, s."""
OUTAGE = 10.0
"""Silence that counts as a press, s: in less, a reliable publisher has sent lost messages again, even three times."""
BURST, FASTEST = 5, 500.0
"""Messages that a button may send at one moment, such as a press and its release, and besides in a second."""
UNNUMBERED = 2**64 - 1
"""Number of each message if the middleware does not number them."""

NONE_HEARD = "no emergency stop is heard, and one is required: start a button, see emergency_stop in --help"
"""Refusal of a robot that must have a button."""


@dataclass
class _Button:
    """One publisher: when its first message was sent, its latest one sent and heard, and the number and value of that."""

    began: float
    sent: float
    heard: float
    number: int
    pressed: bool


class _Stream:
    def __init__(self) -> None:
        self.buttons: list[_Button] = []  # in the order in which they were heard
        self.expected = 0

    def alive(self, now: float) -> list[_Button]:
        return [button for button in self.buttons if now - button.sent <= SILENCE]


class EmergencyStop:
    """All buttons together: whether the robot must stand, and whether it may be released."""

    def __init__(self) -> None:
        self._every, self._prompt = _Stream(), _Stream()
        self._pressed_at = self._lost_at = self._back_at = self._back_sent = -math.inf
        self._lost = ""
        self._publishers = 0

    def hear(
        self, pressed: bool, *, now: float, sent: float = math.inf, number: int | None = None, prompt: bool = False
    ) -> None:
        """Take a button's message, received ``now`` promptly or reliably, with the time of sending and its number, if known."""
        sent = min(sent, now)
        number = None if number == UNNUMBERED else number
        if pressed:
            self._pressed_at = now
        if self._alive(sent) < self._expected:
            self._back_at, self._back_sent = now, sent
        stream = self._prompt if prompt else self._every
        before = [other for other in stream.buttons if number is None or other.number < number]
        # Of equal numbers take the one heard last: messages of another button must not keep a dead one alive.
        button = max(reversed(before), key=lambda other: other.number, default=None)
        if button and number is not None and number - button.number > BURST + FASTEST * abs(sent - button.sent):
            button = None  # it cannot have sent so many messages meanwhile: this is another button's first one
        if button:
            stream.buttons.remove(button)
            if not prompt and number is not None and number > button.number + 1 and now - button.sent > SILENCE:
                self._lose("messages of the emergency stop were lost", now)
            button.number, button.pressed, button.heard = number or button.number, pressed, now
            button.sent = max(button.sent, sent)
        else:
            button = _Button(began=sent, sent=sent, heard=now, number=number or 0, pressed=pressed)
        stream.buttons.append(button)
        alive = stream.alive(button.sent)  # by the time of sending, since a backlog arrives all at once
        # A restarted button is a new one. Both exist only if the old one sent something after the new one began.
        newest = max((button.began for button in alive), default=now)
        stream.expected = max(stream.expected, 1, sum(button.sent >= newest for button in alive))
        if len(alive) >= stream.expected:
            if len(alive) < len(stream.buttons):
                self._lose("an emergency stop has ended", now)
            stream.buttons = alive

    def count(self, publishers: int, now: float) -> None:
        """Take the current number of publishers of the topic; one less than before is a button that has ended."""
        if publishers < self._publishers:
            self._lose("an emergency stop has ended", now)
        self._publishers = publishers

    def wake(self, gap: float, now: float) -> None:
        """Take the time for which this process did not run, s: presses of that time may never be heard."""
        if gap > SILENCE:
            self._lose(f"the emergency stop was not listened to for {gap:.1f} s", now)

    def _lose(self, why: str, now: float) -> None:
        """Record that a press may have been lost, if there is a button."""
        if self.heard:
            self._lost, self._lost_at = why, now

    def _alive(self, now: float) -> int:
        """Return how many buttons are heard, in one way or the other."""
        return max(len(self._every.alive(now)), len(self._prompt.alive(now)))

    @property
    def _expected(self) -> int:
        return max(self._every.expected, self._prompt.expected)

    def spoken_since(self, time: float) -> bool:
        """Return whether every button sent something after a steady time, so that all it sent before that has been heard."""
        return all(button.sent >= time for stream in (self._every, self._prompt) for button in stream.buttons)

    def lost(self, now: float) -> str:
        """Return what may have hidden a press in the last 0.5 s, or an empty text; whoever asks must stop until enabled."""
        if now - self._lost_at <= SILENCE:
            return self._lost
        if any(now - button.heard > OUTAGE for stream in (self._every, self._prompt) for button in stream.buttons):
            return f"messages of the emergency stop are missing for more than {OUTAGE:g} s"
        return ""

    @property
    def heard(self) -> bool:
        """Whether a button was ever heard."""
        return self._expected > 0

    def trouble(self, now: float) -> str:
        """Return why the robot must stand, or an empty text; it is a stop until enabled after a press, and if `lost`."""
        pressed = (button.pressed for stream in (self._every, self._prompt) for button in stream.alive(now))
        if now - self._pressed_at <= SILENCE or any(pressed):
            return "the emergency stop is pressed"
        if why := self.lost(now):
            return why  # first of all, since a process that did not run would call its buttons silent
        if missing := max(self._expected - self._alive(now), 0):
            silent = f"{missing} of {self._expected} emergency stops are" if self._expected > 1 else "the emergency stop is"
            return f"{silent} silent"
        if now - self._back_at <= SILENCE or not self.spoken_since(self._back_sent):
            return f"the emergency stop was silent, and must be heard for {SILENCE:g} s"
        return ""

    def refusal(self, now: float, publishers: int, *, required: bool = False) -> str:
        """Return why the robot must not be released, if so; once a button was heard, all publishers must be heard."""
        alive = self._alive(now)
        if required and not self.heard:
            return NONE_HEARD
        if (why := self.trouble(now)) or alive >= publishers or not self._expected:
            return why
        return f"{publishers - alive} of {publishers} publishers of the emergency stop are not heard"
