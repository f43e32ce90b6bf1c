"""Whether the robot moves as commanded, by its odometry. Does not depend on ROS and takes steady times as arguments.

It shares no code with the filter's rule of agreement and needs no filter, so it covers what a person commands, too. It compares
the published commands with the pose *and* the twist of odometry: motion of either is motion.

* **Dead.** A command to drive lasts for `STILL` s, or adds up to `NET` in quick starts and stops, and odometry does not change.
  A robot that reacts 0.5 s late has moved by then.
* **Blocked.** Odometry changes, but shows less than `SHARE` of a command that has lasted.
* **Unexpected.** Odometry shows motion that no command of late explains, nor slow braking: without one, against it, or faster.
  It must add up to more than a push aside. Poses count only where they move steadily, so that neither their noise nor a jump is
  motion; the filter judges jumps.

Robots that react late, slowly, coarsely or slip give no false alarm in 10 hours of simulated driving with each noise, so fewer
than one in 3 hours at 95 % confidence.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise, takewhile

from cmd_vel_guard.values import STOP, Command, Pose

STILL, NET = 0.7, 0.2
"""Time, s, and net way of the commands at the wheels' rims, m, after which odometry without a change is dead."""
TOLD = 0.02, 0.1
"""Least command from which a robot must move, m/s and rad/s: firmware truncates commands to multiples of 0.01."""
CHANGE = 0.001, 0.001, 0.005, 0.005, 0.02
"""Largest change of x, y, heading, speed and turning rate that may be jitter; m, m, rad, m/s, rad/s."""
WINDOW = 0.5
"""Time over which motion is averaged, s."""
SETTLED, SHARE, LASTING, CHANGES = 1.5, 0.2, 0.5, 0.0075
"""Time after which even a slow robot follows a command, s; share of it below which it is blocked, and for how long, s, if the
wheels' speeds change by less, m/s: a slow robot turns around, and a slipping one keeps a larger share."""
LEAST, SWERVE = (0.04, 0.3), 0.26
"""Least speeds of which that is judged, m/s and rad/s; and more in a turn, m: noise ``wheel`` swerves."""
LATEST, SLOWEST, MEMORY = 0.8, 0.1, 5.0
"""Longest delay of a robot, s, and slowest change of a wheel, m/s^2, that explain motion; and how long that change lasts, s."""
SLACK = 0.03, 0.1
"""Speeds that need no explanation, m/s and rad/s; more in a turn, and in a drive."""
UNTOLD, AGAINST = (0.1, 1.0), (0.06, 0.3)
"""Unexplained motion, and such motion against the command, that are a fault, m and rad."""
STALE = 1.0
"""Age of odometry, once heard, from which nothing is known about the robot's motion, s."""

DEAD = "the robot should drive and does not move: blocked, its emergency stop is pressed, or its odometry is frozen"
BLOCKED = tuple(f"the robot should {verb} and hardly does: blocked, or its odometry is wrong" for verb in ("drive", "turn"))
REVERSED = "the speed has the wrong sign", "the turning rate has the wrong sign"
EXTRA = "odometry shows motion that the guard did not command: another node drives the robot, or odometry is wrong"

_Sample = tuple[float, Pose, Command]
"""Odometry, and when it was measured, s."""


