"""Age of a message since it was *sent*, and since what it rests on was *measured*. Does not depend on ROS.

A message carries up to three times: the stamp in its header, that of the measurement on which it rests; DDS's source time, at
which it was sent; and its arrival here. Every node of the chain and the guard judge ages by one rule:

* **The oldest time counts.** A stamp that looks old is old: either it is late, or the clock of its sender is behind. Nobody can
  tell which, so both are refused.
* **A clock that is ahead hides nothing**, though its messages would seem younger than they are. For each input the largest lead
  of the stamps, that of the least delayed message, is remembered, and ages count from it. So a lead makes messages older, never
  younger. It is forgotten at the rate `DRIFT`, and refused above `BOUND`. After a jump of the lead, by a clock that was set or
  by messages that had all been late, nothing counts for the time `SETTLE`.
* **Cause and effect.** Nothing is sent before what it rests on was measured. A header's stamp by this computer's clock bounds
  the time since sending, whatever the sender's own clock says: a laptop whose clock is behind may drive a robot.
* *Arrival* always counts. A message with no other time is *undated*: its time in transit is unknown. For a process that was
  suspended, its backlog has just arrived, so after a gap undated messages prove nothing.

Stamps of another epoch, such as simulated time, are ignored. What this cannot see: a delay that never falls below the lead of
a clock that is ahead. On the robot, stamps are by its own clock and have no lead.

**The system clock may be set while it runs.** For 10 s its times are then read with both its old and its new offset from the
steady clock, and again the oldest age counts, so no earlier message becomes younger; then leads are estimated anew. Meanwhile
messages may seem older than they are, and be refused. Two steps between two checks cannot be detected.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

EPOCH = 1e9
"""Times before this one, in 2001, are not by a clock that was ever set, s."""
HOLD = 10.0
"""Time for which an old offset counts after the clock was set, s: longer than any message is in transit."""
STEP = 1e-3
"""Change of the offset that counts as a step of the clock, s; a smaller one is slewing."""
BOUND = 2.0
"""Largest lead of a sender's clock that is made up for, s."""
JUMP = 0.1
"""Rise of a lead that counts as a jump, s: more than two synchronized clocks differ."""
SETTLE = 1.0
"""Time after a jump of the lead in which messages do not count, s."""
DRIFT = 5e-4
"""Rate at which a lead is forgotten, 1: more than two clocks drift apart."""
SYNCHRONIZE = "synchronize both clocks (chrony)"


class Age(NamedTuple):
    """The most since a message was sent and since what it rests on was measured, s; infinite if its clock is refused.

    It is dated if the sender's time is known, otherwise it counts from arrival; ``by`` describes the time that counted.
    """

    sent: float
    measured: float
    dated: bool
    by: str
    refusal: str = ""
    """Why its clock is refused."""

    def since(self, lasts: float) -> float:
        """Return the age of a measurement that stands for a time, s, such as a LiDAR's for one revolution."""
        return max(self.sent, self.measured - lasts)

    def complaint(self, limit: float, *, lasts: float = 0.0, sent: float = math.inf) -> str:
        """Return why a message does not count, or an empty text, by its largest ages since measurement and since sending, s."""
        if self.refusal:
            return self.refusal
        if self.since(lasts) > limit:
            why = f"{self.measured:.2f} s old by {self.by}, more than {limit:g} s"
        elif self.sent > sent:
            why = f"sent {self.sent:.2f} s ago, more than {sent:g} s"
        else:
            return ""
        return f"{why}: it is late, or its clock is behind: {SYNCHRONIZE}"


class SystemClock:
    """The system clock compared with the steady one."""

    def __init__(self) -> None:
        self.offsets: list[tuple[float, float]] = []
        """Offsets from the steady clock, s, current one last, with the time until which they count."""
        self.steps = 0
        """Number of steps of the clock whose old offset no longer counts."""

    def look(self, *, system: float, steady: float) -> None:
        """Compare the clocks; call this at least every 20 ms."""
        offset = system - steady
        others = [(earlier, min(until, steady + HOLD)) for earlier, until in self.offsets if abs(earlier - offset) > STEP]
        kept = [entry for entry in others if entry[1] > steady]
        self.steps += len(others) - len(kept)
        self.offsets = [*kept, (offset, math.inf)]


