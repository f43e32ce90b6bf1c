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
DISBELIEVED = "odometry is not believed"
"""What the filter says of a driver that lies."""
Maker = Callable[[random.Random], Lie]
"""Makes a new lie, and chooses among the members of its class."""


def drawn(draw: Callable[[random.Random], Any], say: Callable[[list[Said], Any], Said]) -> Maker:
    """Return the maker of a lie that depends on something drawn."""

    def make(rng: random.Random) -> Lie:
        chosen = draw(rng)
        return lambda true: say(true, chosen)

    return make


def changed(change: Callable[[Said], dict[str, Any]]) -> Maker:
    """Return the maker of a lie that changes each message in the same way."""
    return lambda rng: lambda true: true[-1]._replace(**change(true[-1]))


def frozen(*names: str) -> Maker:
    """Return the maker of a lie in which fields keep their first values, to the bit or with a noise of 0.1 mm and mrad."""
    return drawn(
        lambda rng: rng.choice([0.0, 1e-4]),
        lambda true, noise: true[-1]._replace(**{name: getattr(true[0], name) + random.gauss(0.0, noise) for name in names}),
    )


def by_factor(draw: Callable[[random.Random], tuple[float, tuple[str, ...]]]) -> Maker:
    """Return the maker of a lie in which some fields are multiplied."""
    return drawn(draw, lambda true, of: true[-1]._replace(**{name: of[0] * getattr(true[-1], name) for name in of[1]}))


def leaps(rng: random.Random) -> tuple[float, float]:
    """Draw a leap of 0.1 to 3 m, as when an odometry far from its start is reset."""
    distance, direction = rng.choice([0.1, 0.2, 0.35, 0.5, 0.8, 1.25, 2.0, 3.0]), rng.uniform(-math.pi, math.pi)
    return distance * math.cos(direction), distance * math.sin(direction)


LENGTHS = ("x", "y", "v")
FROM_THEN_ON: dict[str, Maker] = {
    "pose frozen": frozen("x", "y", "theta"),
    "twist frozen": frozen("v", "omega"),
    "pose and twist frozen": frozen("x", "y", "theta", "v", "omega"),
    "position frozen": frozen("x", "y"),
    "heading frozen": frozen("theta"),
    "twist zero": changed(lambda said: {"v": 0.0, "omega": 0.0}),
    "pose zero": changed(lambda said: {"x": 0.0, "y": 0.0, "theta": 0.0}),
    "odometry reset": drawn(leaps, lambda true, by: true[-1]._replace(x=true[-1].x + by[0], y=true[-1].y + by[1])),
    "heading leaps": drawn(
        lambda rng: rng.choice([-1.0, 1.0]) * rng.uniform(0.4, math.pi),
        lambda true, turn: true[-1]._replace(theta=true[-1].theta + turn),
    ),
    "old odometry with fresh stamps": drawn(  # the last second or two again and again
        lambda rng: rng.randrange(20, 40), lambda true, length: true[(len(true) - 1) % length]
    ),
    "odometry of another frame": drawn(
        lambda rng: rng.choice(["map", "", "robot2/odom"]), lambda true, frame: true[-1]._replace(frame=frame)
    ),
    "odometry of two robots by one node": drawn(  # in turn
        lambda rng: rng.uniform(0.3, 2.0), lambda true, away: true[-1]._replace(y=true[-1].y + away * (len(true) % 2))
    ),
}
"""Lies of a driver that breaks while it drives."""
FROM_THE_START: dict[str, Maker] = {
    "turning rate of wrong sign": changed(lambda said: {"omega": -said.omega}),
    "speed of wrong sign": changed(lambda said: {"v": -said.v}),
    "heading of wrong sign": changed(lambda said: {"theta": -said.theta}),
    "odometry in mm": by_factor(lambda rng: (1000.0, LENGTHS)),
    "odometry in cm": by_factor(lambda rng: (100.0, LENGTHS)),
    "degrees instead of radians": by_factor(
        lambda rng: (math.degrees(1.0), rng.choice([("theta",), ("omega",), ("theta", "omega")]))
    ),
    "twist in the world's frame": changed(
        lambda said: {"v": said.v * math.cos(said.theta), "across": said.v * math.sin(said.theta)}
    ),
    "x and y swapped": changed(lambda said: {"x": said.y, "y": said.x}),
    "late heading": drawn(  # by 0.3 to 0.5 s, as by a slow IMU
        lambda rng: rng.randint(6, 10), lambda true, late: true[-1]._replace(theta=true[max(len(true) - 1 - late, 0)].theta)
    ),
    "wrong scale": by_factor(lambda rng: (rng.uniform(1.5, 3.0), rng.choice([LENGTHS, ("v",)]))),
}
"""Lies of a driver that was set up wrongly."""
TURNING = {"twist frozen", "heading frozen", "turning rate of wrong sign", "heading of wrong sign", "late heading"}
TURNING |= {"degrees instead of radians", "twist in the world's frame"}
"""Lies that show only while the robot turns."""
NOT_LATCHED = {"odometry of another frame", "odometry of two robots by one node"}
"""Lies whose end is evidence enough to go on: each message says by itself whether it counts."""


