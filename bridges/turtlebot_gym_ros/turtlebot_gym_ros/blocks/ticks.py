"""The time of a block that runs on each odometry."""

from __future__ import annotations


class Ticks:
    """Time since the start; by equal steps it is a multiple of them, as in the environment, and not their sum."""

    def __init__(self) -> None:
        self.time = 0.0
        """The time, s."""
        self.dt = 0.0
        """The last step, s; 0 before the first."""
        self._since, self._count = 0.0, 0

    def advance(self, dt: float) -> None:
        """Go on by a step, s."""
        if dt != self.dt:
            self._since, self._count, self.dt = self.time, 0, dt
        self._count += 1
        self.time = self._since + self._count * dt
