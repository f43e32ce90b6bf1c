"""Faults of what says where the robot is: odometry that is old or impossible, clocks, and fixes; see `faults_kinds`."""

from __future__ import annotations

import copy
import math
import random
import signal
import time
from typing import Any

from faults_robot import Fault, Robot, nothing


def odometry_late(robot: Robot, rng: random.Random) -> list[str]:
    """Odometry is late by 0.5 to 30 s and says so; in half of the cases the filter begins with it."""
    late = rng.choice([0.5, 0.7, 1.0, 2.0, 5.0, 30.0])

    def delay(message: Any, now: float) -> list[tuple[Any, float]]:
        stamp = robot.clock(now - late)
        message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(stamp % 1.0 * 1e9)
        return [(message, now - late)]

    robot.record.began, robot.odometry = time.time(), delay
    if rng.random() < 0.5:
        robot.ros.ask("kalman_filter/reset", 1.0)
    time.sleep(1.5)
    return []


def odometry_burst(robot: Robot, rng: random.Random) -> list[str]:
    """A radio holds the odometry of 1.5 s back, delivers it at once 0.6 to 2 s later, and is dead."""
    held: list[tuple[Any, float]] = []
    robot.odometry = lambda message, now: held.append((message, now)) or []
    time.sleep(1.5)
    robot.odometry = nothing
    time.sleep(rng.uniform(0.6, 2.0))
    with robot.lock:
        for message, measured in held:
            robot.record.rests_on(measured)
            robot.ros.speaker("odom", "Odometry").publish(message)
    time.sleep(1.2)
    return []


def odometry_dies(robot: Robot, rng: random.Random) -> list[str]:
    """Odometry ends."""
    robot.record.began, robot.odometry = time.time(), nothing
    time.sleep(1.2)
    return []


def odometry_repeats(robot: Robot, rng: random.Random) -> list[str]:
    """The last odometry is sent again and again."""
    kept: list[tuple[Any, float]] = []

    def repeat(message: Any, now: float) -> list[tuple[Any, float]]:
        kept.append((message, now))
        return kept[:1]

    robot.record.began, robot.odometry = time.time(), repeat
    time.sleep(1.5)
    return []


def odometry_impossible(robot: Robot, rng: random.Random) -> list[str]:
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
    return robot.moves_on(at + 0.7)


# Clocks


def clocks(kind: str) -> Fault:
    """Return the fault in which the robot's clock is off, is set, or drifts, and the odometry dies at last."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        size, began = rng.choice([-2.0, -1.0, -0.775, -0.3, 0.3, 0.775, 1.0, 2.0]), time.time()
        drift = (lambda now: now + 0.05 * size * (now - began)) if kind == "drift" else lambda now: now + size
        robot.clock = drift
        if kind == "offset":
            robot.ros.ask("kalman_filter/reset", 1.0)
            robot.ros.ask("velocity_controller/enable", 1.0, data=True)
        time.sleep(2.0)
        robot.odometry = nothing
        time.sleep(1.0)
        return []

    return fault


# What else says where the robot is


def wrong_fix(robot: Robot, rng: random.Random) -> list[str]:
    """One fix says that the robot is far away; what moves then must still rest on fresh measurements."""
    message = robot.ros.stamped("PoseWithCovarianceStamped", "odom", robot.clock(time.time()))
    message.pose.pose.position.x, message.pose.pose.orientation.w = rng.choice([1e3, -1e3, 1e300]), 1.0
    for at in (0, 7, 35):
        message.pose.covariance[at] = rng.choice([1e-4, 1e-300])
    estimates: list[float] = []
    subscription = robot.ros.hear("estimate", "Odometry", lambda estimate: estimates.append(estimate.pose.pose.position.x))
    time.sleep(0.3)
    robot.ros.speaker("pose_fix", "PoseWithCovarianceStamped", 2).publish(message)
    time.sleep(1.0)
    robot.ros.node.destroy_subscription(subscription)
    return ["the estimate follows a wrong fix"] if any(abs(x) > 10.0 for x in estimates) else []


def hostile_variances(robot: Robot, rng: random.Random) -> list[str]:
    """A fix, or a person's pose, where the robot is, with variances that no sensor has."""
    topic, x = rng.choice(["pose_fix", "initialpose"]), robot.driver.says(time.time()).x
    message = robot.ros.stamped("PoseWithCovarianceStamped", "odom", robot.clock(time.time()))
    message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1.0
    for variance in (0.0, 1e-170, 1e-308, 5e-324, -1.0, math.inf, math.nan, 1e308):
        for at in rng.choice([(0, 7, 35), (0, 7), (35,)]):
            message.pose.covariance[at] = variance
        message.header.stamp = robot.ros.stamped("Odometry", "", robot.clock(time.time())).header.stamp
        robot.ros.speaker(topic, "PoseWithCovarianceStamped", 2).publish(message)
        time.sleep(0.2)
    time.sleep(0.5)
    return []


