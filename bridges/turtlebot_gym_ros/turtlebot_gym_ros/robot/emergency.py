"""The rule of the emergency stop, for any number of buttons. Does not depend on ROS and takes steady times as arguments.

Every button publishes whether it is pressed, at 5 Hz or more, pressed or not. The rule, in full:

* A press counts, however short and from any button.
* A button that was heard before and is silent for 0.5 s counts as pressed. Its age counts from when it *sent* its last message.
* A release needs every button: as many as were ever heard at the same time must be heard now, none may be pressed, and 0.5 s
  must have passed since the last ``true`` from any of them.

ROS does not say which publisher sent a message, but DDS numbers what each publisher sends: 1, 2, 3, ... The numbers of one
button increase, so buttons are distinguished by taking each message as the successor of the nearest lower number heard. That
gives the fewest publishers that can have sent the sequence (patience sorting), and two alternating publishers are distinguished
from the second message of either. It cannot detect a button that was never heard, or one of several if the middleware gives no
numbers; then all count as one, and the 0.5 s after a ``true`` prevent a second button's release from hiding the first.

The guard and the nodes that move a robot share this rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SILENCE = 0.5
"""Silence of a button, once heard, that counts as a press, s; also the time for which a press holds for all buttons, s."""


@dataclass
class _Button:
    """State of one publisher of the emergency stop."""

    began: float
    """Steady time at which its first message was sent, s."""
    sent: float
    """Steady time at which its latest message was sent, s."""
    number: int
    """Number of its last message."""
    pressed: bool
    """Its last value."""


class EmergencyStop:
    """All buttons together: whether the robot must stand, and whether it may be released."""

    def __init__(self) -> None:
        self._buttons: list[_Button] = []  # in the order in which they were heard
        self._pressed_at = -math.inf
        self._expected = 0

    def hear(self, pressed: bool, *, now: float, sent: float | None = None, number: int | None = None) -> None:
        """Take a button's message.

        Args:
            pressed: Value of the message.
            now: Time of reception.
            sent: Time of sending, if known to be earlier.
            number: The publisher's number of the message; None if there is none.
        """
        sent = now if sent is None else min(sent, now)
        if pressed:
            self._pressed_at = now
        before = [other for other in self._buttons if number is None or other.number < number]
        if before:
            # Of equal numbers take the one heard last: messages of another button must not keep a dead one alive.
            button = max(reversed(before), key=lambda other: other.number)
            self._buttons.remove(button)
            button.number, button.sent, button.pressed = number or button.number, max(button.sent, sent), pressed
        else:
            button = _Button(began=sent, sent=sent, number=number or 0, pressed=pressed)
        self._buttons.append(button)
        alive = self._alive(button.sent)  # by the time of sending, since a backlog arrives all at once
        # A restarted button is a new one. Both exist only if the old one sent something after the new one began.
        newest = max((button.began for button in alive), default=now)
        self._expected = max(self._expected, 1, sum(button.sent >= newest for button in alive))
        if len(alive) >= self._expected:
            self._buttons = alive

    def _alive(self, now: float) -> list[_Button]:
        return [button for button in self._buttons if now - button.sent <= SILENCE]

    def spoken_since(self, time: float) -> bool:
        """Return whether every button sent something after a steady time, so that all it sent before that has been heard."""
        return all(button.sent >= time for button in self._buttons)

    def trouble(self, now: float) -> str:
        """Return why the robot must stand, or an empty text."""
        alive = self._alive(now)
        if now - self._pressed_at <= SILENCE or any(button.pressed for button in alive):
            return "the emergency stop is pressed"
        if len(alive) >= self._expected:
            return ""
        if self._expected == 1:
            return "the emergency stop is silent"
        return f"{self._expected - len(alive)} of {self._expected} emergency stops are silent"

    def refusal(self, now: float, publishers: int) -> str:
        """Return why the robot must not be released, or an empty text.

        Args:
            now: Current steady time, s.
            publishers: Number of publishers of the topic; once a button was heard, all of them must be heard.
        """
        alive = len(self._alive(now))
        if (why := self.trouble(now)) or alive >= publishers or not self._expected:
            return why
        return f"{publishers - alive} of {publishers} publishers of the emergency stop are not heard"
