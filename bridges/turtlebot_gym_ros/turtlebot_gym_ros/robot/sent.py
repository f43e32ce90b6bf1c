"""How old a message is: the age of what was *sent*, not of what a callback got round to. Knows no ROS.

A message carries up to three times of the system clock: the stamp in its header, DDS's source time (both by the sender's
clock), and DDS's time of arrival here. Each gives an age, and **the oldest credible age counts**:

* *Source time*: where it is not more than 0.1 s in the future and not more than an hour old. On one machine both clocks are the
  same. From another computer it holds as far as the two clocks agree: if the sender's clock is behind, its messages are too old
  and are refused; if it is ahead, they are not credible. Both are reported, and both end once the clocks are set (NTP, chrony).
* *The header's stamp*: where it is set, by the same rule. Simulated time is more than an hour off, and so does not count.
* *Arrival*: always. Where no other is credible it alone counts, and the message is *undated*: how long it was under way cannot
  be seen. To a process that was suspended, what waited for it has just arrived, so after a gap undated messages prove nothing.

**The system clock may be set while it runs.** Then its times are read by its offset from the steady clock before and after,
for 10 s more, and again the oldest credible age counts: nothing that was sent before becomes younger. What is sent within these
10 s after the clock was set back may be taken for older than it is, and refused. Two steps between two looks cannot be seen.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

FUTURE = 0.1
"""How far in the future a time is credible, s: above what two clocks that are kept by NTP differ by."""
PAST = 3600.0
"""How old a time is credible, s: beyond, it is of another epoch, or of a clock that was never set."""
HOLD = 10.0
"""How long an offset counts after the clock was set, s: longer than a message is under way."""
STEP = 1e-3
"""A change of the offset that is a step of the clock, s; less is a clock that is being slewed."""


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
    """The system clock against the steady one."""

    def __init__(self) -> None:
        self._offsets: list[tuple[float, float]] = []
        """Offsets from the steady clock, s, the present one last, and until when they count."""

    def look(self, *, system: float, steady: float) -> None:
        """Compare the clocks, at least every 20 ms."""
        offset = system - steady
        others = [(each, min(until, steady + HOLD)) for each, until in self._offsets if abs(each - offset) > STEP]
        self._offsets = [*(each for each in others if each[1] > steady), (offset, math.inf)]

    def age(self, *, steady: float, source: float, arrival: float, header: float) -> Age:
        """Return how old a message is at a steady time, from its times on the system clock, s; 0 is unknown."""
        times = {"DDS's source time": source, "its header's stamp": header}
        present = [steady + offset for offset, _ in self._offsets]
        sent = [(at - time, by) for by, time in times.items() for at in present if -FUTURE <= at - time <= PAST]
        came = [(at - arrival, "its arrival") for at in present if at - arrival <= PAST]
        seconds, by = max([(0.0, "its arrival"), *came, *sent])
        ahead = 0.0 if sent else max(0.0, *(time - present[-1] for time in times.values()))
        return Age(seconds, bool(sent), by, ahead)


def read_clocks() -> tuple[float, float]:
    """Return the system time and the steady time, s; the steady clock goes on while the machine sleeps, where that is known."""
    return time.time(), time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


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
