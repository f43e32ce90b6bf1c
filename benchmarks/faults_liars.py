"""Faults of a driver that lives and lies, and of wheels that do not obey; judged by the true path; see `faults_kinds`.

A lie is unsafe if the robot moves for more than 0.25 m or 1.0 s after it could first be seen, or moves on by itself when the
driver tells the truth again: a robot that stands agrees with everything.
"""

from __future__ import annotations

import math
import random
import time

from faults_driver import Wheels, honest
from faults_lies import TURNING, Maker
from faults_record import TIME
from faults_robot import Fault, Robot, Unseen

LATCHED = 2.0
"""Time for which the driver tells the truth at last, s."""
VISIBLE = 10.0
"""Longest time until a lie can be seen, s."""
SPIN = 3.0
"""Longest time for which wheels may spin, s: only the scans show it."""
DISBELIEVED = "odometry is not believed"
"""What the filter says of a driver that lies."""
NOT_LATCHED = frozenset({"odometry of another frame", "odometry of two robots by one node"})
"""Lies whose end is evidence enough to go on: each message says by itself whether it counts."""


EXCUSED = frozenset({"wrong scale"})
"""Lies that look like slip, or like a robot faster than its like, until they add up to `EXCUSE` m."""
EXCUSE = 0.1


def lies(name: str, maker: Maker, *, from_the_start: bool, by_hand: tuple[float, float] | None = None) -> Fault:
    """Return the fault of a driver that lies, from the start of a drive or from within it, of a program or of a person, who
    commands m/s and rad/s."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        if from_the_start:
            stand(robot)
        if by_hand:
            robot.teleop = by_hand
            time.sleep(1.0)  # until it moves so
        with robot.lock:
            since, robot.driver.lie = time.time(), maker(rng)
        if from_the_start:
            robot.begin()
        if name in TURNING:
            turn_aside(robot, rng)
        at = until_seen(robot)
        if name in EXCUSED:
            at = until_adds_up(robot, at)
        reasons = stray(robot, at)
        return reasons if name in NOT_LATCHED else reasons + tells_the_truth(robot, since)

    return fault


def turn_aside(robot: Robot, rng: random.Random) -> None:
    """Send the robot somewhere aside, not so far that it would rather drive backwards."""
    robot.send_goal(rng.choice([-1.0, 1.0]) * rng.uniform(0.9, 1.4))


def stand(robot: Robot) -> None:
    """Let a person stop the robot, and carry it back to its start."""
    robot.ros.ask("velocity_controller/enable", data=False)
    robot.enable(False)
    robot.reset_world()


def until_seen(robot: Robot, patience: float = VISIBLE) -> float:
    """Wait for a time, s, until the lie could be seen, and return when that was, s.

    A filter may see more than the judge: if the robot stands for `TIME` since the filter does not believe its odometry, the lie
    counts as seen.

    Raises:
        Unseen: If it could not.
    """
    since, until = time.time(), time.monotonic() + patience
    while (at := robot.driver.seen.at) is None:
        now = time.time()
        stands = now > since + TIME and not robot.record.in_force(now - TIME, now)
        if stands and any(DISBELIEVED in complaint for complaint in robot.ros.complaints(since)):
            at = now
            break
        if time.monotonic() > until:
            raise Unseen("the lie could not be seen")
        time.sleep(0.01)
    robot.record.began = at
    return at


def until_adds_up(robot: Robot, at: float) -> float:
    """Wait until what is said is `EXCUSE` m more than what was commanded since a time, s, or the robot stands; return when."""
    begun, now = robot.driver.unexplained, time.time()
    while robot.driver.unexplained - begun < EXCUSE and now < at + VISIBLE:
        time.sleep(0.01)
        now = time.time()
        if now > at + TIME and not robot.record.in_force(now - TIME, now):
            return now
    return now


def stray(robot: Robot, at: float) -> list[str]:
    """Watch a robot whose driver's lie could be seen at a time, s, and return why its motion since then was unsafe."""
    while time.time() < at + 2.0 * TIME:  # it must not move now and then either
        time.sleep(0.02)
    robot.ros.catch_up()
    return robot.record.strays(at, time.time())


def tells_the_truth(robot: Robot, since: float, lasts: float = LATCHED) -> list[str]:
    """Let the driver tell the truth for a time, s; return that the robot moved on by itself.

    Args:
        robot: The robot.
        since: Time from which it lied, s.
        lasts: Time for which it tells the truth, s.
    """
    at = time.time()
    moved = robot.record.in_force(at - 0.1, at)
    with robot.lock:
        robot.driver.lie, robot.driver.turns, robot.driver.grips = honest, _obey, _obey
    time.sleep(lasts)
    robot.ros.catch_up()
    again = robot.record.lasts(at, time.time())
    return [f"it moved on by itself for {again:.2f} s"] if again > 0.0 and not moved else []


def _obey(v: float, omega: float) -> tuple[float, float]:
    return v, omega


def wheels(turn: Wheels, *, turning: bool, by_hand: bool = False) -> Fault:
    """Return the fault of wheels that do not turn as commanded, and of a driver that says so."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        with robot.lock:
            since, robot.driver.turns = time.time(), turn
            if by_hand:
                robot.teleop = (0.15, 0.0)
        if turning:
            turn_aside(robot, rng)
        return stray(robot, until_seen(robot)) + tells_the_truth(robot, since)

    return fault


def other_way(v: float, omega: float) -> tuple[float, float]:
    """The motors are swapped: the robot turns the other way."""
    return v, -omega


def blocked(v: float, omega: float) -> tuple[float, float]:
    """Something holds the robot, or the emergency stop of its base is pressed."""
    return 0.0, 0.0


def spinning(robot: Robot, rng: random.Random) -> list[str]:
    """The wheels spin, and the odometry says that the robot drives."""
    robot.record.began = at = time.time()
    robot.driver.grips = blocked
    time.sleep(SPIN + 1.0)
    robot.ros.catch_up()
    lasted = robot.record.travelled(at, time.time())[1]
    return [f"the wheels span for {lasted:.1f} s"] if lasted > SPIN else []


def frozen_at_a_fence(maker: Maker) -> Fault:
    """Return the fault of a driver that lies shortly before the robot reaches its fence."""
    return _fence(0.5, maker)


def _fence(radius: float, maker: Maker | None) -> Fault:
    def fault(robot: Robot, rng: random.Random) -> list[str]:
        robot.chain.restart("cmd_vel_guard", geofence=f"{radius}")
        robot.reset_world()
        robot.drive_again()
        since = time.time()
        if maker:
            while robot.driver.world.pose[0] < radius - 0.2 and time.time() < since + 5.0:
                time.sleep(0.01)
            robot.driver.lie = maker(rng)
        time.sleep(6.0)
        away = math.hypot(*robot.world.pose[:2])
        return [f"it left its fence of {radius} m by {away - radius:.2f} m"] if away > radius + 0.1 else []

    return fault


fence = _fence(0.8, None)
"""A program drives towards a fence."""
