"""How old a message is: the age of what was *sent*, not of what a callback got round to. Knows no ROS; clocks are arguments.

A message carries up to three times of the system clock: the stamp in its header, DDS's source time (both by the sender's
clock), and DDS's time of arrival here. Each gives an age, and **the oldest credible age counts**:

* *Source time*: where it is not more than 0.1 s in the future and not more than an hour old. On one machine both clocks are the
  same. From another computer it holds as far as the two clocks agree: if the sender's clock is behind, its messages are too old
  and are refused; if it is ahead, they are not credible. Both are reported, and both end once the clocks are set (NTP, chrony).
* *The header's stamp*: where it is set, by the same rule. Simulated time is more than an hour off, and so does not count.
* *Arrival*: always. Where no other is credible it alone counts, and the message is *undated*: how long it was under way cannot
  be seen. To a process that was suspended, what waited for it has just arrived, so after a gap undated messages prove nothing.

**The system clock may be set while it runs.** Ages are differences to the latest time that it has shown: after it was set back,
the old offset from the steady clock counts for 10 s more, so nothing sent before becomes younger, and what is sent meanwhile is
too old rather than too young. After it was set ahead, what was sent before is too old at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

FUTURE = 0.1
"""How far in the future a time is credible, s: above what two clocks that are kept by NTP differ by."""
PAST = 3600.0
"""How old a time is credible, s: beyond, it is of another epoch, or of a clock that was never set."""
HOLD = 10.0
"""How long the old offset counts after the clock was set back, s: longer than a message is under way."""
STEP = 1e-3
"""A change of the offset that is a step of the clock, s; less is a clock that is being slewed."""
LEAP = 0.1
"""A step ahead from which what was heard before is of unknown age, s: the machine slept, or the clock was wrong."""


class Age(NamedTuple):
    """The age of a message."""

    seconds: float
    dated: bool
    """Whether the sender's time is known; if not, it is the age since arrival."""
    by: str
    """The time that counted, in words."""
    ahead: float
    """How far the sender's clock is ahead, where that made its times not credible, s; else 0."""


class SystemClock:
    """The system clock against the steady one.

    Read the system clock first, then the steady one: a pause between the two must not look like a step ahead.
    """

    def __init__(self) -> None:
        self._offset = -math.inf
        self._behind_since: float | None = None

    def look(self, *, system: float, steady: float) -> bool:
        """Compare the clocks, at least every 20 ms, and return whether the system clock has leapt ahead."""
        offset, before = system - steady, self._offset
        if offset >= before - STEP:
            self._offset, self._behind_since = offset, None
            return offset - before > LEAP and before > -math.inf
        if self._behind_since is None:
            self._behind_since = steady
        if steady - self._behind_since >= HOLD:
            self._offset, self._behind_since = offset, None
        return False

    def age(self, *, steady: float, source: float = 0.0, arrival: float = 0.0, header: float = 0.0) -> Age:
        """Return how old a message is at a steady time, from its times on the system clock, s; 0 is unknown."""
        present = steady + self._offset
        ages = {"DDS's source time": present - source, "its header's stamp": present - header}
        credible = {by: max(0.0, age) for by, age in ages.items() if -FUTURE <= age <= PAST}
        waited = present - arrival
        arrived = {"its arrival": waited if 0.0 <= waited <= PAST else 0.0}
        by, seconds = max({**arrived, **credible}.items(), key=lambda item: item[1])
        ahead = 0.0 if credible else max((-age for age in ages.values() if age < -FUTURE), default=0.0)
        return Age(seconds, bool(credible), by, ahead)


def age_of(clock: SystemClock, info: Mapping[str, Any], header: Any, now: float) -> Age:
    """Return how old a message is.

    Args:
        clock: The system clock.
        info: The message's info, as rclpy gives it to a callback with two arguments.
        header: Its header; None where it has none, or where it does not count.
        now: The steady time, s.
    """
    stamp = 0.0 if header is None else header.stamp.sec + header.stamp.nanosec * 1e-9
    source, arrival = (info[name] * 1e-9 for name in ("source_timestamp", "received_timestamp"))
    return clock.age(steady=now, source=source, arrival=arrival, header=stamp)
