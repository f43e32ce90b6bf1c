"""Age of a message since it was *sent*, not since a callback processed it. Does not depend on ROS.

A message carries up to three times of the system clock: the stamp in its header, DDS's source time (both by the sender's
clock), and DDS's time of arrival here. Each gives an age, and **the oldest credible age counts**:

* *Source time*: credible if it is at most 0.1 s in the future and at most an hour old. On one machine both clocks are the same.
  From another computer it is as accurate as the two clocks agree: if the sender's clock is behind, its messages seem too old
  and are refused; if it is ahead, they are not credible. Both are reported, and both end once the clocks are synchronized (NTP,
  chrony).
* *The header's stamp*: if it is set, by the same rule. Simulated time is more than an hour off, and so is ignored.
* *Arrival*: always. If no other time is credible, it alone counts, and the message is *undated*: its time in transit is
  unknown. For a process that was suspended, its backlog has just arrived, so after a gap undated messages prove nothing.

**The system clock may be set while it runs.** For 10 s its times are then read with both its old and its new offset from the
steady clock, and again the oldest credible age counts, so no earlier message becomes younger. Messages sent within 10 s after
the clock was set back may seem older than they are, and be refused. Two steps between two checks cannot be detected.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

FUTURE = 0.1
"""Largest credible lead of a time, s: more than two clocks under NTP differ."""
PAST = 3600.0
"""Largest credible age of a time, s; an older one is of another epoch, or of a clock that was never set."""
HOLD = 10.0
"""Time for which an old offset counts after the clock was set, s: longer than any message is in transit."""
STEP = 1e-3
"""Change of the offset that counts as a step of the clock, s; a smaller one is slewing."""


class Age(NamedTuple):
    """The age of a message."""

    seconds: float
    dated: bool
    """Whether the sender's time is known; if not, the age counts from arrival."""
    by: str
    """Description of the time that counted."""
    ahead: float
    """Lead of the sender's clock if it made its times not credible, s; else 0."""


class SystemClock:
    """The system clock compared with the steady one."""

    def __init__(self) -> None:
        self._offsets: list[tuple[float, float]] = []
        """Offsets from the steady clock, s, current one last, with the time until which they count."""

    def look(self, *, system: float, steady: float) -> None:
        """Compare the clocks; call this at least every 20 ms."""
        offset = system - steady
        others = [(each, min(until, steady + HOLD)) for each, until in self._offsets if abs(each - offset) > STEP]
        self._offsets = [*(each for each in others if each[1] > steady), (offset, math.inf)]

    def age_of(self, info: Mapping[str, Any], header: Any, now: float) -> Age:
        """Return the age of a message.

        Args:
            info: The message's info, as rclpy passes it to a callback with two arguments.
            header: Header of the message; None if it has none or is ignored.
            now: The steady time, s.
        """
        stamp = 0.0 if header is None else header.stamp.sec + header.stamp.nanosec * 1e-9
        source, arrival = (info[name] * 1e-9 for name in ("source_timestamp", "received_timestamp"))
        return self.age(steady=now, source=source, arrival=arrival, header=stamp)

    def age(self, *, steady: float, source: float, arrival: float, header: float) -> Age:
        """Return the age of a message at a steady time, from its times on the system clock, s; 0 means unknown."""
        times = {"DDS's source time": source, "its header's stamp": header}
        present = [steady + offset for offset, _ in self._offsets]
        sent = [(at - time, by) for by, time in times.items() for at in present if -FUTURE <= at - time <= PAST]
        came = [(at - arrival, "its arrival") for at in present if at - arrival <= PAST]
        seconds, by = max([(0.0, "its arrival"), *came, *sent])
        ahead = 0.0 if sent else max(0.0, *(time - present[-1] for time in times.values()))
        return Age(seconds, bool(sent), by, ahead)


def read_clocks() -> tuple[float, float]:
    """Return the system time and the steady time, s; the latter includes the machine's sleep where that is supported."""
    return time.time(), time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))
