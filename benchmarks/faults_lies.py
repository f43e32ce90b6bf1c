"""Faults of a driver that lives and lies, and of wheels that do not obey; judged by the true path.

A lie is unsafe if the robot moves for more than 0.25 m or 1.0 s after it could first be seen, or moves on by itself when the
driver tells the truth again: a robot that stands agrees with everything.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from faults_chain import GUARD
from faults_record import TIME
from faults_robot import Fault, Robot, Unseen
from faults_world import Lie, Said, Wheels, obeying

VISIBLE, EXCUSE, SPIN = 10.0, 0.1, 3.0
"""Longest time until a lie can be seen, s; way that "wrong scale" may add up to, m, as it looks like slip, or like a robot
faster than its like; longest time for which wheels may spin, s, which only the scans show."""
Maker = Callable[[random.Random], Lie]
"""Makes a new lie, and chooses among the members of its class."""


def lie(change: Callable[[Said, list[Said], Any], dict[str, Any]], draw: Callable[[random.Random], Any] | None = None) -> Maker:
    """Return the maker of a lie that changes fields of a message, by all that was true since it began, and what is drawn."""

    def make(rng: random.Random) -> Lie:
        chosen = draw(rng) if draw else None
        return lambda true: true[-1]._replace(**change(true[-1], true, chosen))

    return make


def frozen(*names: str) -> Maker:
    """Return the maker of a lie in which fields keep their first values, to the bit or with a noise of 0.1 mm and mrad."""
    return lie(
        lambda said, true, noise: {name: getattr(true[0], name) + random.gauss(0.0, noise) for name in names},
        lambda rng: rng.choice([0.0, 1e-4]),
    )


def scaled(draw: Callable[[random.Random], tuple[float, tuple[str, ...]]]) -> Maker:
    """Return the maker of a lie in which some fields are multiplied."""
    return lie(lambda said, true, of: {name: of[0] * getattr(said, name) for name in of[1]}, draw)


def leap(rng: random.Random) -> tuple[float, float]:
    """Draw a leap of 0.1 to 3 m, as when an odometry far from its start is reset."""
    distance, direction = rng.choice([0.1, 0.2, 0.35, 0.5, 0.8, 1.25, 2.0, 3.0]), rng.uniform(-math.pi, math.pi)
    return distance * math.cos(direction), distance * math.sin(direction)


LENGTHS = ("x", "y", "v")
ANGULAR = [("theta",), ("omega",), ("theta", "omega")]
FROM_THEN_ON: dict[str, Maker] = {
    "pose frozen": frozen("x", "y", "theta"),
    "twist frozen": frozen("v", "omega"),
    "pose and twist frozen": frozen("x", "y", "theta", "v", "omega"),
    "position frozen": frozen("x", "y"),
    "heading frozen": frozen("theta"),
    "twist zero": lie(lambda said, *_: {"v": 0.0, "omega": 0.0}),
    "pose zero": lie(lambda said, *_: {"x": 0.0, "y": 0.0, "theta": 0.0}),
    "odometry reset": lie(lambda said, true, by: {"x": said.x + by[0], "y": said.y + by[1]}, leap),
    "heading leaps": lie(
        lambda said, true, turn: {"theta": said.theta + turn}, lambda rng: rng.choice([-1.0, 1.0]) * rng.uniform(0.4, math.pi)
    ),
    "old odometry with fresh stamps": lie(  # the last second or two again and again
        lambda said, true, length: true[(len(true) - 1) % length]._asdict(), lambda rng: rng.randrange(20, 40)
    ),
    "odometry of another frame": lie(
        lambda said, true, frame: {"frame": frame}, lambda rng: rng.choice(["map", "", "robot2/odom"])
    ),
    "odometry of two robots by one node": lie(  # in turn
        lambda said, true, away: {"y": said.y + away * (len(true) % 2)}, lambda rng: rng.uniform(0.3, 2.0)
    ),
}
"""Lies of a driver that breaks while it drives."""
FROM_THE_START: dict[str, Maker] = {
    "turning rate of wrong sign": lie(lambda said, *_: {"omega": -said.omega}),
    "speed of wrong sign": lie(lambda said, *_: {"v": -said.v}),
    "heading of wrong sign": lie(lambda said, *_: {"theta": -said.theta}),
    "odometry in mm": scaled(lambda rng: (1000.0, LENGTHS)),
    "odometry in cm": scaled(lambda rng: (100.0, LENGTHS)),
    "degrees instead of radians": scaled(lambda rng: (math.degrees(1.0), rng.choice(ANGULAR))),
    "twist in the world's frame": lie(
        lambda said, *_: {"v": said.v * math.cos(said.theta), "across": said.v * math.sin(said.theta)}
    ),
    "x and y swapped": lie(lambda said, *_: {"x": said.y, "y": said.x}),
    "late heading": lie(  # by 0.3 to 0.5 s, as by a slow IMU
        lambda said, true, late: {"theta": true[max(len(true) - 1 - late, 0)].theta}, lambda rng: rng.randint(6, 10)
    ),
    "wrong scale": scaled(lambda rng: (rng.uniform(1.5, 3.0), rng.choice([LENGTHS, ("v",)]))),
}
"""Lies of a driver that was set up wrongly."""
TURNING = {"twist frozen", "heading frozen", "turning rate of wrong sign", "heading of wrong sign", "late heading"}
TURNING |= {"degrees instead of radians", "twist in the world's frame", "robot turns the other way"}
"""Lies that show only while the robot turns."""
NOT_LATCHED = {"odometry of another frame", "odometry of two robots by one node"}
"""Lies whose end is evidence enough to go on: each message says by itself whether it counts."""


def lies(
    robot: Robot, rng: random.Random, name: str, maker: Maker | None = None, turns: Wheels = obeying, by_hand: Any = None
) -> list[str]:
    """A driver lies, or its wheels turn otherwise, while a program drives, or a person who commands m/s and rad/s."""
    if name in FROM_THE_START:  # a person stops the robot, and carries it back to its start
        robot.ros.ask("velocity_controller/enable", data=False)
        robot.enable(False)
        robot.reset_world()
    if by_hand:
        robot.teleop = by_hand
        time.sleep(1.0)  # until it moves so
    with robot.lock:
        robot.driver.turns = turns
        robot.driver.tells(maker(rng) if maker else None)
    if name in FROM_THE_START:
        robot.begin()
    if name in TURNING:  # somewhere aside, not so far that it would rather drive backwards
        robot.send_goal(rng.choice([-1.0, 1.0]) * rng.uniform(0.9, 1.4))
    at = until_seen(robot)
    if name == "wrong scale":  # what is said must be more than what was commanded, unless the robot stands
        begun = robot.driver.unexplained
        while robot.driver.unexplained - begun < EXCUSE and time.time() < at + VISIBLE and not robot.stood(at, TIME):
            time.sleep(0.01)
        at = time.time()
    time.sleep(max(0.0, at + 2.0 * TIME - time.time()))  # it must not move now and then either
    reasons, now = robot.strays(at), time.time()
    if name in NOT_LATCHED:
        return reasons
    moved = robot.record.in_force(now - 0.1, now)
    with robot.lock:
        robot.driver.turns = obeying
        robot.driver.tells(None)
    return reasons + ([] if moved else robot.must_stand(now, 2.0))


def until_seen(robot: Robot) -> float:
    """Wait until the lie could be seen, or a filter that sees more does not believe it and the robot stands; return when, s."""
    since = time.time()
    while (at := robot.driver.seen_at) is None:
        if robot.stood(since, TIME) and any("odometry is not believed" in text for text in robot.ros.complaints(since)):
            return time.time()
        if time.time() > since + VISIBLE:
            raise Unseen("the lie could not be seen")
        time.sleep(0.01)
    return at


def blocked(v: float, omega: float) -> tuple[float, float]:
    """Something holds the robot, or the emergency stop of its base is pressed."""
    return 0.0, 0.0


def spinning(robot: Robot, rng: random.Random) -> list[str]:
    """The wheels spin, and the odometry says that the robot drives."""
    robot.driver.grips = blocked
    return robot.must_stand(time.time() + SPIN)


def fence(robot: Robot, rng: random.Random, radius: float, maker: Maker | None = None) -> list[str]:
    """A program drives towards a fence, m, and its driver may lie shortly before it reaches that."""
    robot.chain.restart(GUARD, geofence=f"{radius}")
    robot.reset_world()
    robot.until(robot.begin)
    if maker:
        robot.until(lambda: robot.world.pose[0] > radius - 0.2, 5.0)
        robot.driver.tells(maker(rng))
    time.sleep(6.0)
    away = math.hypot(*robot.world.pose[:2]) - radius
    return [f"it left its fence of {radius} m by {away:.2f} m"] if away > 0.1 else []


FROZEN = FROM_THEN_ON["pose and twist frozen"]
ROWS: dict[str, dict[str, Any]] = {
    **{name: {"maker": maker} for name, maker in {**FROM_THEN_ON, **FROM_THE_START}.items()},
    "pose and twist frozen, a person drives": {"maker": FROZEN, "by_hand": (0.15, 0.0)},
    "pose and twist frozen, a person reverses": {"maker": FROZEN, "by_hand": (-0.15, 0.0)},
    "pose and twist frozen, a person turns": {"maker": FROZEN, "by_hand": (0.0, 1.0)},
    "robot turns the other way": {"turns": lambda v, omega: (v, -omega)},
    "robot blocked": {"turns": blocked},
    "robot blocked, a person drives": {"turns": blocked, "by_hand": (0.15, 0.0)},
}
LIARS: dict[str, Fault] = {
    **{name: partial(lies, name=name, **row) for name, row in ROWS.items()},
    "wheels spin": spinning,
    "fence ahead": partial(fence, radius=0.8),
    "pose and twist frozen at a fence": partial(fence, radius=0.5, maker=FROZEN),
}