class _Sender:
    """A clock by which an input's messages are stamped, compared with this computer's."""

    def __init__(self) -> None:
        self.peak, self._at, self._until = -math.inf, 0.0, -math.inf

    def hear(self, stamp: float, now: float, offset: float) -> None:
        """Take a stamp that was read at a steady time, when the system clock had an offset from it, s."""
        lead, before = stamp - now, self._faded(now)
        if lead - max(before, offset) > JUMP:
            self._until = now + SETTLE
        self.peak, self._at = max(lead, before), now

    def _faded(self, now: float) -> float:
        return self.peak - DRIFT * (now - self._at)

    def lead(self, now: float, offset: float) -> float:
        """Return the lead before this computer's clock, s; negative if the clock is behind, or all messages are late."""
        return self._faded(now) - offset

    def is_unsettled(self, now: float) -> bool:
        """Return whether the lead has just jumped."""
        return now < self._until


class Ages:
    """The ages of one input's messages, by this computer's clock."""

    def __init__(self, clock: SystemClock) -> None:
        self._clock = clock
        self.begin()

    def begin(self) -> None:
        """Estimate the leads of the senders' clocks anew."""
        self._senders = {"its header's stamp": _Sender(), "DDS's source time": _Sender()}
        self._steps = self._clock.steps

    def age_of(self, info: Mapping[str, Any], header: Any, now: float) -> Age:
        """Return the age of a message at a steady time, s, by its info from rclpy and its header, if that counts."""
        stamp = 0.0 if header is None else header.stamp.sec + header.stamp.nanosec * 1e-9
        source, arrival = (info[name] * 1e-9 for name in ("source_timestamp", "received_timestamp"))
        return self.age(steady=now, source=source, arrival=arrival, header=stamp)

    def age(self, *, steady: float, source: float, arrival: float, header: float) -> Age:
        """Return the age of a message at a steady time, from its times on the system clock, s; 0 means unknown."""
        if self._steps != self._clock.steps:
            self.begin()
        offset = self._clock.offsets[-1][0]
        came = max(0.0, self._oldest(arrival, steady)) if arrival else 0.0
        stamps = {by: stamp for by, stamp in zip(self._senders, (header, source), strict=True) if self._is_time(stamp, steady)}
        ages: dict[str, float] = {}
        for by, stamp in stamps.items():
            sender, ahead = self._senders[by], stamp - steady - offset
            if ahead <= BOUND:
                sender.hear(stamp, steady, offset)
            if ahead > BOUND or sender.is_unsettled(steady):
                why = f"more than {BOUND:g} s" if ahead > BOUND else f"which is new: it counts in {SETTLE:g} s"
                refusal = f"by {by} its clock is {max(ahead, sender.lead(steady, offset)):.2f} s ahead, {why}: {SYNCHRONIZE}"
                return Age(math.inf, math.inf, True, by, refusal)
            ages[by] = max(self._oldest(stamp, steady), steady + sender.lead(steady, 0.0) - stamp)
        measured, by = max([(came, "its arrival"), *((age, by) for by, age in ages.items())])
        sent = max(came, ages.get("DDS's source time", measured))
        stamped = ages.get("its header's stamp")
        if stamped is not None and self._senders["its header's stamp"].lead(steady, offset) <= JUMP and stamped < sent:
            sent, measured, by = max(came, stamped), max(came, stamped), "its header's stamp"
        return Age(sent, measured, bool(stamps), by)

    def _oldest(self, stamp: float, steady: float) -> float:
        """Return the age of a time by the system clock, s."""
        return max(steady + offset for offset, _ in self._clock.offsets) - stamp

    def _is_time(self, stamp: float, steady: float) -> bool:
        """Return whether a time is known, and of this computer's epoch."""
        return stamp != 0.0 and (stamp < EPOCH) == (steady + self._clock.offsets[-1][0] < EPOCH)

    def figures(self) -> str:
        """Return the lead of the clock by which messages are stamped, for the diagnostics; negative if it is behind or late."""
        leads = [sender.peak - self._clock.offsets[-1][0] for sender in self._senders.values()]
        return next((f", clock {lead:+.2f} s" for lead in leads if lead > -math.inf), "")


def read_clocks() -> tuple[float, float]:
    """Return the system time and the steady time, s; the latter includes the machine's sleep where that is supported."""
    return time.time(), time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))
