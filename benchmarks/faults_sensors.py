"""Faults of what is measured: old measurements, clocks and sensors, see `faults_kinds`."""

from __future__ import annotations

import copy
import math
import random
import time
from collections.abc import Callable
from typing import Any

from faults_robot import Fault, Robot, nothing
from faults_world import DEAD_END

ZONE = 0.02
"""Distance between footprint and wall within which no motion towards it may be, m: less than half of the guard's margin."""


def odometry_late(robot: Robot, rng: random.Random) -> int:
    """Odometry is late by 0.5 to 30 s and says so; in half of the cases the filter begins with it."""
    late = rng.choice([0.5, 0.7, 1.0, 2.0, 5.0, 30.0])

    def delay(message: Any, now: float) -> list[tuple[Any, float]]:
        stamp = robot.clock(now - late)
        message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(stamp % 1.0 * 1e9)
        return [(message, now - late)]

    robot.record.began, robot.odometry = time.time(), delay
    if rng.random() < 0.5:
        robot.ask("kalman_filter/reset", 1.0)
    time.sleep(1.5)
    return 0


def odometry_burst(robot: Robot, rng: random.Random) -> int:
    """A radio holds the odometry of 1.5 s back, delivers it at once 0.6 to 2 s later, and is dead."""
    held: list[tuple[Any, float]] = []
    robot.odometry = lambda message, now: held.append((message, now)) or []
    time.sleep(1.5)
    robot.odometry = nothing
    time.sleep(rng.uniform(0.6, 2.0))
    with robot.lock:
        for message, measured in held:
            robot.record.rests_on(measured)
            robot.speaker("odom", "Odometry").publish(message)
    time.sleep(1.2)
    return 0


def odometry_dies(robot: Robot, rng: random.Random) -> int:
    """Odometry ends."""
    robot.record.began, robot.odometry = time.time(), nothing
    time.sleep(1.2)
    return 0


def odometry_repeats(robot: Robot, rng: random.Random) -> int:
    """The last odometry is sent again and again."""
    kept: list[tuple[Any, float]] = []

    def repeat(message: Any, now: float) -> list[tuple[Any, float]]:
        kept.append((message, now))
        return kept[:1]

    robot.record.began, robot.odometry = time.time(), repeat
    time.sleep(1.5)
    return 0


def odometry_impossible(robot: Robot, rng: random.Random) -> int:
    """Odometry jumps by 5 m, states a speed of 50 m/s, or a variance that is no number: the robot stands 0.7 s later."""
    fault = rng.choice(["jump", "speed", "variance"])

    def spoil(message: Any, now: float) -> list[tuple[Any, float]]:
        if fault == "jump":
            message.pose.pose.position.x += 5.0
        elif fault == "speed":
            message.twist.twist.linear.x = 50.0
        else:
            message.pose.covariance[0] = math.nan
        return [(message, now)]

    robot.record.began = at = time.time()
    robot.odometry = spoil
    time.sleep(1.5)
    return robot.record.moving(at + 0.7)


def scan_late(robot: Robot, rng: random.Random) -> int:
    """Scans are late by 0.7 to 5 s and say so, towards a wall."""
    late, kept = rng.choice([0.7, 1.0, 5.0]), []
    robot.world.walls = DEAD_END

    def delay(message: Any) -> Any:
        kept.append((time.time(), message))
        due = [message for at, message in kept if at <= time.time() - late]
        return due[-1] if due else None

    return _towards_wall(robot, delay)


# Clocks


def clocks(kind: str) -> Fault:
    """Return the fault in which the robot's clock is off, is set, or drifts, and the odometry dies at last."""

    def fault(robot: Robot, rng: random.Random) -> int:
        size, began = rng.choice([-2.0, -1.0, -0.775, -0.3, 0.3, 0.775, 1.0, 2.0]), time.time()
        drift = (lambda now: now + 0.05 * size * (now - began)) if kind == "drift" else lambda now: now + size
        robot.clock = drift
        if kind == "offset":
            robot.ask("kalman_filter/reset", 1.0)
            robot.ask("velocity_controller/enable", 1.0, data=True)
        time.sleep(2.0)
        robot.odometry = nothing
        time.sleep(1.0)
        return 0

    return fault


# Sensors that lie


def _towards_wall(robot: Robot, scan: Callable[[Any], Any]) -> int:
    """Drive towards a wall with a LiDAR that lies, and count whether the robot came too near."""
    robot.record.began = since = time.time()
    robot.world.walls, robot.scan = DEAD_END, scan
    time.sleep(6.0)
    return int(robot.record.nearest(since) < ZONE)


def lidar(spoil: Callable[[Any], Any]) -> Fault:
    """Return the fault in which a LiDAR changes what it sends."""

    def fault(robot: Robot, rng: random.Random) -> int:
        return _towards_wall(robot, spoil)

    return fault


def lidar_frozen(robot: Robot, rng: random.Random) -> int:
    """The LiDAR repeats its last ranges with fresh stamps."""
    kept: list[Any] = []

    def freeze(message: Any) -> Any:
        kept.append(message.ranges)
        message.ranges = kept[0]
        return message

    return _towards_wall(robot, freeze)


def filled(value: float, share: float = 1.0) -> Callable[[Any], Any]:
    def fill(message: Any) -> Any:
        count = len(message.ranges)
        message.ranges = [value if k < share * count else distance for k, distance in enumerate(message.ranges)]
        return message

    return fill


def turned(message: Any) -> Any:
    half = len(message.ranges) // 2
    message.ranges = [*message.ranges[half:], *message.ranges[:half]]
    return message


def four_beams(message: Any) -> Any:
    step = len(message.ranges) // 4
    message.ranges = list(message.ranges)[step // 2 :: step]
    message.angle_min, message.angle_increment = message.angle_increment * (step // 2), 0.5 * math.pi
    message.angle_max = message.angle_min + 1.5 * math.pi
    return message


def wrong_fix(robot: Robot, rng: random.Random) -> int:
    """One fix says that the robot is far away; what moves then must still rest on fresh measurements."""
    message = robot.stamped("PoseWithCovarianceStamped", "odom", robot.clock(time.time()))
    message.pose.pose.position.x, message.pose.pose.orientation.w = rng.choice([1e3, -1e3, 1e300]), 1.0
    for at in (0, 7, 35):
        message.pose.covariance[at] = rng.choice([1e-4, 1e-300])
    estimates: list[float] = []
    hear: Any = lambda estimate: estimates.append(estimate.pose.pose.position.x)  # noqa: E731
    subscription = robot.node.create_subscription(robot.kinds["Odometry"], "estimate", hear, 10)
    time.sleep(0.3)
    robot.speaker("pose_fix", "PoseWithCovarianceStamped", 2).publish(message)
    time.sleep(1.0)
    robot.node.destroy_subscription(subscription)
    return sum(abs(x) > 10.0 for x in estimates)


def two_odometries(robot: Robot, rng: random.Random) -> int:
    """Another publisher of odometry says that the robot is 2 m away, and stays when the robot's own ends."""
    robot.record.began = since = time.time()

    def both(message: Any, now: float) -> list[tuple[Any, float]]:
        other = copy.deepcopy(message)
        other.pose.pose.position.x += 2.0
        robot.speaker("odom", "Odometry", 2).publish(other)
        return [(message, now)] if now < since + 1.0 else []

    robot.odometry = both
    time.sleep(3.0)
    return 0
