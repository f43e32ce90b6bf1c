"""What the judge of the faults has recorded, and what follows from it."""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from itertools import pairwise


class Record:
    """What was published, measured and driven, each with its time."""

    def __init__(self) -> None:
        self.heard: list[tuple[float, float, float]] = []
        """Time at which each command for the wheels was published, s, with its v, m/s, and omega, rad/s."""
        self.arrived: list[tuple[float, bool]] = []
        """Time at which each of them arrived, s, and whether it is a motion: one whose writer was suspended arrives late."""
        self.measured: list[tuple[float, float]] = []
        """Times at which what the robot may move on was sent, s, each with the newest time at which such was measured."""
        self.moving_forward: list[tuple[float, float]] = []
        """Times at which the robot should move forward, s, each with its distance to the wall ahead, m."""
        self.began: float | None = None
        """Time of a fault that is itself a reason to stop, s."""

    def rests_on(self, measured: float) -> None:
        """Record that something was sent which the robot may move on until 0.6 s after it was measured."""
        newest = self.measured[-1][1] if self.measured else -math.inf
        self.measured.append((time.time(), max(newest, measured)))

    def motions(self, since: float) -> list[float]:
        """Return the times at which motions were published."""
        return [at for at, v, omega in list(self.heard) if at > since and (v, omega) != (0.0, 0.0)]

    def moves(self, at: float) -> bool:
        """Return whether the last command that was published until a time is a motion."""
        return max((entry for entry in list(self.heard) if entry[0] <= at), default=(0.0, 0.0, 0.0))[1:] != (0.0, 0.0)

    def stop(self) -> float:
        """Return the time from a fault that is a reason to stop to the next zero, s; 0 if the robot stood."""
        began = self.began
        if began is None or not self.moves(began):
            return 0.0
        return min((at for at, *command in list(self.heard) if at > began and command == [0.0, 0.0]), default=math.inf) - began

    def age(self, at: float) -> float:
        """Return how old the newest measurement was that had been sent until a time, s."""
        measured = list(self.measured)
        return at - measured[bisect_right(measured, at, key=lambda entry: entry[0]) - 1][1]

    def lag(self, since: float) -> float:
        """Return the longest time between the newest measurement that had been sent and a motion, s."""
        return max(map(self.age, self.motions(since)), default=0.0)

    def hold(self, since: float) -> float:
        """Return the longest time from the newest measurement to the zero that ends its motion, s."""
        heard = sorted(message for message in list(self.heard) if message[0] > since)
        ends = [at for (_, *before), (at, *now) in pairwise(heard) if before != [0.0, 0.0] == now]
        return max(map(self.age, ends), default=0.0)

    def revived(self, since: float, age: float) -> float:
        """Return the longest time from a motion's arrival to the next zero's, s, if it arrived so long, s, after a measurement.

        Such a motion is not late by its source time: its writer was suspended between reading the clock and sending.
        """
        arrived, longest = [message for message in list(self.arrived) if message[0] > since], 0.0
        for k, (at, moves) in enumerate(arrived):
            if moves and self.age(at) > age:
                longest = max(longest, next((end for end, on in arrived[k:] if not on), math.inf) - at)
        return longest

    def nearest(self, since: float) -> float:
        """Return the least distance to the wall ahead at which the robot still moved towards it, m."""
        return min((gap for at, gap in list(self.moving_forward) if at > since), default=math.inf)

    def moving(self, since: float) -> int:
        """Return the number of motions from a time on, with the one that is under way then."""
        return self.moves(since) + len(self.motions(since))

    def forget(self) -> None:
        """Forget all but the end of what was recorded."""
        self.began = None
        for entries in (self.heard, self.arrived, self.measured, self.moving_forward):
            del entries[:-100]
