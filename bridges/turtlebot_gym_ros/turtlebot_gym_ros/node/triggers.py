"""Rules for when a block runs, on integer nanoseconds, without ROS."""

from __future__ import annotations

from collections.abc import Iterator

from turtlebot_gym_ros.node.block import On

SECOND = 1_000_000_000
SLOW_AFTER = 5
"""Number of late steps in a row that no longer count as drop-outs."""


class StampGrid:
    """Steps at exact multiples of a period after the first one; late steps are made up for."""

    def __init__(self, period: float) -> None:
        self._period_ns = round(period * SECOND)
        self._next: int | None = None

    def due_until(self, now: int) -> Iterator[int]:
        """Yield the stamps that are nearer than the next one, ns; only one if the clock has leapt or stood still."""
        if self._next is None or not -2 * self._period_ns < now - self._next < SECOND:  # the next one is that near at most
            self._next = now
        while self._next - now < self._period_ns // 2:
            stamp = self._next
            self._next += self._period_ns
            yield stamp


class Messages:
    """Steps on the messages of an input, decimated to a period."""

    def __init__(self, trigger: On) -> None:
        self.input = trigger.input
        self.period = trigger.period
        self._period_ns = round(trigger.period * SECOND)
        self._gap_ns = round(trigger.max_gap * SECOND)
        self._seen: int | None = None
        self.reset()

    def reset(self) -> None:
        """Let the next message be the first."""
        self._due: int | None = None
        self._stepped: int | None = None
        self._late = 0
        self.slow: str | None = None

    def check(self, stamp: int) -> None:
        """Raise `ValueError` for a stamp not later than the last one, unless the clock must have been set back."""
        if self._seen is not None and 0 <= self._seen - stamp <= self._gap_ns:
            raise ValueError(f"its stamp is {(self._seen - stamp) / SECOND:.3f} s before the last one's, or the same")

    def due(self, stamp: int) -> tuple[bool, str | None]:
        """Return whether a message at a stamp makes a step, and the description of a gap if the block must be reset first."""
        spacing = stamp - (stamp if self._seen is None else self._seen)
        self._seen = stamp
        gap = None
        if not 0 <= spacing <= self._gap_ns:
            gap = f"{spacing / SECOND:.2f} s between two messages"
            self.reset()
        if self._due is not None and stamp + spacing // 2 < self._due:
            return False, gap
        due = stamp if self._due is None else self._due
        if self.period and self._due is not None:
            self._count_late(stamp - due + self._period_ns)
        self._due = (due if stamp - due < self._period_ns else stamp) + self._period_ns
        return True, gap

    def _count_late(self, spacing: int) -> None:
        self._late = self._late + 1 if spacing > 1.5 * self._period_ns else 0
        self.slow = None
        if self._late >= SLOW_AFTER:
            self.slow = f"{self.input} comes every {spacing / SECOND:.3f} s, but a step is due every {self.period} s"

    def pause(self) -> None:
        """Record that a step was skipped; the next one is like the first."""
        self._stepped = None

    def interval(self, stamp: int) -> float:
        """Return the time since the last step, s; 0 for the first one and after a pause."""
        last, self._stepped = self._stepped, stamp
        return 0.0 if last is None else (stamp - last) / SECOND
