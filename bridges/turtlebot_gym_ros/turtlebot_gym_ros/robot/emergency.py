"""The rule of the emergency stop, for any number of buttons. Knows no ROS; steady times come in as arguments.

Every button publishes whether it is pressed, at 5 Hz or more, pressed or not. The rule, in full:

* A press counts however short it is, and whoever sent it.
* A button that was heard once and is silent for 0.5 s counts as pressed. Its age is that of what it *sent*.
* A release needs every button: as many as were ever heard at the same time must be heard now, none may be pressed, and 0.5 s
  must have passed since the last ``true`` from anybody.

ROS does not say which publisher sent a message, but DDS numbers what each publisher sends: 1, 2, 3, ... The messages of one
button rise, so the buttons are told apart by taking each message as the successor of the nearest lower number heard. That is
the fewest publishers that can have sent the sequence (patience sorting), and two that speak in turn are told apart by the
second message of either. What it cannot see: a button that was never heard, and one of several where the middleware gives no
numbers; then all count as one, and the 0.5 s after a ``true`` are what keeps a second button's release from hiding the first.

Shared by the guard and by the nodes that move a robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SILENCE = 0.5
"""Silence of a button, once heard, that counts as a press, s; and time that a press lasts for all, s."""


@dataclass
class Button:
    """What is known of one publisher of the emergency stop."""

    began: float
    """When the first message of it that was heard was sent, a steady time, s."""
    sent: float
    """When the latest one was sent."""
    number: int
    """The number of the last one heard."""
    pressed: bool
    """What it said last."""


class EmergencyStop:
    """All buttons together: whether the robot must stand, and whether it may be released."""

    def __init__(self) -> None:
        self._buttons: list[Button] = []  # in the order in which they were heard
        self._pressed_at = -math.inf
        self._expected = 0

    def hear(self, pressed: bool, *, now: float, sent: float | None = None, number: int | None = None) -> None:
        """Take a button's message.

        Args:
            pressed: What it says.
            now: When it is heard.
            sent: When it was sent, if that is known to be earlier.
            number: The publisher's own number of the message; None where there is none.
        """
        sent = now if sent is None else min(sent, now)
        if pressed:
            self._pressed_at = now
        before = [each for each in self._buttons if number is None or each.number < number]
        if before:
            # Of equal numbers the one heard last: a button that died does not live on by the messages of another.
            button = max(reversed(before), key=lambda each: each.number)
            self._buttons.remove(button)
            button.number, button.sent, button.pressed = number or button.number, max(button.sent, sent), pressed
        else:
            button = Button(began=sent, sent=sent, number=number or 0, pressed=pressed)
        self._buttons.append(button)
        alive = self._alive(button.sent)  # in the time in which they speak: what has waited comes all at once
        # A button that was started again is a new one. Both exist only if the old one spoke after the new one began.
        newest = max((each.began for each in alive), default=now)
        self._expected = max(self._expected, 1, sum(each.sent >= newest for each in alive))
        if len(alive) >= self._expected:
            self._buttons = alive

    def _alive(self, now: float) -> list[Button]:
        return [each for each in self._buttons if now - each.sent <= SILENCE]

    def spoken_since(self, time: float) -> bool:
        """Return whether every button has sent something since a steady time, so that all it sent before has been heard."""
        return all(each.sent >= time for each in self._buttons)

    def trouble(self, now: float) -> str:
        """Return why the robot must stand, or nothing."""
        alive = self._alive(now)
        if now - self._pressed_at <= SILENCE or any(each.pressed for each in alive):
            return "the emergency stop is pressed"
        if len(alive) >= self._expected:
            return ""
        if self._expected == 1:
            return "the emergency stop is silent"
        return f"{self._expected - len(alive)} of {self._expected} emergency stops are silent"

    def refusal(self, now: float, publishers: int) -> str:
        """Return why the robot must not be released, or nothing.

        Args:
            now: The present.
            publishers: How many publishers the topic has; once a button was heard, each of them has to be heard.
        """
        alive = len(self._alive(now))
        if (why := self.trouble(now)) or alive >= publishers or not self._expected:
            return why
        return f"{publishers - alive} of {publishers} publishers of the emergency stop are not heard"
