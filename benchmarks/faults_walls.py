"""Faults of a LiDAR: the robot drives towards a wall or a post, and must not touch it in half a minute; see `faults_kinds`."""

from __future__ import annotations

import math
import random
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from faults_robot import Fault, Robot
from faults_world import ANGLES, BEAMS, DEAD_END, FARTHEST, ROUGHNESS, advance

WATCHED = 30.0
"""Time for which the robot is watched, s: at the speed at which it may enter unknown space it reaches the wall in it."""
STANDING = 10.0
"""Time after which a robot that stands is watched no longer, s: one that creeps does not stand."""
AHEAD = 0.0
"""Direction in which it drives, rad."""
BESIDE = 0.06
"""Least distance to the wall at which a robot with a healthy LiDAR stops, m: its margin of 0.05 m, which grows with a range."""
SCANS_COUNT = 0.4
"""Age from which a scan no longer counts, s."""


def towards_wall(robot: Robot, scan: Callable[[Any], Any], watched: float = WATCHED) -> list[str]:
    """Drive towards a wall with a LiDAR that lies, until the robot touches it, stands, or was watched for a time, s."""
    robot.record.began = since = time.time()
    robot.world.walls, robot.scan = DEAD_END, scan
    while (now := time.time()) < since + watched and robot.record.nearest(since) > 0.0:
        if now > since + STANDING and not robot.record.in_force(now - STANDING, now):
            break
        time.sleep(0.05)
    return []


def within(center: float, width: float) -> Any:
    """Return which beams are within a sector around a direction, both in rad."""
    return np.abs(np.remainder(ANGLES - center + math.pi, 2.0 * math.pi) - math.pi) <= 0.5 * width


def post_beside(robot: Robot, rng: random.Random, side: float) -> None:
    """Let a person drive a curve around a post that is too near, on a side, 1 for the left."""
    after, inside = rng.uniform(2.5, 5.0), rng.uniform(0.10, 0.13)
    v, omega = 0.15, side * 0.35
    x, y, theta = advance(robot.world.pose, v, omega, after)
    robot.world.posts = [(x - side * inside * math.sin(theta), y + side * inside * math.cos(theta), 0.05)]
    robot.teleop = (v, omega)


def lidar(spoil: Callable[[Any], Any]) -> Fault:
    """Return the fault in which a LiDAR changes what it sends."""
    return lambda robot, rng: towards_wall(robot, spoil)


# Ranges that are no measurements


def filled(value: float) -> Callable[[Any], Any]:
    """Return the change by which every beam says the same."""

    def fill(message: Any) -> Any:
        message.ranges = [value] * len(message.ranges)
        return message

    return fill


