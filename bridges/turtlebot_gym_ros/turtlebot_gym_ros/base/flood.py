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
    """Counts the messages of a topic."""

    def __init__(self) -> None:
        self._since = self._last = -math.inf
        self._count = 0

    def hear(self, now: float) -> bool:
        """Count a message at a steady time, s, and return whether there were too many."""
        if not 0.0 <= now - self._since <= WINDOW:
            self._since, self._count = now, 0
        self._count += 1
        if self._count > MOST:
            self._last = now
        return self._count > MOST

    def lasts(self, now: float) -> bool:
        """Return whether there was a flood a short time ago."""
        return now - self._last <= HOLD
