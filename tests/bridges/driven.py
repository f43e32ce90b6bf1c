"""A robot that follows commands late, slowly, coarsely, slipping and noisily, and what its odometry says at 20 Hz."""

import math
import random
from collections import deque
from dataclasses import dataclass

from cmd_vel_guard.moved import Moved
from turtlebot_gym.models.odometry import measure
from turtlebot_gym.models.unicycle import advance, execute, limit, slips
from turtlebot_gym.presets import NOISES
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import STOP, Command, Pose

DT = 0.05
BURGER = ROBOTS["burger"]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """How a robot differs from its commands."""

    noise: str = "clean"
    late: float = 0.0  # delay of every command, s
    start: float = 0.0  # delay of a start from rest, s
    acceleration: float = math.inf  # limit of each wheel, m/s^2
    coarse: float = 0.0  # commands are truncated to multiples of this
    slip: bool = False  # whether half of the motion is lost in bursts of half a second
    lost: float = 0.0  # share of odometry that never arrives
    held: float = 0.0  # longest delay of odometry, s
    pushed: bool = False  # whether it is pushed by up to 5 cm and 0.3 rad when it stands


KINDS = {
    "at once": Kind(coarse=0.01),
    "start delay": Kind(start=0.5, coarse=0.01),
    "start delay, slow": Kind(start=0.5, acceleration=0.3, coarse=0.01),
    "slow": Kind(acceleration=0.2),
    "slower": Kind(acceleration=0.1, coarse=0.01),
    "late": Kind(late=0.3, coarse=0.01),
    "late, slow": Kind(late=0.3, acceleration=0.3),
    "slip": Kind(slip=True, coarse=0.01),
    "odometry late and lost": Kind(lost=0.3, held=0.3),
    "pushed": Kind(pushed=True, coarse=0.01),
    "all": Kind(late=0.1, start=0.4, acceleration=0.5, coarse=0.01, slip=True, lost=0.1, held=0.1, pushed=True),
}


class Robot:
    def __init__(self, kind, rng):
        self.kind, self.rng, self.noise = kind, rng, NOISES[kind.noise]
        self.pose, self.wheels, self.twist = Pose(1.0, -2.0, 0.7), Pose(0.0, 0.0, 0.0), STOP
        self.pending = deque([STOP] * (1 + round(kind.late / DT)))
        self.rested, self.slipping, self.push, self.stood = 0.0, False, None, 0.0

    def step(self, command):
        """Move for a step, and return its odometry: pose and twist."""
        kind, rng = self.kind, self.rng
        self.pending.append(command)
        wanted = limit(self.pending.popleft(), BURGER)
        if kind.coarse:
            wanted = Command(*(math.trunc(value / kind.coarse + 1e-9) * kind.coarse for value in wanted))
        self.rested = 0.0 if wanted == STOP else self.rested + DT
        if kind.start and self.twist == STOP and self.rested < kind.start:
            wanted = STOP
        half, most = 0.5 * BURGER.wheel_separation, kind.acceleration * DT
        wheels = [v - side * half * omega for v, omega in (self.twist, wanted) for side in (1, -1)]
        left, right = (now + min(max(then - now, -most), most) for now, then in zip(wheels[:2], wheels[2:], strict=True))
        self.twist = Command(0.5 * (left + right), (right - left) / (2.0 * half))
        draws = rng.gauss(0.0, 1.0), rng.gauss(0.0, 1.0)
        self.slipping = slips(self.slipping, self.noise.process, rng.random(), DT)
        done = execute(self.twist, self.noise.process, self.slipping, draws, DT)
        if kind.slip:
            self.slipping = rng.random() >= 0.1 if self.slipping else rng.random() < 0.005
            done = Command(0.5 * done.v, 0.5 * done.omega) if self.slipping else done
        done = self._pushed(done, command)
        self.pose = advance(self.pose, *done, DT, 0.5)
        self.wheels = advance(self.wheels, *done, DT, 0.5)
        position = rng.gauss(0.0, 1.0), rng.gauss(0.0, 1.0)
        seen = measure(self.pose, self.wheels, self.noise.odometry, position, rng.gauss(0.0, 1.0), rng.random())
        return Pose(*seen), Command(*done)

    def _pushed(self, done, command):
        self.stood = self.stood + DT if done == command == STOP and self.push is None else 0.0
        if self.kind.pushed and self.push is None and self.stood > 2.0 and self.rng.random() < 0.05:
            self.push = [6, Command(self.rng.uniform(-0.05, 0.05) / 0.3, self.rng.uniform(-0.3, 0.3) / 0.3)]
        if self.push is None:
            return done
        self.push[0] -= 1
        push, self.push = self.push[1], self.push if self.push[0] else None
        return Command(done.v + push.v, done.omega + push.omega)


class Driver:
    """Commands of programs and people: cruises, turns, creeping, quick starts, stops and turns around, and rests."""

    def __init__(self, rng):
        self.rng, self.left, self.command, self.quick, self.style = rng, 0, STOP, 0, "rest"

    def step(self):
        rng = self.rng
        if self.left <= 0:
            self.style = rng.choice(("cruise", "curve", "spin", "creep", "quick", "weave", "rest"))
            self.left = rng.randint(10, 160)
            v, omega = rng.uniform(-0.21, 0.21), rng.uniform(-2.6, 2.6)
            self.command = {
                "cruise": Command(0.21, rng.gauss(0.0, 0.1)),
                "curve": Command(v, 0.4 * omega),
                "spin": Command(0.0, omega),
                "creep": Command(rng.choice((-1, 1)) * rng.uniform(0.004, 0.03), rng.choice((0.0, rng.gauss(0.0, 0.1)))),
            }.get(self.style, STOP)
        self.left -= 1
        if self.style == "quick":
            self.quick -= 1
            if self.quick <= 0:
                self.quick = rng.randint(1, 12)
                self.command = Command(rng.choice((-0.21, 0.0, 0.21)), rng.choice((-2.0, 0.0, 2.0)))
        if self.style == "weave":
            self.command = Command(0.15, 1.5 * math.sin(0.3 * self.left))
        return limit(self.command, BURGER)


def alarm(kind, seconds, seed, *, spoil=lambda at, pose, twist: (pose, twist), drive=None):
    """Return the time, s, and the cause of a drive's first alarm, or None."""
    rng = random.Random(seed)
    robot, moved, driver, held = Robot(kind, rng), Moved(BURGER.wheel_separation), Driver(rng), []
    for k in range(round(seconds / DT)):
        at = 100.0 + k * DT
        command = driver.step() if drive is None else drive(k * DT)
        pose, twist = robot.step(command)
        if rng.random() >= kind.lost:
            held.append((at + rng.uniform(0.0, kind.held), at, *spoil(k * DT, pose, twist)))
        due = sorted(entry for entry in held if entry[0] <= at)
        held = [entry for entry in held if entry[0] > at]
        for entry in due[-1:]:  # only the newest is kept
            why = moved.hear(entry[2], entry[3], entry[1])
            if why:
                return k * DT, why
        moved.tell(command, at)
    return None
