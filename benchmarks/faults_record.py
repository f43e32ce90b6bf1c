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

AGE = 0.6
"""Longest time after the newest measurement at which a motion may be published, s: 0.5 s, and 0.1 s for a guard that loses its
processor between decision and message."""
OVERDUE = 0.1
"""Longest time for which a motion may be in force later than that, s."""
ZONE = 0.02
"""Distance between footprint and wall to which the robot may not move, m: less than half of the guard's margin."""
WAY, TIME = 0.25, 1.0
"""Motion after a lie could first be seen that is unsafe, m and s."""
LONGEST = ("longest_lag", "longest_hold", "longest_overdue", "longest_stop")
"""Figures of each fault, s, of which the longest counts."""
UNSEEN = 2.0
"""Time without a look at the robot after which nothing is known of it, s."""


class Heard(NamedTuple):
    """A command for the wheels."""

    sent: float
    """Time at which it was published, by DDS's source time, s."""
    arrived: float
    """Time at which it arrived, s; a motion whose writer was suspended arrives late."""
    v: float
    omega: float

    @property
    def moves(self) -> bool:
        """Whether it is a motion."""
        return (self.v, self.omega) != (0.0, 0.0)


class Held(NamedTuple):
    """A motion in force."""

    begin: float
    end: float
    """Time at which the next command arrived, or the watch ended, s."""
    v: float
    omega: float


class Record:
    """What was published, measured and driven, each with its time."""

    def __init__(self) -> None:
        self.heard: list[Heard] = []
        """Commands for the wheels, in the order of their arrival."""
        self.measured: list[tuple[float, float]] = []
        """Times at which what the robot may move on was sent, s, each with the newest time at which such was measured."""
        self.clearances: list[tuple[float, float]] = []
        """Times at which the robot moved in truth, s, each with its distance to the nearest wall, m."""
        self.looks: list[float] = []
        """Times at which the robot was looked at, s."""
        self.began: float | None = None
        """Time of a fault that is itself a reason to stop, s."""
        self.trusts_source = True
        """Whether the guard's clock is the judge's; if not, commands are judged by their arrival."""

    def hear(self, sent: float, arrived: float, v: float, omega: float) -> None:
        """Record a command for the wheels."""
        self.heard.append(Heard(sent if self.trusts_source else arrived, arrived, v, omega))

    def rests_on(self, measured: float) -> None:
        """Record that something was sent which the robot may move on until 0.6 s after it was measured."""
        newest = self.measured[-1][1] if self.measured else -math.inf
        self.measured.append((time.time(), max(newest, measured)))

    def motions(self, since: float) -> list[float]:
        """Return the times at which motions were published."""
        return [command.sent for command in list(self.heard) if command.sent > since and command.moves]

    def in_force(self, since: float, until: float) -> list[Held]:
        """Return the motions in force between two times, each cut at them."""
        arrived = [command for command in list(self.heard) if command.arrived < until]
        ends = [*(after.arrived for _, after in pairwise(arrived)), until]
        return [
            Held(max(command.arrived, since), end, command.v, command.omega)
            for command, end in zip(arrived, ends, strict=True)
            if command.moves and end > since
        ]

    def obeyed(self, since: float, until: float) -> list[tuple[float, float, float]]:
        """Return the commands that the robot obeys between two times, v, m/s, and omega, rad/s, each with how long, s."""
        before = next(
            (command for command in reversed(list(self.heard)) if command.arrived <= since), Heard(0.0, 0.0, 0.0, 0.0)
        )
        commands = [
            before._replace(arrived=since),
            *(command for command in list(self.heard) if since < command.arrived <= until),
        ]
        ends = [*(command.arrived for command in commands[1:]), until]
        return [(command.v, command.omega, end - command.arrived) for command, end in zip(commands, ends, strict=True)]

    def lasts(self, since: float, until: float) -> float:
        """Return for how long motions were in force between two times, s."""
        return sum(held.end - held.begin for held in self.in_force(since, until))

    def travelled(self, since: float, until: float) -> tuple[float, float]:
        """Return the way that was commanded between two times, m, and when its last motion ended, s after the first time."""
        held = self.in_force(since, until)
        return sum((end - begin) * abs(v) for begin, end, v, _ in held), max((each.end - since for each in held), default=0.0)

    def stop(self, until: float) -> float:
        """Return the time from a fault that is a reason to stop to the end of the motion in force, s; 0 if the robot stood.

        It is infinite if no zero came.
        """
        if self.began is None:
            return 0.0
        first = next((held for held in self.in_force(self.began, until)), None)
        if first is None or first.begin > self.began:
            return 0.0
        zeros = [command.arrived for command in list(self.heard) if self.began < command.arrived <= until and not command.moves]
        return min(zeros, default=math.inf) - self.began

    def age(self, at: float) -> float:
        """Return how old the newest measurement was that had been sent until a time, s."""
        measured = list(self.measured)
        return at - measured[bisect_right(measured, at, key=lambda entry: entry[0]) - 1][1]

    def lag(self, since: float) -> float:
        """Return the longest time between the newest measurement that had been sent and the publishing of a motion, s."""
        return max(map(self.age, self.motions(since)), default=0.0)

    def overdue(self, since: float, until: float) -> float:
        """Return for how long motions were in force between two times later than `AGE` after the newest measurement, s."""
        total, measured = 0.0, list(self.measured)
        for begin, end, *_ in self.in_force(since, until):
            inside = [sent for sent, _ in measured if begin < sent < end]
            for first, last in pairwise([begin, *inside, end]):
                total += max(0.0, last - max(first, first - self.age(first) + AGE))
        return total

    def hold(self, since: float, until: float) -> float:
        """Return the longest time from the newest measurement to the end of a motion in force, s."""
        heard = [command for command in list(self.heard) if since < command.arrived <= until]
        ends = [after.arrived for before, after in pairwise(heard) if before.moves and not after.moves]
        return max(map(self.age, ends), default=0.0)

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
        way, lasted = self.travelled(since, until)[0], self.lasts(since, until)
        return [
            *([f"it moved {way:.2f} m after the lie could be seen"] if way > WAY else []),
            *([f"it moved for {lasted:.2f} s after the lie could be seen"] if lasted > TIME else []),
        ]

    def figures(self, since: float, until: float) -> dict[str, float]:
        """Return how late everything was between two times, s, and how near to a wall the robot moved, m."""
        late = self.lag(since), self.hold(since, until), self.overdue(since, until), self.stop(until)
        return {**dict(zip(LONGEST, late, strict=True)), "nearest": self.nearest(since)}

    def forget(self) -> None:
        """Forget all but the end of what was recorded."""
        self.began, self.trusts_source = None, True
        for entries in (self.heard, self.measured, self.clearances, self.looks):
            del entries[:-100]