def frozen(noise: float) -> Fault:
    """Return the fault in which the LiDAR repeats its last ranges with fresh stamps and a noise, m."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        kept: list[Any] = []

        def freeze(message: Any) -> Any:
            kept.append(message.ranges)
            message.ranges = [distance + rng.gauss(0.0, noise) for distance in kept[0]]
            return message

        return towards_wall(robot, freeze)

    return fault


def late(robot: Robot, rng: random.Random) -> list[str]:
    """Scans are late by 1 to 5 s and say so."""
    return towards_wall(robot, _delayed(rng.choice([1.0, 2.0, 5.0]), fresh=False))


def late_with_fresh_stamps(robot: Robot, rng: random.Random) -> list[str]:
    """Scans are late by 0.8 to 1.5 s, and their stamps hide it."""
    return towards_wall(robot, _delayed(rng.uniform(0.8, 1.5), fresh=True))


def _delayed(by: float, *, fresh: bool) -> Callable[[Any], Any]:
    kept: deque[tuple[float, Any]] = deque()

    def delay(message: Any) -> Any:
        stamp = message.header.stamp
        kept.append((time.time(), message))
        due = None
        while kept and kept[0][0] <= time.time() - by:
            due = kept.popleft()[1]
        if due is not None and fresh:
            due.header.stamp = stamp
        return due

    return delay


def ends(robot: Robot, rng: random.Random) -> list[str]:
    """The scans end while a wall is still far away: the robot stands when the last one is too old."""
    robot.scan = lambda message: None
    robot.record.began = at = time.time()
    time.sleep(rng.uniform(1.5, 4.0))
    return robot.moves_on(at + SCANS_COUNT + 0.3)


# Directions


def turned(message: Any) -> Any:
    """The LiDAR is mounted turned by half a turn."""
    half = len(message.ranges) // 2
    message.ranges = [*message.ranges[half:], *message.ranges[:half]]
    return message


def mirrored(message: Any) -> Any:
    """The LiDAR is mounted upside down."""
    message.ranges = [message.ranges[0], *reversed(message.ranges[1:])]
    return message


def upside_down(robot: Robot, rng: random.Random) -> list[str]:
    """The LiDAR is mounted upside down; a person drives a curve around a post that is seen on the other side."""
    post_beside(robot, rng, rng.choice([-1.0, 1.0]))
    return towards_wall(robot, mirrored)


def another_frame(message: Any) -> Any:
    """The scan is of another LiDAR, which looks elsewhere."""
    message.header.frame_id = "camera_depth_frame"
    message.ranges = _free()
    return message


def _free() -> list[float]:
    """Return the ranges of a free hall, m."""
    return [FARTHEST - 0.5 + random.gauss(0.0, ROUGHNESS) for _ in range(BEAMS)]


def sector(center: float, width: float) -> Callable[[Any], Any]:
    """Return the change by which a LiDAR sees only a part of the circle around a direction; both in rad."""
    begin = round((center - 0.5 * width) / ANGLES[1])
    seen = [(begin + k) % BEAMS for k in range(round(width / ANGLES[1]) + 1)]

    def cut(message: Any) -> Any:
        message.ranges = [message.ranges[k] for k in seen]
        message.angle_min = begin * message.angle_increment
        message.angle_max = message.angle_min + (len(seen) - 1) * message.angle_increment
        return message

    return cut


def partial(center: float, width: float) -> Fault:
    """Return the fault of a LiDAR that sees only a part: the rest says nothing, or is not in the message; both in rad.

    A LiDAR that says of the rest that nothing returned cannot be told from one in a hall.
    """

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        seen = within(center, width)

        def hide(message: Any) -> Any:
            message.ranges = [distance if there else math.nan for distance, there in zip(message.ranges, seen, strict=True)]
            return message

        return towards_wall(robot, rng.choice([hide, sector(center, width)]))

    return fault


def ahead_only(robot: Robot, rng: random.Random) -> list[str]:
    """A LiDAR that sees only 60 degrees ahead; a person turns towards what it does not see, and drives."""
    robot.world.walls, robot.scan = DEAD_END, sector(0.0, math.radians(60.0))
    robot.record.began = since = time.time()
    robot.teleop = (0.15, rng.choice([-0.21, 0.21]))  # it meets the wall beside it with its side
    while time.time() < since + WATCHED and robot.record.nearest(since) > 0.0:
        time.sleep(0.05)
    return []


def beams(count: int) -> Callable[[Any], Any]:
    """Return the change by which a LiDAR has few beams, and none straight ahead."""

    def thin(message: Any) -> Any:
        step = len(message.ranges) // count
        message.ranges = list(message.ranges)[step // 2 :: step]
        message.angle_min, message.angle_increment = message.angle_increment * (step // 2), message.angle_increment * step
        message.angle_max = message.angle_min + (len(message.ranges) - 1) * message.angle_increment
        return message

    return thin


def post_between_beams(robot: Robot, rng: random.Random) -> list[str]:
    """A post stands ahead, between two beams that are wider apart than the robot."""
    robot.world.posts = [(rng.uniform(0.9, 1.1), 0.0, rng.uniform(0.05, 0.2))]
    return towards_wall(robot, beams(rng.choice([4, 6, 8])))


# Units, and sources


def in_another_unit(robot: Robot, rng: random.Random) -> list[str]:
    """Ranges and their limits are in mm, cm or inches."""
    factor = rng.choice([1000.0, 100.0, 39.37])

    def scale(message: Any) -> Any:
        message.ranges = [factor * distance for distance in message.ranges]
        message.range_min, message.range_max = factor * message.range_min, factor * message.range_max
        return message

    return towards_wall(robot, scale)


def second_source(robot: Robot, rng: random.Random) -> list[str]:
    """Another robot, in a free hall, publishes its scans on the same topic at 1 to 20 Hz."""
    period, due = 1.0 / rng.choice([1.0, 2.0, 5.0, 10.0, 20.0]), [time.time()]
    robot.ros.speaker("scan", "LaserScan", 2)

    def both(message: Any, now: float) -> list[tuple[Any, float]]:
        if now >= due[0]:
            due[0] += period
            robot.ros.speaker("scan", "LaserScan", 2).publish(robot.scan_of(_free(), now))
        return [(message, now)]

    robot.odometry = both
    return towards_wall(robot, lambda message: message)


def healthy(robot: Robot, rng: random.Random) -> list[str]:
    """Everything works, and the robot, driven by a program or a person, stops by itself before a wall or a post."""
    since = time.time()
    if rng.random() < 0.3:
        robot.world.posts = [(rng.uniform(1.0, 1.1), 0.0, 0.1)]
    if rng.random() < 0.5:
        robot.teleop = (0.2, 0.0)
    towards_wall(robot, lambda message: message)
    return _too_near(robot, since)


def healthy_behind(robot: Robot, rng: random.Random) -> list[str]:
    """Everything works, and the robot, sent or driven backwards, stops by itself before a wall."""
    since = time.time()
    if rng.random() < 0.5:
        robot.teleop = (-0.2, 0.0)
    else:
        robot.send_goal(math.pi)
    towards_wall(robot, lambda message: message)
    return _too_near(robot, since)


def _too_near(robot: Robot, since: float) -> list[str]:
    nearest = robot.record.nearest(since)
    return [f"a healthy robot stopped only {nearest:.3f} m from a wall"] if nearest < BESIDE else []
