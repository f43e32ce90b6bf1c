"""Faults of a LiDAR: the robot drives towards a wall or a post, and must not touch it in half a minute.

A LiDAR that is covered says so nowhere: its driver sends 0, or infinity, as for a free hall.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faults_robot import Fault, Robot
from faults_world import ANGLES, BEAMS, DEAD_END, FARTHEST, ROUGHNESS, advance, away

WATCHED, STANDING, SCANS_COUNT = 30.0, 10.0, 0.4
"""Times for which the robot is watched before a wall, after which one that stands no longer is, and a scan counts, s."""
BESIDE = 0.06
"""Least distance to the wall at which a robot with a healthy LiDAR stops, m: its margin of 0.05 m, which grows with a range."""
WIDTHS = math.radians(40.0), math.radians(180.0)
"""Least and greatest width of a sector that says nothing, rad."""
LEFT, RIGHT = 0.5 * math.pi, -0.5 * math.pi
Lie = Callable[[Sequence[Any]], Any]
"""Returns what the LiDAR sends instead of the last of the scans since the lie began, five a second; None for nothing."""
Maker = Callable[[random.Random], Lie]
"""Makes a new lie, and chooses among the members of its class."""


def towards_wall(robot: Robot, lie: Lie = lambda scans: scans[-1]) -> None:
    """Drive towards a wall with a LiDAR that lies, until the robot touches it, stands, or was watched for long enough."""
    since, scans = time.time(), list[Any]()

    def scan(message: Any) -> Any:
        scans.append(message)
        return lie(scans)

    robot.world.walls, robot.scan = DEAD_END, scan
    while time.time() < since + WATCHED and robot.record.nearest(since) > 0.0 and not robot.stood(since, STANDING):
        time.sleep(0.05)


def wall(robot: Robot, rng: random.Random, maker: Maker, sides: tuple[float, ...] = ()) -> None:
    """The LiDAR lies before a wall; or a person drives a curve around a post on a side, 1 for the left, that is too near."""
    if sides:
        side, after, inside = rng.choice(sides), rng.uniform(2.5, 5.0), rng.uniform(0.10, 0.13)
        x, y, theta = advance(robot.world.pose, 0.15, side * 0.35, after)
        robot.world.posts = [(x - side * inside * math.sin(theta), y + side * inside * math.cos(theta), 0.05)]
        robot.teleop = (0.15, side * 0.35)
    towards_wall(robot, maker(rng))


def changed(change: Callable[[NDArray[np.float64]], Any]) -> Lie:
    """Return the lie that changes the ranges of each scan."""

    def lie(scans: Sequence[Any]) -> Any:
        scans[-1].ranges = [float(distance) for distance in change(np.array(scans[-1].ranges))]
        return scans[-1]

    return lie


def always(change: Callable[[NDArray[np.float64]], Any]) -> Maker:
    """Return the maker of a lie that is always the same."""
    return lambda rng: changed(change)


def scaled(scans: Sequence[Any], factor: float) -> Any:
    """Ranges and their limits are in another unit."""
    scans[-1].range_min, scans[-1].range_max = factor * scans[-1].range_min, factor * scans[-1].range_max
    return changed(lambda ranges: factor * ranges)(scans)


def another_frame(scans: Sequence[Any]) -> Any:
    """The scan is of another LiDAR, which looks elsewhere."""
    scans[-1].header.frame_id = "camera_depth_frame"
    return changed(free_hall)(scans)


def late(rng: random.Random, *, fresh: bool) -> Lie:
    """Scans are late by some of them, and say so or have fresh stamps."""
    number = rng.randint(4, 7) if fresh else rng.choice([5, 10, 25])

    def lie(scans: Sequence[Any]) -> Any:
        if len(scans) <= number:
            return None
        if fresh:
            scans[-1 - number].header.stamp = scans[-1].header.stamp
        return scans[-1 - number]

    return lie


def frozen(rng: random.Random, noise: Sequence[float], widths: tuple[float, float] = (7.0, 7.0)) -> Lie:
    """A sector ahead, by default the whole circle, repeats its last ranges with a noise, m."""
    deviation, inside, kept = rng.choice(noise), away(ANGLES, 0.0) <= 0.5 * rng.uniform(*widths), list[Any]()

    def freeze(ranges: Any) -> Any:
        kept.append(ranges)
        return np.where(inside, kept[0] + [rng.gauss(0.0, deviation) for _ in ANGLES], ranges)

    return changed(freeze)


def silent(rng: random.Random, center: float = 0.0, period: tuple[float, float] | None = None) -> Lie:
    """A sector around a direction, rad, returns nothing, as 0 or as infinity; for good, or for a period now and then, s."""
    inside, lost = away(ANGLES, center) <= 0.5 * rng.uniform(*WIDTHS), rng.choice([0.0, math.inf])
    lasts, since = rng.uniform(*period) if period else math.inf, time.time()
    return changed(lambda ranges: np.where(inside & ((time.time() - since) // lasts % 2 == 0), lost, ranges))


def cut(scans: Sequence[Any], first: int, number: int, step: int = 1) -> Any:
    """The LiDAR has only some of its beams."""
    scan = scans[-1]
    scan.ranges = [scan.ranges[(first + k * step) % BEAMS] for k in range(number)]
    scan.angle_min, scan.angle_increment = first * scan.angle_increment, step * scan.angle_increment
    scan.angle_max = scan.angle_min + (number - 1) * scan.angle_increment
    return scan


def few(number: int) -> Lie:
    """The LiDAR has few beams, and none straight ahead."""
    return partial(cut, first=BEAMS // number // 2, number=number, step=BEAMS // number)


def sector(center: float, degrees: float) -> Lie:
    """Messages hold only a part of the circle around a direction, rad."""
    width = math.radians(degrees)
    return partial(cut, first=round((center - 0.5 * width) / ANGLES[1]), number=round(width / ANGLES[1]) + 1)


def partial_view(rng: random.Random, center: float) -> Lie:
    """240 degrees say nothing, or are not in the message; one that says infinity there cannot be told from one in a hall."""
    hidden = changed(lambda ranges: np.where(away(ANGLES, center) <= math.radians(60.0), ranges, math.nan))
    return rng.choice([hidden, sector(center, 120.0)])


def free_hall(*_: Any) -> list[float]:
    """Return the ranges of a free hall, m."""
    return [FARTHEST - 0.5 + random.gauss(0.0, ROUGHNESS) for _ in range(BEAMS)]


def second_source(robot: Robot, rng: random.Random) -> None:
    """Another robot, in a free hall, publishes its scans on the same topic at 1 to 20 Hz."""
    rate, speaker = rng.choice([1.0, 2.0, 5.0, 10.0, 20.0]), robot.ros.speaker("scan", 2)
    robot.beside = lambda message, now: speaker.publish(robot.scan_of(free_hall(), now)) if rng.random() < rate / 20.0 else None
    towards_wall(robot)


def scans_end(robot: Robot, rng: random.Random) -> list[str]:
    """The scans end while a wall is still far away: the robot stands when the last one is too old."""
    robot.scan = lambda message: None
    return robot.must_stand(time.time() + SCANS_COUNT + 0.3, rng.uniform(1.0, 3.0))


def ahead_only(robot: Robot, rng: random.Random) -> None:
    """A LiDAR sees only 60 degrees ahead; a person turns towards what it does not see, and drives."""
    robot.teleop = (0.15, rng.choice([-0.21, 0.21]))  # it meets the wall beside it with its side
    towards_wall(robot, sector(0.0, 60.0))


def post_between_beams(robot: Robot, rng: random.Random) -> None:
    """A post stands ahead, between two beams that are wider apart than the robot."""
    robot.world.posts = [(rng.uniform(0.9, 1.1), 0.0, rng.uniform(0.05, 0.2))]
    towards_wall(robot, few(rng.choice([4, 6, 8])))


def healthy(robot: Robot, rng: random.Random, *, forwards: bool) -> list[str]:
    """Everything works, and the robot, driven by a program or a person, stops by itself before a wall or a post."""
    since = time.time()
    if forwards and rng.random() < 0.3:
        robot.world.posts = [(rng.uniform(1.0, 1.1), 0.0, 0.1)]
    if rng.random() < 0.5:
        robot.teleop = (0.2 if forwards else -0.2, 0.0)
    elif not forwards:
        robot.send_goal(math.pi)
    towards_wall(robot)
    nearest = robot.record.nearest(since)
    return [f"a healthy robot stopped only {nearest:.3f} m from a wall"] if nearest < BESIDE else []


LIES: dict[str, Maker] = {
    "scans late": partial(late, fresh=False),
    "scans late with fresh stamps": partial(late, fresh=True),
    "LiDAR frozen": partial(frozen, noise=[0.0]),
    "LiDAR frozen, with noise": partial(frozen, noise=[ROUGHNESS]),
    "LiDAR frozen ahead": partial(frozen, noise=[0.0, ROUGHNESS], widths=WIDTHS),
    "LiDAR covered": always(lambda ranges: math.nan * ranges),
    "LiDAR all zero": always(np.zeros_like),
    "LiDAR all infinite": always(lambda ranges: math.inf * ranges),
    "LiDAR turned by 180 degrees": always(lambda ranges: np.roll(ranges, BEAMS // 2)),
    "LiDAR in another unit": lambda rng: partial(scaled, factor=rng.choice([1000.0, 100.0, 39.37])),
    "LiDAR of another frame": lambda rng: another_frame,
    "LiDAR of four beams": lambda rng: few(4),
    "LiDAR that sees only behind": partial(partial_view, center=math.pi),
    "LiDAR that sees only the left": partial(partial_view, center=LEFT),
    "LiDAR that sees only the right": partial(partial_view, center=RIGHT),
    "LiDAR silent ahead": silent,
    "LiDAR silent now and then": partial(silent, period=(0.5, 3.0)),
}
ON_A_SIDE: dict[str, tuple[Maker, tuple[float, ...]]] = {
    "LiDAR silent on the left": (partial(silent, center=LEFT), (1.0,)),
    "LiDAR silent on the right": (partial(silent, center=RIGHT), (-1.0,)),
    "LiDAR upside down": (always(lambda ranges: ranges[-np.arange(BEAMS)]), (1.0, -1.0)),
}
WALLS: dict[str, Fault] = {
    "healthy wall": partial(healthy, forwards=True),
    "healthy wall behind": partial(healthy, forwards=False),
    "scans end": scans_end,
    "second source of scans": second_source,
    "post between beams": post_between_beams,
    "LiDAR that sees only ahead": ahead_only,
    **{name: partial(wall, maker=maker) for name, maker in LIES.items()},
    **{name: partial(wall, maker=maker, sides=sides) for name, (maker, sides) in ON_A_SIDE.items()},
}
