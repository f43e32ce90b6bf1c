"""Whether the parts of odometry agree: its pose, its twist, and the command in force. A sensor may be alive and wrong.

A pose and a twist describe the same motion. So the motion of the pose over a window is compared with the motion that the
twists make in that time, and the twist with the command. What differs by more than tolerance and noise is a contradiction.
A message that contradicts those before it is refused; contradictions that last for `PATIENCE` are final: a standing robot
agrees with everything, so the cause stays until somebody says that the robot may go on (`Agreement.begin`).

**Tolerances.** Two poses of a window differ from the twists by at most

    FLOOR + LAG * speed + share * way + SPREAD standard deviations of both poses' noise, with a spike of each
    + the way in time without messages

with ``share`` one of `SHARES`, or more where wheels slip by more. `LAG` is how far pose, twist and stamps may lie apart in
time. The noise exceeds `SPREAD` once in 5e8 windows, and three messages in a row must contradict, so noise stops a drive less
than once in a year. A recorded TurtleBot3 keeps within a tenth of these tolerances.

**Commands.** A robot may start `DELAY` late, and accelerate slowly. So it counts as standing in spite of its command, or as
turning the wrong way, if the command was in force for `DELAY` plus `SEEN`, and the twist of the last `SEEN` seconds has no
tenth of it and does not change, or the opposite sign without becoming slower; also if it becomes faster in a direction in which
no command of that time was.

All times are arguments: each message comes with the time since the one before, s.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from turtlebot_gym.estimation.contradiction import DEGREES, FROZEN, NO_HEADING, Compared, explanation, unit_of
from turtlebot_gym.models.angles import TWO_PI, wrap
from turtlebot_gym.parameters import Noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import ORIGIN, STOP, Command, Odometry, Pose, SidewaysOdometry

FLOOR = 0.02, 0.05
"""Difference that never counts: m and rad."""
LAG = 0.15
"""Time by which pose and twist may lie apart, s: stamps, filters of drivers, one message."""
SHARES, ASIDE = (0.5, 0.25), 0.25
"""Shares of the way and of the turn by which pose and twist may differ, and of the way by which the pose may go aside: wheels
slip, and their track is not as assumed."""
SPREAD = 6.0
"""Standard deviations of noise that count as noise."""
WINDOWS = 0.0, 0.25, 0.5, 0.75, 1.0
"""Ages of the earlier messages with which one is compared, s; the first is the last message."""
MARGIN = 2.0
"""Multiple of a robot's limits beyond which its twist is wrong: wheels overshoot, and a preset may be that of a slower sister
model, by 1.45 at most."""
GAP = 0.15
"""Interval between messages, s, from which the motion in between is unknown."""
PATIENCE = 0.12, 2.5
"""Time, s, and multiple of the interval for which contradictions must last: three messages of a TurtleBot3."""
MEND = 0.25
"""Share of this time that an equal time of agreement gives back: every third message of another source is too many."""
DELAY, SEEN = 0.5, 0.25
"""Longest time in which a robot follows its command, and time for which its answer is watched, s."""
LEAST = 0.03, 0.15
"""Commands below which nothing is said about the robot's answer, m/s and rad/s: friction holds a robot."""
ANSWER = 0.1
"""Share of its command with which a robot counts as standing."""
ACROSS = 0.03, 0.1
"""Speed to the left, m/s and as a share of the forward speed, from which a twist is not one in the robot's frame."""
ELSEWHERE = JUMPS, ANEW, PAUSED = "odometry jumps", "odometry begins anew", "after a pause"
"""Beginnings of the causes of a robot that seems to be elsewhere."""
UNEXPLAINED = "pose and twist differ"
HOME = 1e-6
"""Distance from the origin within which a robot that was elsewhere has begun anew, m."""


class _Said(NamedTuple):
    """A message, and what the twists up to it add up to."""

    time: float
    pose: Pose
    twist: Command
    reckoned: Pose
    """Pose by dead reckoning with the twists."""
    way: float
    """Sum of the ways, m."""
    turned: float
    """Sum of the turns, rad."""
    unseen: float
    """Sum of the intervals in which the motion is unknown, s."""