def lies(robot: Robot, rng: random.Random, name: str, maker: Maker, by_hand: tuple[float, float] | None = None) -> list[str]:
    """A driver lies, from within a drive or from its start, of a program or of a person, who commands m/s and rad/s."""
    if name in FROM_THE_START:  # a person stops the robot, and carries it back to its start
        robot.ros.ask("velocity_controller/enable", data=False)
        robot.enable(False)
        robot.reset_world()
    if by_hand:
        robot.teleop = by_hand
        time.sleep(1.0)  # until it moves so
    with robot.lock:
        robot.driver.tells(maker(rng))
    if name in FROM_THE_START:
        robot.begin()
    if name in TURNING:
        turn_aside(robot, rng)
    at = until_seen(robot)
    if name == "wrong scale":
        at = until_adds_up(robot, at)
    reasons = stray(robot, at)
    return reasons if name in NOT_LATCHED else reasons + tells_the_truth(robot)


def wheels(robot: Robot, rng: random.Random, turn: Wheels, turning: bool = False, by_hand: bool = False) -> list[str]:
    """The wheels do not turn as commanded, and the driver says so."""
    robot.driver.turns = turn
    if by_hand:
        robot.teleop = (0.15, 0.0)
    if turning:
        turn_aside(robot, rng)
    return stray(robot, until_seen(robot)) + tells_the_truth(robot)


def turn_aside(robot: Robot, rng: random.Random) -> None:
    """Send the robot somewhere aside, not so far that it would rather drive backwards."""
    robot.send_goal(rng.choice([-1.0, 1.0]) * rng.uniform(0.9, 1.4))


def until_seen(robot: Robot) -> float:
    """Wait until the lie could be seen, and return when that was, s.

    A filter may see more than the judge: if the robot stands for `TIME` since the filter does not believe its odometry, the lie
    counts as seen.

    Raises:
        Unseen: If it could not.
    """
    since = time.time()
    while (at := robot.driver.seen_at) is None:
        now = time.time()
        stands = now > since + TIME and not robot.record.in_force(now - TIME, now)
        if stands and any(DISBELIEVED in complaint for complaint in robot.ros.complaints(since)):
            return now
        if now > since + VISIBLE:
            raise Unseen("the lie could not be seen")
        time.sleep(0.01)
    return at


def until_adds_up(robot: Robot, at: float) -> float:
    """Wait until what is said is `EXCUSE` m more than what was commanded since a time, s, or the robot stands; return when."""
    begun, now = robot.driver.unexplained, time.time()
    while robot.driver.unexplained - begun < EXCUSE and now < at + VISIBLE:
        time.sleep(0.01)
        now = time.time()
        if now > at + TIME and not robot.record.in_force(now - TIME, now):
            break
    return now


def stray(robot: Robot, at: float) -> list[str]:
    """Watch a robot whose driver's lie could be seen at a time, s, and return why its motion since then was unsafe."""
    time.sleep(max(0.0, at + 2.0 * TIME - time.time()))  # it must not move now and then either
    return robot.strays(at)


def tells_the_truth(robot: Robot) -> list[str]:
    """Let the driver tell the truth for 2 s, and return that the robot moved on by itself."""
    at = time.time()
    moved = robot.record.in_force(at - 0.1, at)
    with robot.lock:
        robot.driver.turns = obeying
        robot.driver.tells(None)
    return [] if moved else robot.must_stand(at, 2.0)


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
    robot.drive_again()
    if maker:
        robot.until(lambda: robot.world.pose[0] > radius - 0.2, 5.0, pause=0.01)
        robot.driver.tells(maker(rng))
    time.sleep(6.0)
    away = math.hypot(*robot.world.pose[:2]) - radius
    return [f"it left its fence of {radius} m by {away:.2f} m"] if away > 0.1 else []


FROZEN = FROM_THEN_ON["pose and twist frozen"]
BY_HAND = {"drives": (0.15, 0.0), "reverses": (-0.15, 0.0), "turns": (0.0, 1.0)}
LIARS: dict[str, Fault] = {
    **{name: partial(lies, name=name, maker=maker) for name, maker in {**FROM_THEN_ON, **FROM_THE_START}.items()},
    **{
        f"pose and twist frozen, a person {verb}": partial(lies, name="by hand", maker=FROZEN, by_hand=command)
        for verb, command in BY_HAND.items()
    },
    "robot turns the other way": partial(wheels, turn=lambda v, omega: (v, -omega), turning=True),
    "robot blocked": partial(wheels, turn=blocked),
    "robot blocked, a person drives": partial(wheels, turn=blocked, by_hand=True),
    "wheels spin": spinning,
    "fence ahead": partial(fence, radius=0.8),
    "pose and twist frozen at a fence": partial(fence, radius=0.5, maker=FROZEN),
}
