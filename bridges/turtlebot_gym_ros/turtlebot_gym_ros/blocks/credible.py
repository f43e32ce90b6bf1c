"""What a filter believes of its odometry and of external poses. Does not depend on ROS and takes times as arguments.

A refused measurement is not used at all. Refused odometry leaves the filter without a step, so that no estimate is published
and the robot stops; a refused fix leaves it with its odometry.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import MAX_FIX_AGE, FilterTuning
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import Belief, Fix, Odometry, Pose

MARGIN = 2.0
"""Multiple of a robot's limits beyond which its odometry is wrong: wheels overshoot, and a preset may be that of a slower
sister model, by 1.45 at most; what is worth refusing, such as a wrong unit, is farther off."""
SPREAD = 6.0
"""Standard deviations that noise may make of a jump; a pose exceeds them once in 6e7 times, and no filter notices less."""
JUMP, TURN = 0.1, 0.2
"""Jumps that are never refused, m and rad: late stamps, and a heading's glitch."""
LEAST_VARIANCE = 1e-6
"""Least variance of a fix, (1 mm)^2 or (1 mrad)^2; smaller ones are raised to it, as nothing outside a robot knows more."""
MOST_VARIANCE = 1e4
"""Variance of a fix from which it says nothing, (100 m)^2."""
FARTHEST = 1e5
"""Distance from the origin beyond which no robot is, m."""
CERTAIN = {2: 27.63, 3: 30.66}
"""Normalized squared innovation that a consistent filter exceeds once in a million fixes, by degrees of freedom: twice a year
for a fix each 10 s."""


class Credible:
    """The tests of a filter's odometry.

    Each pose must be reachable from the last accepted one. The way back from a refusal is a reset, or a person's pose: time
    alone is not, since a robot that is elsewhere has not driven there.

    Args:
        robot: The robot's limits.
        tuning: Its R is the noise of the measured pose.
        longest: Longest time for which the robot may have driven unseen, s.
    """

    def __init__(self, robot: Robot, tuning: FilterTuning, *, longest: float) -> None:
        self._robot, self._longest = robot, longest
        self._noise = SPREAD * math.sqrt(2.0 * max(tuning.R[:2])), SPREAD * math.sqrt(2.0 * tuning.R[2])
        self.begin(None)

    def begin(self, at: Pose | None) -> None:
        """Start from a pose; None for the next one, whatever it is."""
        self._last, self._since = at, 0.0

    def refusal(self, odometry: Odometry, dt: float) -> str:
        """Return why a message is refused that is ``dt`` later than the one before, s, or an empty text."""
        robot, (v, omega) = self._robot, odometry.twist
        if abs(v) > MARGIN * robot.max_linear or abs(omega) > MARGIN * robot.max_angular:
            limits = f"{robot.max_linear:g} m/s and {robot.max_angular:g} rad/s"
            return f"a twist of {v:g} m/s and {omega:g} rad/s is more than {MARGIN:g} times the robot's limits, {limits}"
        self._since = min(self._since + dt, self._longest)
        if not odometry.measured:
            return ""
        if self._last is not None:
            away = math.hypot(odometry.pose.x - self._last.x, odometry.pose.y - self._last.y)
            turned = abs(wrap(odometry.pose.theta - self._last.theta))
            far, wide = (
                MARGIN * most * self._since + least + noise
                for most, least, noise in zip((robot.max_linear, robot.max_angular), (JUMP, TURN), self._noise, strict=True)
            )
            if away > far or turned > wide:
                jump = f"a jump of {away:.1f} m and {turned:.1f} rad is more than the robot can have driven"
                return f"{jump}: are there two sources, or was it moved? A reset or a pose on initialpose goes on from here"
        self.begin(odometry.pose)
        return ""


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
        S = np.array((
            (P.xx + xx, P.xy + xy, P.xt + xt), (P.xy + xy, P.yy + yy, P.yt + yt), (P.xt + xt, P.yt + yt, P.tt + tt)
        ))[:n, :n]  # fmt: skip
        squared = float(off @ np.linalg.solve(S, off))
        if not squared <= CERTAIN[n]:
            away = f"{math.hypot(off[0], off[1]):.2f} m from the estimate"
            return f"{away}, with a normalized squared innovation of {squared:.3g}, above {CERTAIN[n]}"
        return ""


def bounded(fix: Fix) -> Fix:
    """Return a fix with variances of at least `LEAST_VARIANCE`."""
    return fix._replace(R=tuple(max(variance, LEAST_VARIANCE) for variance in fix.R))
