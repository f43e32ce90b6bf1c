"""What a filter believes of external poses, and says of its odometry. Does not depend on ROS and takes times as arguments.

A refused fix is not used at all, and leaves the filter with its odometry.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import MAX_FIX_AGE
from turtlebot_gym.values import Belief, Fix
from turtlebot_gym_ros.node.block import FARTHEST, Disagreement, Output

LEAST_VARIANCE = 1e-6
"""Least variance of a fix, (1 mm)^2 or (1 mrad)^2; smaller ones are raised to it, as nothing outside a robot knows more."""
MOST_VARIANCE = 1e4
"""Variance of a fix from which it says nothing, (100 m)^2."""
DISAGREEMENT = Output(topic="disagreement", type=Disagreement, latched=True)
CERTAIN = {2: 27.63, 3: 30.66}
"""Normalized squared innovation that a consistent filter exceeds once in a million fixes, by degrees of freedom: twice a year
for a fix each 10 s."""


class Gate:
    """The tests of fixes, by the beliefs at their stamps."""

    def __init__(self) -> None:
        self._beliefs: deque[tuple[float, Belief]] = deque()

    def remember(self, time: float, belief: Belief) -> None:
        """Store the belief of a time, s, for as long as a fix may be late; it replaces an earlier one of that time."""
        if self._beliefs and self._beliefs[-1][0] == time:
            self._beliefs.pop()
        self._beliefs.append((time, belief))
        while self._beliefs[0][0] < time - MAX_FIX_AGE - 1e-6:
            self._beliefs.popleft()

    def forget(self) -> None:
        """Forget all beliefs: the next fix is not compared with any."""
        self._beliefs.clear()

    def refusal(self, fix: Fix, stamp: float) -> str:
        """Return why a fix that was measured at a time, s, is refused, or an empty text."""
        if max(abs(fix.pose.x), abs(fix.pose.y)) > FARTHEST:
            return f"it is at ({fix.pose.x:g}, {fix.pose.y:g}), farther than {FARTHEST:g} m from the origin"
        if max(fix.R[:2]) > MOST_VARIANCE:
            return f"its variance of {max(fix.R[:2]):g} m^2 says nothing"
        if not self._beliefs:
            return ""
        _, (mean, P) = min(self._beliefs, key=lambda each: abs(each[0] - stamp))
        n = 3 if fix.R[2] < math.inf else 2
        off = np.array((fix.pose.x - mean.x, fix.pose.y - mean.y, wrap(fix.pose.theta - mean.theta)))[:n]
        (xx, yy, tt), (xy, xt, yt) = fix.R, fix.cross
        rows = (P.xx + xx, P.xy + xy, P.xt + xt), (P.xy + xy, P.yy + yy, P.yt + yt), (P.xt + xt, P.yt + yt, P.tt + tt)
        S = np.array(rows)[:n, :n]
        squared = float(off @ np.linalg.solve(S, off))
        if not squared <= CERTAIN[n]:
            away = f"{math.hypot(off[0], off[1]):.2f} m from the estimate"
            return f"{away}, with a normalized squared innovation of {squared:.3g}, above {CERTAIN[n]}"
        return ""


class Credibility:
    """What a filter says of its odometry on the topic ``disagreement``: the cause of its `Agreement`, when that changes."""

    def __init__(self) -> None:
        self._told = ""

    def news(self, cause: str) -> dict[str, Disagreement]:
        """Return the output with a cause, or an empty text, if that is news."""
        news, self._told = cause != self._told, cause
        return {"disagreement": Disagreement(cause)} if news else {}

    @property
    def fault(self) -> str | None:
        """Message for users if odometry is not believed, else None."""
        how = "Enable the controller, or set a pose on initialpose"
        return f"odometry is not believed: {self._told}. {how}" if self._told else None


def bounded(fix: Fix) -> Fix:
    """Return a fix with variances of at least `LEAST_VARIANCE`."""
    return fix._replace(R=tuple(max(variance, LEAST_VARIANCE) for variance in fix.R))
