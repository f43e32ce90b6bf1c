"""The judge of the faults: what it has recorded, and what follows from that; it fails closed.

A TurtleBot3 holds its last command for ever. So motion counts while it is *in force*, from the arrival of its command to the
arrival of the next one, and not only when it is published: a zero that is missing is motion until the end of the watch.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from itertools import pairwise
from typing import NamedTuple

AGE, OVERDUE = 0.6, 0.1
"""Longest time after the newest measurement at which a motion may be published, s: 0.5 s, and 0.1 s for a guard that loses its
processor between decision and message; longest time for which one may be in force later than that, s."""
STANDS = AGE + OVERDUE
"""Time after the end of what it moves on at which the robot stands, s."""
ZONE = 0.02  # m, between footprint and wall, to which the robot may not move: less than half of the guard's margin
WAY, TIME, UNSEEN = 0.25, 1.0, 2.0
"""Motion after a lie could first be seen that is unsafe, m and s; time without a look after which nothing is known, s."""


class Heard(NamedTuple):
    """A command for the wheels: when it was published, by DDS's source time, and arrived, late from a suspended writer, s."""

    sent: float
    arrived: float
    v: float
    omega: float


class Held(NamedTuple):
    """A command in force, from its arrival to that of the next one, s."""

    begin: float
    end: float
    v: float
    omega: float


class Record:
    """What was published, measured and driven, each with its time."""

    def __init__(self) -> None:
        self.heard, self.looks = list[Heard](), list[float]()
        """Commands for the wheels, in the order of their arrival, and times at which the robot was looked at, s."""
        self.measured: list[tuple[float, float]] = []
        """Times at which what the robot may move on was sent, s, each with the newest time at which such was measured."""
        self.clearances: list[tuple[float, float]] = []
        """Times at which the robot moved in truth, s, each with its distance to the nearest wall, m."""
        self.trusts_source = True
        """Whether the guard's clock is the judge's; if not, commands are judged by their arrival."""

    def hear(self, sent: float, arrived: float, v: float, omega: float) -> None:
        """Record a command for the wheels."""
        self.heard.append(Heard(sent if self.trusts_source else arrived, arrived, v, omega))

    def rests_on(self, measured: float) -> None:
        """Record that something was sent which the robot may move on until 0.6 s after it was measured."""
        newest = self.measured[-1][1] if self.measured else -math.inf
        self.measured.append((time.time(), max(newest, measured)))

    def held(self, since: float, until: float) -> list[Held]:
        """Return the commands in force between two times, each cut at them."""
        arrived = [command for command in list(self.heard) if command.arrived < until]
        ends = [*(command.arrived for command in arrived[1:]), until]
        return [
            Held(max(command.arrived, since), end, command.v, command.omega)
            for command, end in zip(arrived, ends, strict=False)  # without a command there is only an end
            if end > since
        ]

    def in_force(self, since: float, until: float) -> list[Held]:
        """Return the motions in force between two times, each cut at them."""
        return [held for held in self.held(since, until) if held.v or held.omega]

    def lasts(self, since: float, until: float) -> float:
        """Return for how long motions were in force between two times, s."""
        return sum(held.end - held.begin for held in self.in_force(since, until))

    def age(self, at: float) -> float:
        """Return how old the newest measurement was that had been sent until a time, s."""
        measured = list(self.measured)
        return at - measured[bisect_right(measured, at, key=lambda entry: entry[0]) - 1][1]

    def lag(self, since: float) -> float:
        """Return the longest time between the newest measurement that had been sent and the publishing of a motion, s."""
        published = [command.sent for command in list(self.heard) if command.sent > since and (command.v or command.omega)]
        return max(map(self.age, published), default=0.0)

    def overdue(self, since: float, until: float) -> float:
        """Return for how long motions were in force between two times later than `AGE` after the newest measurement, s."""
        total, measured = 0.0, list(self.measured)
        for begin, end, *_ in self.in_force(since, until):
            inside = [sent for sent, _ in measured if begin < sent < end]
            for first, last in pairwise([begin, *inside, end]):
                total += max(0.0, last - max(first, first - self.age(first) + AGE))
        return total

    def nearest(self, since: float) -> float:
        """Return the least distance to a wall at which the robot still moved, m."""
        return min((gap for at, gap in list(self.clearances) if at > since), default=math.inf)

    def unseen(self, since: float, until: float) -> float:
        """Return the longest time without a look at the robot, s."""
        looks = [since, *(at for at in list(self.looks) if since < at < until), until]
        return max(later - earlier for earlier, later in pairwise(looks))

    def reasons(self, since: float, until: float) -> list[str]:
        """Return why what happened between two times was unsafe whatever the fault was; none if it was safe."""
        lag, overdue, nearest = self.lag(since), self.overdue(since, until), self.nearest(since)
        return [
            *([f"a motion was published {lag:.2f} s after the newest measurement"] if lag > AGE else []),
            *([f"motion was in force for {overdue:.2f} s without a fresh measurement"] if overdue > OVERDUE else []),
            *([f"the robot moved {nearest:.3f} m from a wall"] if nearest < ZONE else []),
        ]

    def strays(self, since: float, until: float) -> list[str]:
        """Return why the motion was unsafe after a lie that could first be seen at a time; none if it was safe."""
        way = sum((held.end - held.begin) * abs(held.v) for held in self.in_force(since, until))
        lasted = self.lasts(since, until)
        return [
            *([f"it moved {way:.2f} m after the lie could be seen"] if way > WAY else []),
            *([f"it moved for {lasted:.2f} s after the lie could be seen"] if lasted > TIME else []),
        ]

    def forget(self) -> None:
        """Forget all but the end of what was recorded."""
        self.trusts_source = True
        for entries in (self.heard, self.measured, self.clearances, self.looks):
            del entries[:-100]
