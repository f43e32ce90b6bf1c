"""Topics on which messages come faster than any healthy source sends them. Does not depend on ROS."""

from __future__ import annotations

import math

WINDOW = 0.1
"""Time in which messages are counted, s."""
MOST = 50
"""Most messages of a topic in that time: 500 a second."""
HOLD = 0.5
"""Time for which a flood counts after its last message above that number, s."""


class Flood:
    """Counts the messages of a topic, including those that were dropped, by the numbers that DDS gives them."""

    def __init__(self) -> None:
        self._since = self._last = -math.inf
        self._count = self._largest = self._number = 0

    def hear(self, now: float, number: int | None = None) -> bool:
        """Count a message, and return whether there were too many.

        Args:
            now: Steady time, s.
            number: The publisher's number of the message; None if there is none.
        """
        number = self._number + 1 if number is None else number
        step = max(1, number - self._number)
        if not 0.0 <= now - self._since <= WINDOW or number < self._number:  # the latter is another publisher's
            self._since, self._count, self._largest, step = now, 0, 0, 1
        self._number = number
        self._count, self._largest = self._count + step, max(self._largest, step)
        # One jump may lead to another publisher's numbers, or over a time in which this process did not run.
        if self._count - self._largest >= MOST:
            self._last = now
        return self._last == now

    def lasts(self, now: float) -> bool:
        """Return whether there was a flood a short time ago."""
        return now - self._last <= HOLD