class Moved:
    """Compare commands with odometry of a robot whose wheels are so far apart, m; times are steady, s."""

    def __init__(self, wheel_separation: float) -> None:
        self._half = 0.5 * wheel_separation
        self._commands: deque[tuple[float, Command]] = deque([(-math.inf, STOP)])
        self.at = -math.inf
        """When the newest odometry was measured; minus infinity if none was heard."""
        self.forget()

    def lacks(self, now: float) -> bool:
        """Return whether odometry that was heard before is too old now."""
        return -math.inf < self.at < now - STALE

    def forget(self) -> None:
        """Begin anew, when a person has enabled the robot."""
        self._window: deque[_Sample] = deque()
        self._still: _Sample | None = None
        self._short = [(math.inf, STOP)] * 2
        self._excess = {(axis, against): 0.0 for axis in (0, 1) for against in (False, True)}

    def tell(self, command: Command, now: float) -> None:
        """Take a command that was published."""
        while len(self._commands) > 1 and self._commands[1][0] < now - 2.0 * MEMORY:
            self._commands.popleft()
        if command != self._commands[-1][1]:
            self._commands.append((now, command))

    def _told(self, since: float, until: float) -> list[tuple[float, Command]]:
        """Return the commands in force between two times, newest first, and for how long each was, s."""
        spans: list[tuple[float, Command]] = []
        for start, command in reversed(self._commands):
            if start < until:
                spans.append((until - max(start, since), command))
                until = start
            if start <= since:
                break
        return spans

    def hear(self, pose: Pose, twist: Command, at: float) -> str:
        """Take odometry that was measured at a time; return what is wrong, or an empty text."""
        if not math.isfinite(sum(pose) + sum(twist) + at) or at <= self.at:
            return ""  # it says nothing, and in time is stale
        gap, self.at = min(at - self.at, SETTLED), at
        self._window.append((at, pose, twist))
        while self._window[0][0] < at - WINDOW - 1e-3:
            self._window.popleft()
        if self._dead(at, pose, twist):
            return DEAD
        if at - self._window[0][0] < 0.7 * WINDOW or len(self._window) < 3:
            return ""
        speeds = self._speeds()
        return self._blocked(at, speeds) or self._unexpected(at, gap, speeds)

    def _dead(self, at: float, pose: Pose, twist: Command) -> bool:
        """Return whether odometry stays the same though the robot should drive."""
        since, *still = self._still or (at, Pose(math.inf, 0.0, 0.0), STOP)
        changes = [now - then for now, then in zip((*pose, *twist), (*still[0], *still[1]), strict=True)]
        changes[2] = math.remainder(changes[2], math.tau)
        if any(abs(change) > least for change, least in zip(changes, CHANGE, strict=True)):
            self._still = at, pose, twist
            return False
        spans = self._told(max(since, at - MEMORY), at)
        for axis, lever in enumerate((1.0, self._half)):
            told = [(lasted, command[axis] * (abs(command[axis]) > TOLD[axis] - 1e-9)) for lasted, command in spans]
            lasting = takewhile(lambda span, newest=told[0][1]: span[1] * newest > 0.0, told)
            net = sum(lasted * speed for lasted, speed in told)
            if sum(lasted for lasted, _ in lasting) >= STILL - 1e-6 or abs(net) * lever >= NET:
                return True
        return False

    def _speeds(self) -> list[tuple[float, float, bool]]:
        """Return speed and turning rate over the window: by the twist, by the pose, and whether the pose moves steadily."""
        times, poses, twists = zip(*self._window, strict=True)
        steps, count, lasted = list(pairwise(poses)), len(times) - 1, times[-1] - times[0]
        turns = [math.remainder(b.theta - a.theta, math.tau) for a, b in steps]
        x, y, turned = poses[-1].x - poses[0].x, poses[-1].y - poses[0].y, sum(turns)
        middle, ways = poses[0].theta + 0.5 * turned, sum((b.x - a.x) ** 2 + (b.y - a.y) ** 2 for a, b in steps)
        steady = math.hypot(x, y) > 0.5 * math.sqrt(count * ways), abs(turned) > 0.5 * math.hypot(*turns) * math.sqrt(count)
        moved = (x * math.cos(middle) + y * math.sin(middle)) / lasted, turned / lasted
        median = [sorted(twist[axis] for twist in twists)[(count + 1) // 2] for axis in (0, 1)]  # one spike is no motion
        return [(median[axis], moved[axis], steady[axis] and count >= 8) for axis in (0, 1)]

    def _blocked(self, at: float, speeds: list[tuple[float, float, bool]]) -> str:
        """Return whether much less motion is measured than was commanded for long."""
        commands = [command for _, command in self._told(at - SETTLED, at)]
        twists = Command(*(twist for twist, _, _ in speeds))
        swerve = SWERVE * max(abs(command.omega) for command in commands)
        for axis, (twist, pose, _) in enumerate(speeds):
            values = [command[axis] for command in commands]
            told = max(min(values), 0.0) + min(max(values), 0.0)  # one of them is 0
            share = max(twist / told, pose / told) if abs(told) > LEAST[axis] + (0.0 if axis else swerve) else math.inf
            since, before = self._short[axis]
            changes = abs(twists.v - before.v) + abs(twists.omega - before.omega) * self._half > CHANGES
            if share >= SHARE or changes or since == math.inf:
                self._short[axis] = (math.inf if share >= SHARE else at), twists
            elif at - since >= LASTING:
                return BLOCKED[axis]
        return ""

    def _unexpected(self, at: float, gap: float, speeds: list[tuple[float, float, bool]]) -> str:
        """Return whether more motion is measured than the commands explain."""
        past = [command for _, command in self._told(at - MEMORY, at)]
        wheels = [[command.v + side * command.omega * self._half for command in past] for side in (-1, 1)]
        change = max(max(wheel) - min(wheel) for wheel in wheels)
        recent = [command for _, command in self._told(at - LATEST - change / SLOWEST, at)]
        limits = [(min(0.0, *values), max(0.0, *values)) for values in zip(*recent, strict=True)]
        fastest = [max(-low, high) for low, high in limits]
        slack = SLACK[0] + 0.06 * fastest[1] ** 2, SLACK[1] + 0.25 * fastest[0]
        for axis, (twist, pose, steady) in enumerate(speeds):
            low, high = limits[axis]
            beyond, seen = max((max(speed - high, low - speed), speed) for speed in ((twist, pose) if steady else (twist,)))
            against = fastest[axis] >= TOLD[axis] and (seen < low == 0.0 or seen > high == 0.0)
            for case in (False, True):
                grown = max(beyond, 0.0) if case is against else 0.0
                self._excess[axis, case] = max(0.0, self._excess[axis, case] + (grown - slack[axis]) * gap)
            if self._excess[axis, against] > (AGAINST if against else UNTOLD)[axis]:
                return REVERSED[axis] if against else EXTRA
        return ""
