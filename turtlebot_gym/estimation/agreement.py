"""Whether the parts of odometry agree: its pose, its twist, and the command in force. A sensor may be alive and wrong.

The motion of the pose over a window is compared with that of the twists, and the twist with the command. A message that
contradicts those before it is refused; contradictions that last are final: a standing robot agrees with everything, so the
cause stays until somebody says that the robot may go on, `Agreement.begin`. Two poses differ from the twists by at most

    FLOOR + LAG * speed + share * way + SPREAD standard deviations of both poses' noise, with a spike of each
    + the way in time without messages,

with ``share`` one of `SHARES`, or more where wheels slip by more. Noise exceeds this in three messages in a row less than once
in a year of driving. A recorded TurtleBot3 keeps within a tenth.

A robot may start `DELAY` late, and accelerate slowly. So it counts as standing in spite of its command, or as turning the wrong
way, if that was in force for `DELAY` plus `SEEN`, and the twist of the last `SEEN` seconds has no tenth of it and does not
change, or the opposite sign without becoming slower; also if it becomes faster than any command in its direction explains.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from typing import NamedTuple

from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import Noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import ORIGIN, STOP, Command, Odometry, Pose, SidewaysOdometry

FLOOR = 0.02, 0.05  # difference that never counts, m and rad
LAG = 0.15  # time by which pose and twist may lie apart, s: stamps, filters of drivers, one message
SHARES = 0.5, 0.25  # of way and turn by which pose and twist may differ: wheels slip, and their track is not as assumed
ASIDE = 0.25  # share of the way by which the pose may go aside
SPREAD = 6.0  # standard deviations of noise that count as noise
WINDOWS = 0.0, 0.25, 0.5, 0.75, 1.0  # ages of the messages with which one is compared, s; the first is the last message
MARGIN = 2.0  # multiple of the limits beyond which a twist is wrong: a preset may be that of a sister slower by 1.45
GAP = 0.15  # interval between messages from which the motion in between is unknown, s
PATIENCE = 0.12, 2.5  # time, s, and multiple of the interval for which contradictions last: three messages of a TurtleBot3
MEND = 0.25  # share of it that an equal time of agreement gives back: every third message of another source is too many
DELAY, SEEN = 0.5, 0.25  # longest time in which a robot follows its command, and for which its answer is watched, s
AXES = (  # command below which nothing is said of the answer, m/s or rad/s, and what is said
    (0.03, "drive", "does not move: blocked, or its emergency stop is pressed", "speed"),
    (0.15, "turn", "does not turn", "turning rate"),
)
ANSWER = 0.1  # share of its command with which a robot counts as standing
ACROSS = 0.03, 0.1  # speed to the left, m/s and as a share of the speed, from which a twist is in another frame
HOME = 1e-6  # distance from the origin within which a robot that was elsewhere has begun anew, m
UNITS = {1000.0: "mm", 100.0: "cm", 39.37: "inches", 3.281: "feet"}  # of a metre that are taken for one
DEGREES = math.degrees(1.0)
JUMPS, ANEW, PAUSED = "odometry jumps", "odometry begins anew", "after a pause"  # of a robot that was moved
UNEXPLAINED = "pose and twist differ"

Motion = tuple[complex, float]
"""Motion over a window in the frame of its first pose: ahead and, as imaginary part, to the left, m; and the turn, rad."""


class _Said(NamedTuple):
    """A message, and what the twists up to it add up to: a pose, and the sums of ways, turns and intervals without messages."""

    time: float
    pose: Pose
    twist: Command
    reckoned: Pose = ORIGIN
    way: float = 0.0
    turned: float = 0.0
    unseen: float = 0.0


class Agreement:
    """Judge the messages of a robot's odometry, whose noise is no contradiction.

    With ``leaps`` poses may leap against the twist, as those of a localization do. Then only a pose that repeats itself to the
    bit, and a twist that the robot cannot have, contradict anything but the command.
    """

    def __init__(self, robot: Robot, noise: Noise, *, leaps: bool = False) -> None:
        R = noise.odometry.R
        spike = noise.odometry.spike if noise.odometry.spike_probability > 0.0 else 0.0
        self._limits, self._leaps = (robot.max_linear, robot.max_angular), leaps
        self._shares = tuple(share + (1.0 - share) * noise.process.slip for share in SHARES)
        self._noise = SPREAD * math.sqrt(2.0 * max(R[:2])), SPREAD * math.sqrt(2.0 * R[2]) + 2.0 * spike
        self.begin()

    def begin(self, left: Pose | None = None) -> None:
        """Forget everything, also the cause; the next message is the first, near the pose where the robot was left if given."""
        self.cause, self._left = "", left
        """Why odometry is not believed any more, until `begin`, or an empty text."""
        self._level, self._lost, self._first = 0.0, 0.0, ""
        self._at: _Said | None = None
        self._said: deque[_Said] = deque()
        self._orders: deque[tuple[float, Command, Command]] = deque()

    def pause(self) -> None:
        """Record a pause of odometry of unknown length, in which the robot has stopped: it must be about where it was."""
        if not self.cause:
            self.begin(self._said[-1].pose if self._said else self._left)

    def judge(self, dt: float, odometry: Odometry, command: Command | None = None) -> str:
        """Return why a message, dt s after the one before, must not be used, or an empty text; ``command`` is in force."""
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
        if why := self._beyond(odometry, command):
            self._lost = dt
            return why
        now = self._at = self._advanced(dt, odometry)
        if not odometry.measured:
            return ""
        if why := self._stuck(now) or ("" if self._leaps else self._elsewhere(now) or self._differs(now)):
            return why
        self._left = None
        self._said.append(now)
        while now.time - self._said[0].time > WINDOWS[-1] + GAP:
            self._said.popleft()
        return ""

    def _beyond(self, odometry: Odometry, command: Command | None) -> str:
        for value, most, unit, told in zip(odometry.twist, self._limits, ("m/s", "rad/s"), command or STOP, strict=True):
            if not abs(value) <= MARGIN * most:
                factor, what = abs(value / (told or most)), "the command" if told else "the robot's limit"
                units = UNITS if unit == "m/s" else {DEGREES: "degrees/s"}
                return f"odometry's twist of {value:g} {unit} is {factor:.0f} times {what}{_unit(factor, units, 0.3)}"
        across = odometry.across if isinstance(odometry, SidewaysOdometry) else 0.0
        if abs(across) > max(ACROSS[0], ACROSS[1] * abs(odometry.twist.v)):
            return f"the twist has a speed of {across:g} m/s to the left, as no two wheels have: is it in the world's frame?"
        return ""

    def _advanced(self, dt: float, odometry: Odometry) -> _Said:
        """Return what the twists add up to at a message, from the mean of its twist and the one before."""
        before, now = self._at, _Said(0.0, odometry.pose, odometry.twist)
        if before:
            v, omega = 0.5 * (before.twist.v + now.twist.v), 0.5 * (before.twist.omega + now.twist.omega)
            x, y, theta = before.reckoned
            heading = theta + 0.5 * omega * dt
            reckoned = Pose(x + v * dt * math.cos(heading), y + v * dt * math.sin(heading), theta + omega * dt)
            sums = before.way + abs(v) * dt, before.turned + abs(omega) * dt, before.unseen + (dt if dt > GAP else 0.0)
            now = _Said(before.time + dt, now.pose, now.twist, reckoned, *sums)
        if before is None or dt > DELAY:  # it may have stood in between
            self._moved = now, now  # when the position and the heading changed last
        return now

    def _allowed(self, first: _Said, last: _Said) -> tuple[float, float, float]:
        """Return by how much pose and twists may differ: ahead, to the left, and in the turn; m, m, rad."""
        way, turned, unseen = last.way - first.way, last.turned - first.turned, last.unseen - first.unseen
        interval, (a, b), (c, d) = max(last.time - first.time, 1e-9), first.twist, last.twist
        speed, rate = max(abs(a), abs(c), way / interval), max(abs(b), abs(d), turned / interval)
        most = FLOOR[0] + LAG * speed + self._shares[0] * way + self._noise[0] + unseen * self._limits[0]
        wide = FLOOR[1] + LAG * rate + self._shares[1] * turned + self._noise[1] + unseen * self._limits[1]
        return most, most + (ASIDE - self._shares[0] + min(self._noise[1], 1.0) + LAG * abs(d)) * way, wide

    def _differs(self, now: _Said) -> str:
        said = reversed(self._said)
        for age in WINDOWS:
            first = next((each for each in said if now.time - each.time >= age), None)
            if first is None:
                break
            moved, told = _motion(first.pose, now.pose), _motion(first.reckoned, now.reckoned)
            allowed = self._allowed(first, now)
            if _excess(moved, told, allowed) > 1.0:
                return _explanation(moved, told, allowed) or self._difference(moved, told, now.twist, now.time - first.time)
        return ""

    def _difference(self, moved: Motion, told: Motion, twist: Command, interval: float) -> str:
        away, turned = abs(moved[0] - told[0]), abs(wrap(moved[1] - told[1]))
        by, reach = f"by {away:.2f} m and {turned:.2f} rad", [MARGIN * most * interval for most in self._limits]
        if away > FLOOR[0] + reach[0] or turned > FLOOR[1] + reach[1]:
            return f"{JUMPS} {by} against its twist: was it reset, was the robot moved, or are there two sources?"
        if all(abs(value) < least for value, (least, *_) in zip(twist, AXES, strict=True)):
            return "the pose moves though the wheels are said to stand"
        return f"{UNEXPLAINED} {by} in {interval:.2f} s"

    def _elsewhere(self, now: _Said) -> str:
        """Return whether odometry begins anew: at the origin, or after a pause elsewhere than the robot can be."""
        before, way = (self._said[-1].pose, now.way - self._said[-1].way) if self._said else (self._left, 0.0)
        if before is None:
            return ""
        most, away = FLOOR[0] + way + self._noise[0], math.dist(now.pose[:2], before[:2])
        if math.hypot(now.pose.x, now.pose.y) < HOME and away > most:
            return f"{ANEW} at the origin: it was reset"
        if not self._said and away > most + MARGIN * self._limits[0]:
            return f"{PAUSED} odometry is {away:.2f} m from where it was: was it reset, or the robot moved?"
        return ""

    def _stuck(self, now: _Said) -> str:
        """Return whether position or heading repeat themselves to the bit while the wheels are said to turn."""
        place, heading = self._moved
        place = now if place.pose[:2] != now.pose[:2] else place
        heading = now if heading.pose.theta != now.pose.theta else heading
        self._moved = place, heading
        if now.way - place.way > FLOOR[0] + LAG * max(abs(now.twist.v), abs(place.twist.v)):
            return "the pose does not move though the wheels are said to turn"
        if now.turned - heading.turned > FLOOR[1] + LAG * max(abs(now.twist.omega), abs(heading.twist.omega)):
            return "the heading stands still though the robot is said to turn: is the IMU alive?"
        return ""

    def _disobeys(self, command: Command | None) -> str:
        """Return whether the robot does not follow its command; what was in force during a gap in the messages is unknown."""
        now, orders = self._at, self._orders
        assert now is not None
        if command is None or (orders and now.time - orders[-1][0] > DELAY):
            orders.clear()
        if command is None:
            return ""
        orders.append((now.time, command, now.twist))
        while len(orders) > 1 and now.time - orders[1][0] >= DELAY + SEEN:
            orders.popleft()
        lasted = now.time - orders[0][0] >= DELAY + SEEN
        seen = [twist for time, _, twist in orders if now.time - time <= SEEN + 1e-6]
        for axis, (least, verb, stands, name) in enumerate(AXES):
            wrong = f"the {name} has the wrong sign: the command is to {verb} the other way"
            sign = 1.0 if command[axis] > 0.0 else -1.0
            told, answers = [sign * order[axis] for _, order, _ in orders], [sign * twist[axis] for twist in seen]
            order = min(told)
            opposite = min(answers[0], order if order < -least else 0.0)  # what earlier commands or a slow robot explain
            known = lasted or max(abs(told[0]), abs(orders[0][2][axis])) < least  # it rested, so no command before counts
            if told[-1] >= least and known and len(answers) > 2 and max(answers[-2:]) < opposite - 2.0 * least:
                return wrong
            if order < least or not lasted:
                continue
            if max(map(abs, answers)) < ANSWER * order and abs(answers[-1] - answers[0]) < 0.5 * ANSWER * order:
                return f"the robot is commanded to {verb} and {stands}; or odometry has stopped"
            if max(answers) < -0.3 * order and answers[-1] <= 0.97 * answers[0]:
                return wrong
        return ""


def _explanation(moved: Motion, told: Motion, allowed: tuple[float, float, float]) -> str:
    """Return which mistake of a driver, each of which predicts one motion, makes pose and twist differ; or an empty text."""
    way, omega = told
    factor = abs(moved[0]) / max(abs(way), 1e-9)
    ratio = factor if factor > 1.0 else 1.0 / max(factor, 1e-9)
    many = "the pose moves {:.3g} times as far as the twist says" if factor > 1.0 else "the twist is {:.3g} times too large"
    unit = _unit(ratio, UNITS, 0.1)
    guesses = {
        "the heading changes 57 times as fast as the turning rate says: in degrees?": (way, DEGREES * omega),
        "the pose moves against the speed: one of them has the wrong sign": (-way, omega),
        "the heading turns against the turning rate: one of them has the wrong sign": (way.conjugate(), -omega),
    }
    if unit or abs(way) >= 0.5 * allowed[0]:  # else a factor makes any motion of it
        guesses[many.format(ratio) + unit] = factor * way, omega
    fits = {text: _excess(moved, motion, allowed) for text, motion in guesses.items()}
    best = min(fits, key=fits.__getitem__)
    return best if fits[best] < min(1.0, 0.5 * _excess(moved, told, allowed)) else ""


def _unit(factor: float, units: dict[float, str], within: float) -> str:
    return next((f": in {unit}?" for many, unit in units.items() if abs(factor / many - 1.0) < within), "")


def _excess(moved: Motion, told: Motion, allowed: tuple[float, float, float]) -> float:
    """Return by how many times two motions differ by more than is tolerated."""
    off = moved[0] - told[0]
    return max(math.hypot(off.real / allowed[0], off.imag / allowed[1]), abs(wrap(moved[1] - told[1])) / allowed[2])


def _motion(first: Pose, last: Pose) -> Motion:
    way = complex(last.x - first.x, last.y - first.y) * cmath.rect(1.0, -first.theta)
    return way, last.theta - first.theta
