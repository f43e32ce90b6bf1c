"""The rule of the emergency stop, for any number of buttons. Does not depend on ROS and takes steady times as arguments.

Every button publishes whether it is pressed, at 5 Hz or more, pressed or not. The rule, in full:

* A press counts, however short and from any button.
* Whatever could hide a press counts as one: a gap in the numbers of a button's messages, 0.5 s without a message from a button
  that was heard before, 0.5 s in which this process did not run, the end of a button, and a flood of messages.
* The age of a button counts from when it *sent* its last message.
* A release needs every button: as many as were ever heard at the same time must be heard now, none may be pressed, and 0.5 s
  must have passed since the last ``true`` from any of them, and since what could hide one.

ROS does not say which publisher sent a message, but DDS numbers what each publisher sends: 1, 2, 3, ... The numbers of one
button increase, so buttons are distinguished by taking each message as the successor of the nearest lower number heard. That
gives the fewest publishers that can have sent the sequence (patience sorting), and two alternating publishers are distinguished
from the second message of either. The first number of a button means nothing, unless a known button can have sent as many
messages meanwhile: then it cannot be told from a gap, and is a stop. A button that was never heard cannot be detected, nor one
of several if the middleware gives no numbers; then all count as one, no gap is visible, and the 0.5 s after a ``true`` prevent
a second button's release from hiding the first.

The guard and the nodes that move a robot share this rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from turtlebot_gym_ros.base.flood import MOST, WINDOW, Flood

SILENCE = 0.5
"""Silence of a button, once heard, that counts as a press, s; also the time for which a press holds for all buttons, s."""
BURST = 5
"""Messages that a button may send at one moment, such as a press and its release, besides those of its greatest rate."""
UNNUMBERED = 2**64 - 1
"""Number of each message if the middleware does not number them."""

NONE_HEARD = (
    "no emergency stop is heard, and one is required: start a button, for example: "
    'ros2 topic pub --rate 10 emergency_stop std_msgs/msg/Bool "{data: false}"'
)
"""Refusal of a robot that must have a button."""


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
        self._pressed_at = self._lost_at = -math.inf
        self._lost = ""
        self._flood = Flood()
        self._expected = self._publishers = 0

    def hear(self, pressed: bool, *, now: float, sent: float | None = None, number: int | None = None) -> None:
        """Take a button's message.

        Args:
            pressed: Value of the message.
            now: Time of reception.
            sent: Time of sending, if known to be earlier.
            number: The publisher's number of the message; None if there is none.
        """
        sent = now if sent is None else min(sent, now)
        number = None if number == UNNUMBERED else number
        if pressed:
            self._pressed_at = now
        before = [other for other in self._buttons if number is None or other.number < number]
        # Of equal numbers take the one heard last: messages of another button must not keep a dead one alive.
        button = max(reversed(before), key=lambda other: other.number, default=None)
        if button and number is not None and number - button.number > BURST + MOST / WINDOW * abs(sent - button.sent):
            button = None  # it cannot have sent so many messages meanwhile: this is another button's first one
        if button:
            self._buttons.remove(button)
            if number is not None and number > button.number + 1:
                self._lose("a message of the emergency stop was lost", now)
            button.number, button.sent, button.pressed = number or button.number, max(button.sent, sent), pressed
        else:
            button = _Button(began=sent, sent=sent, number=number or 0, pressed=pressed)
        self._buttons.append(button)
        if self._flood.hear(now, number):
            self._lose("the emergency stop is flooded with messages", now)
        alive = self._alive(button.sent)  # by the time of sending, since a backlog arrives all at once
        # A restarted button is a new one. Both exist only if the old one sent something after the new one began.
        newest = max((button.began for button in alive), default=now)
        self._expected = max(self._expected, 1, sum(button.sent >= newest for button in alive))
        if len(alive) >= self._expected:
            if len(alive) < len(self._buttons):
                self._lose("an emergency stop has ended", now)
            self._buttons = alive

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
        if self._expected:
            self._lost, self._lost_at = why, now

    def _alive(self, now: float) -> list[_Button]:
        return [button for button in self._buttons if now - button.sent <= SILENCE]

    def spoken_since(self, time: float) -> bool:
        """Return whether every button sent something after a steady time, so that all it sent before that has been heard."""
        return all(button.sent >= time for button in self._buttons)

    def lost(self, now: float) -> str:
        """Return what may have hidden a press in the last 0.5 s, or an empty text; whoever asks must stop until enabled."""
        return self._lost if now - self._lost_at <= SILENCE else ""

    @property
    def heard(self) -> bool:
        """Whether a button was ever heard."""
        return self._expected > 0

    def trouble(self, now: float) -> str:
        """Return why the robot must stand, or an empty text."""
        alive = self._alive(now)
        if now - self._pressed_at <= SILENCE or any(button.pressed for button in alive):
            return "the emergency stop is pressed"
        if (why := self.lost(now)) or len(alive) >= self._expected:
            return why  # first of all, since a process that did not run would call its buttons silent
        if self._expected == 1:
            return "the emergency stop is silent"
        return f"{self._expected - len(alive)} of {self._expected} emergency stops are silent"

    def refusal(self, now: float, publishers: int, *, required: bool = False) -> str:
        """Return why the robot must not be released, or an empty text.

        Args:
            now: Current steady time, s.
            publishers: Number of publishers of the topic; once a button was heard, all of them must be heard.
            required: Whether at least one button must be heard.
        """
        alive = len(self._alive(now))
        if required and not self.heard:
            return NONE_HEARD
        if (why := self.trouble(now)) or alive >= publishers or not self._expected:
            return why
        return f"{publishers - alive} of {publishers} publishers of the emergency stop are not heard"