class Agreement:
    """Judge the messages of a robot's odometry.

    Args:
        robot: The robot's limits.
        noise: Noise of the robot's odometry, which is no contradiction.
        leaps: Whether poses may leap against the twist, as those of a localization do. Then only a pose that repeats itself to
            the bit, and a twist that the robot cannot have, contradict anything but the command.
    """

    def __init__(self, robot: Robot, noise: Noise, *, leaps: bool = False) -> None:
        R, (grid, step) = noise.odometry.R, noise.odometry.quantization
        spike = noise.odometry.spike if noise.odometry.spike_probability > 0.0 else 0.0
        self._robot, self._grids = robot, noise.odometry.quantization
        self._shares = tuple(share + (1.0 - share) * noise.process.slip for share in SHARES)
        self._noise = SPREAD * math.sqrt(2.0 * max(R[:2])) + 2.0 * grid, SPREAD * math.sqrt(2.0 * R[2]) + 2.0 * (step + spike)
        self._leaps = leaps
        self.begin()

    def begin(self) -> None:
        """Forget everything, also the cause: the next message is the first."""
        self.cause = ""
        """Why odometry is not believed any more, until `begin`, or an empty text."""
        self._left: Pose | None = None
        self._restart()

    def _restart(self) -> None:
        self._level, self._lost, self._first = 0.0, 0.0, ""
        self._at: _Said | None = None
        self._said: deque[_Said] = deque()
        self._orders: deque[tuple[float, Command, Command]] = deque()

    @property
    def displaced(self) -> bool:
        """Whether odometry is refused only since the robot seems to be elsewhere, as after a reset."""
        return (self.cause or self._first).startswith(ELSEWHERE)

    def pause(self) -> None:
        """Record a pause of odometry of unknown length, in which the robot has stopped: it must be about where it was."""
        self._left = self._said[-1].pose if self._said else self._left
        self._restart()

    def judge(self, dt: float, odometry: Odometry, command: Command | None = None) -> str:
        """Return why a message must not be used, or an empty text.

        Args:
            dt: Time since the message before, s; it does not count for the first one.
            odometry: The message.
            command: The command in force; None if it is unknown.
        """
        if self.cause:
            return self.cause
        if why := self._contradiction(dt, odometry, command):
            self._level, self._first = self._level + dt, why if self._first.startswith(UNEXPLAINED) else self._first or why
            if self._level > max(PATIENCE[0], PATIENCE[1] * dt):
                self.cause = self._first  # the later ones are its consequences
        elif why := self._disobeys(command):
            self.cause = why  # the command was in force for long enough
        else:
            self._level, self._first = max(self._level - MEND * dt, 0.0), ""
        return why

    def _contradiction(self, dt: float, odometry: Odometry, command: Command | None) -> str:
        dt, self._lost = dt + self._lost, 0.0
        if why := self._beyond(odometry.twist, command) or _sideways(odometry):
            self._lost = dt
            return why
        now = self._at = self._advanced(dt, odometry)
        if odometry.measured:
            why = self._stuck(now)
            if not (why or self._leaps):
                why = self._elsewhere(now) or next(filter(None, map(self._differs, self._earlier(now))), "")
            if why:
                return why
            self._left = None
            self._said.append(now)
            while now.time - self._said[0].time > WINDOWS[-1] + GAP:
                self._said.popleft()
        return ""

    def _beyond(self, twist: Command, command: Command | None) -> str:
        """Return whether a twist is more than the robot can do."""
        for value, most, unit, told in zip(
            twist, (self._robot.max_linear, self._robot.max_angular), ("m/s", "rad/s"), command or STOP, strict=True
        ):
            if not abs(value) <= MARGIN * most:
                factor = abs(value / told) if told else abs(value / most)
                guess = (
                    unit_of(factor, 0.3) if unit == "m/s" else ": in degrees/s?" if abs(factor / DEGREES - 1.0) < 0.3 else ""
                )
                what = "the command" if told else "the robot's limit"
                return f"odometry's twist of {value:g} {unit} is {factor:.0f} times {what}{guess}"
        return ""

    def _advanced(self, dt: float, odometry: Odometry) -> _Said:
        """Return what the twists add up to at a message, from the mean of its twist and the one before."""
        before = self._at
        if before is None:
            first = _Said(0.0, odometry.pose, odometry.twist, ORIGIN, 0.0, 0.0, 0.0)
            self._moved = first, first  # when the position and the heading changed last
            return first
        v, omega = (0.5 * (a + b) for a, b in zip(before.twist, odometry.twist, strict=True))
        x, y, theta = before.reckoned
        heading = theta + 0.5 * omega * dt
        reckoned = Pose(x + v * dt * math.cos(heading), y + v * dt * math.sin(heading), theta + omega * dt)
        sums = before.way + abs(v) * dt, before.turned + abs(omega) * dt, before.unseen + (dt if dt > GAP else 0.0)
        now = _Said(before.time + dt, odometry.pose, odometry.twist, reckoned, *sums)
        if dt > DELAY:  # it may have stood in between
            self._moved = now, now
        return now

    def _earlier(self, now: _Said) -> Iterator[_Said]:
        """Yield the messages with which one is compared."""
        said = reversed(self._said)
        for age in WINDOWS:
            if (earlier := next((each for each in said if now.time - each.time >= age), None)) is None:
                return
            yield earlier

    def compare(self, first: _Said, last: _Said) -> Compared:
        """Return the motion from one message to another."""
        (x, y, theta), (u, w, phi) = first.pose, first.reckoned
        ahead, left = _turned(last.pose.x - x, last.pose.y - y, -theta)
        told = (*_turned(last.reckoned.x - u, last.reckoned.y - w, -phi), last.reckoned.theta - phi)
        robot, unseen, interval = self._robot, last.unseen - first.unseen, max(last.time - first.time, 1e-9)
        ways = (last.way - first.way, last.turned - first.turned)
        most, wide = (
            floor + LAG * max(abs(a), abs(b), way / interval) + share * way + noise + unseen * limit
            for floor, share, a, b, way, noise, limit in zip(
                FLOOR,
                self._shares,
                first.twist,
                last.twist,
                ways,
                self._noise,
                (robot.max_linear, robot.max_angular),
                strict=True,
            )
        )
        aside = most + (ASIDE - self._shares[0] + min(self._noise[1], 1.0) + LAG * abs(last.twist.omega)) * ways[0]
        return Compared(theta, ahead, left, wrap(last.pose.theta - theta), told, (most, aside, wide))

    def _is_near(self, first: _Said, last: _Said) -> bool:
        """Return whether the poses of a window differ from its twists so little that nothing else needs to be compared."""
        (x, y, theta), (u, w, phi), (a, b, heading), (c, d, psi) = first.pose, first.reckoned, last.pose, last.reckoned
        away = theta - phi
        cosine, sine, c, d = math.cos(away), math.sin(away), c - u, d - w
        if math.hypot(a - x - cosine * c + sine * d, b - y - sine * c - cosine * d) > FLOOR[0] + ASIDE * (last.way - first.way):
            return False
        turn = abs(heading - psi - away)
        return min(turn, abs(turn - TWO_PI)) <= FLOOR[1]

    def _differs(self, earlier: _Said) -> str:
        """Return how the motion since a message contradicts its twists."""
        assert self._at is not None
        if self._is_near(earlier, self._at):
            return ""
        compared = self.compare(earlier, self._at)
        if compared.excess(compared.told) <= 1.0:
            return ""
        if text := explanation(compared):
            return text
        away = math.hypot(compared.ahead - compared.told[0], compared.left - compared.told[1])
        turned, interval = abs(wrap(compared.turn - compared.told[2])), self._at.time - earlier.time
        limits = self._robot.max_linear, self._robot.max_angular
        if any(off > floor + MARGIN * most * interval for off, floor, most in zip((away, turned), FLOOR, limits, strict=True)):
            jump = f"{JUMPS} by {away:.2f} m and {turned:.2f} rad against its twist"
            return f"{jump}: was it reset, was the robot moved, or are there two sources?"
        if all(abs(value) < least for value, least in zip(self._at.twist, LEAST, strict=True)):
            return "the pose moves though the wheels are said to stand"
        return f"{UNEXPLAINED} by {away:.2f} m and {turned:.2f} rad in {interval:.2f} s"

    def _elsewhere(self, now: _Said) -> str:
        """Return whether odometry begins anew: at the origin, or after a pause elsewhere than the robot can be."""
        before, way = (self._said[-1].pose, now.way - self._said[-1].way) if self._said else (self._left, 0.0)
        if before is None:
            return ""
        (x, y, _), most = now.pose, FLOOR[0] + way + self._noise[0]
        if math.hypot(x, y) < HOME and math.hypot(before.x, before.y) > most:
            return f"{ANEW} at the origin: it was reset"
        away = math.hypot(x - before.x, y - before.y)
        if not self._said and away > most + MARGIN * self._robot.max_linear:
            return f"{PAUSED} odometry is {away:.2f} m from where it was: was it reset, or the robot moved?"
        return ""

    def _stuck(self, now: _Said) -> str:
        """Return whether position or heading repeat themselves to the bit while the wheels are said to turn."""
        (place, heading), (v, omega), (grid, step) = self._moved, now.twist, self._grids
        place = now if place.pose[:2] != now.pose[:2] else place
        heading = now if heading.pose.theta != now.pose.theta else heading
        self._moved = place, heading
        if now.way - place.way > FLOOR[0] + LAG * max(abs(v), abs(place.twist.v)) + 3.0 * grid:
            return FROZEN
        if now.turned - heading.turned > FLOOR[1] + LAG * max(abs(omega), abs(heading.twist.omega)) + 3.0 * step:
            return NO_HEADING
        return ""

    def _disobeys(self, command: Command | None) -> str:
        """Return whether the robot does not follow its command; what was in force during a gap in the messages is unknown."""
        now = self._at
        assert now is not None
        orders = self._orders
        if command is None or (orders and now.time - orders[-1][0] > DELAY):
            orders.clear()
        if command is None:
            return ""
        orders.append((now.time, command, now.twist))
        while len(orders) > 1 and now.time - orders[1][0] >= DELAY + SEEN:
            orders.popleft()
        if now.time - orders[0][0] < DELAY + SEEN:
            return ""
        seen = [twist for time, _, twist in orders if now.time - time <= SEEN + 1e-6]
        for axis, (least, verb) in enumerate(zip(LEAST, ("drive", "turn"), strict=True)):
            told = [order[axis] for _, order, _ in orders]
            sign = 1.0 if told[0] > 0.0 else -1.0
            order, answers = min(sign * value for value in told), [sign * twist[axis] for twist in seen]
            against = -1.0 if told[-1] > 0.0 else 1.0
            other = [against * twist[axis] for twist in seen]
            swings = len(other) > 2 and min(other[-2:]) > max(other[0], 0.0) + 2.0 * least
            if abs(told[-1]) >= least and swings and max(against * value for value in told) < least:
                return _wrong_sign(verb)
            if order < least:
                continue
            if max(map(abs, answers)) < ANSWER * order and abs(answers[-1] - answers[0]) < 0.5 * ANSWER * order:
                stands = (
                    "and does not move: blocked, or its emergency stop is pressed" if verb == "drive" else "and does not turn"
                )
                return f"the robot is commanded to {verb} {stands}; or odometry has stopped"
            if max(answers) < -0.3 * order and answers[-1] <= 0.97 * answers[0]:
                return _wrong_sign(verb)
        return ""


def _wrong_sign(verb: str) -> str:
    return f"the {'turning rate' if verb == 'turn' else 'speed'} has the wrong sign: the command is to {verb} the other way"


def _sideways(odometry: Odometry) -> str:
    """Return whether a twist moves a robot with two wheels to the side."""
    across = odometry.across if isinstance(odometry, SidewaysOdometry) else 0.0
    if abs(across) <= max(ACROSS[0], ACROSS[1] * abs(odometry.twist.v)):
        return ""
    return f"the twist has a speed of {across:g} m/s to the left, as no robot with two wheels: is it in the world's frame?"


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    sine, cosine = math.sin(angle), math.cos(angle)
    return cosine * x - sine * y, sine * x + cosine * y