def two_odometries(robot: Robot, rng: random.Random) -> list[str]:
    """Another publisher of odometry says the same, nearly the same or another place, and stays when the robot's own ends."""
    away = rng.choice([0.0, 0.02, 0.5])
    robot.ros.speaker("odom", "Odometry", 2)
    robot.record.began = since = time.time()

    def both(message: Any, now: float) -> list[tuple[Any, float]]:
        other = copy.deepcopy(message)
        other.pose.pose.position.x += away
        robot.ros.speaker("odom", "Odometry", 2).publish(other)
        return [(message, now)] if now < since + 1.0 else []

    robot.odometry = both
    time.sleep(3.0)
    return []


def stranger(*, filter_ends: bool) -> Fault:
    """Return the fault in which a stranger says at 20 Hz that the robot stands where it was, beside the filter or after it.

    A filter that is killed is in the graph for its lease of 20 s, so the robot is watched for longer.
    """

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        speaker = robot.ros.speaker("estimate", "Odometry", 2)
        here = robot.driver.says(time.time())._replace(v=0.0, omega=0.0)

        def estimate(message: Any, now: float) -> list[tuple[Any, float]]:
            other = robot.odometry_of(here, now)
            for at in (0, 7, 35):
                other.pose.covariance[at] = other.twist.covariance[at] = 1e-4
            speaker.publish(other)
            return [(message, now)]

        robot.record.began, robot.odometry = time.time(), estimate
        if filter_ends:
            robot.record.began = robot.chain.signal("kalman_filter", signal.SIGKILL)
        at = time.time()
        time.sleep(25.0 if filter_ends else 3.0)
        robot.ros.catch_up()
        return robot.record.strays(at, time.time())

    return fault


def second_waypoints(robot: Robot, rng: random.Random) -> list[str]:
    """Another source of waypoints sends the robot aside at 1 to 20 Hz."""
    speaker, side, period = robot.ros.speaker("reference", "PoseStamped", 2), rng.choice([-1.0, 1.0]), rng.choice([1, 4, 20])
    calls = iter(range(10**9))

    def reference(message: Any, now: float) -> list[tuple[Any, float]]:
        if next(calls) % period == 0:
            other = robot.ros.stamped("PoseStamped", "odom", robot.clock(now))
            other.pose.position.y, other.pose.orientation.w = 50.0 * side, 1.0
            speaker.publish(other)
        return [(message, now)]

    robot.record.began, robot.odometry = time.time(), reference
    at = time.time()
    time.sleep(3.0)
    robot.ros.catch_up()
    return robot.record.strays(at, time.time())


def rolled_over(robot: Robot, rng: random.Random) -> list[str]:
    """The stamps of the odometry roll over, to a counter's zero or into the past, and it ends at last."""
    began = time.time()
    past = rng.choice([began, began - 2.0**32 * 1e-9, began - 2.0**31 * 1e-3])
    robot.clock = lambda now: now - past if past == began else now - (began - past)
    time.sleep(rng.uniform(1.0, 2.0))
    robot.record.began, robot.odometry = time.time(), nothing
    time.sleep(1.2)
    return []
