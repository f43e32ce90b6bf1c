"""Faults of what says where the robot is: odometry that is old or impossible, clocks, fixes, and strangers."""

from __future__ import annotations

import copy
import math
import random
import signal
import time
from functools import partial
from typing import Any

from faults_chain import FILTER
from faults_processes import ends
from faults_record import STANDS
from faults_robot import Fault, Robot, nothing
from faults_ros import stamped

Sent = list[tuple[Any, float]]
"""Messages of odometry, each with when it was measured, s."""


def odometry_late(robot: Robot, rng: random.Random) -> list[str]:
    """Odometry is late by 0.5 to 30 s and says so; in half of the cases the filter begins with it."""
    late = rng.choice([0.5, 0.7, 1.0, 2.0, 5.0, 30.0])

    def delay(message: Any, now: float) -> Sent:
        message.header.stamp = stamped("Odometry", "", robot.clock(now - late)).header.stamp
        return [(message, now - late)]

    robot.odometry = delay
    if rng.random() < 0.5:
        robot.ros.ask("kalman_filter/reset", 1.0)
    time.sleep(1.5)
    return []


def odometry_burst(robot: Robot, rng: random.Random) -> list[str]:
    """A radio holds the odometry of 1.5 s back, delivers it at once 0.6 to 2 s later, and is dead."""
    held: Sent = []
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


def odometry_repeats(robot: Robot, rng: random.Random) -> list[str]:
    """The last odometry is sent again and again."""
    kept: Sent = []

    def repeat(message: Any, now: float) -> Sent:
        kept.append((message, now))
        return kept[:1]

    robot.odometry = repeat
    return robot.must_stand(time.time() + STANDS)


def odometry_impossible(robot: Robot, rng: random.Random) -> list[str]:
    """Odometry jumps by 5 m, states a speed of 50 m/s, or a variance that is no number."""
    spoiled = rng.choice(["jump", "speed", "variance"])

    def spoil(message: Any, now: float) -> Sent:
        if spoiled == "jump":
            message.pose.pose.position.x += 5.0
        elif spoiled == "speed":
            message.twist.twist.linear.x = 50.0
        else:
            message.pose.covariance[0] = math.nan
        return [(message, now)]

    robot.odometry = spoil
    return robot.must_stand(time.time() + STANDS)


def clocks(robot: Robot, rng: random.Random, kind: str) -> list[str]:
    """The robot's clock "is off", "is set", "drifts", or its stamps "roll over", and the odometry dies at last."""
    size, began = rng.choice([-2.0, -1.0, -0.775, -0.3, 0.3, 0.775, 1.0, 2.0]), time.time()
    if kind == "roll over":  # to a counter's zero or into the past
        size = -rng.choice([began, 2.0**32 * 1e-9, 2.0**31 * 1e-3])
    robot.clock = (lambda now: now + 0.05 * size * (now - began)) if kind == "drifts" else (lambda now: now + size)
    if kind == "is off":
        robot.ros.ask("kalman_filter/reset", 1.0)
        robot.ros.ask("velocity_controller/enable", 1.0, data=True)
    time.sleep(rng.uniform(1.0, 2.0))
    robot.odometry = nothing
    time.sleep(1.2)
    return []


def wrong_fix(robot: Robot, rng: random.Random) -> list[str]:
    """One fix says that the robot is far away; what moves then must still rest on fresh measurements."""
    message = stamped("PoseWithCovarianceStamped", "odom", robot.clock(time.time()))
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
    for variance in (0.0, 1e-170, 1e-308, 5e-324, -1.0, math.inf, math.nan, 1e308):
        message = stamped("PoseWithCovarianceStamped", "odom", robot.clock(time.time()))
        message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1.0
        for at in rng.choice([(0, 7, 35), (0, 7), (35,)]):
            message.pose.covariance[at] = variance
        robot.ros.speaker(topic, "PoseWithCovarianceStamped", 2).publish(message)
        time.sleep(0.2)
    time.sleep(0.5)
    return []


def two_odometries(robot: Robot, rng: random.Random) -> list[str]:
    """Another publisher of odometry says the same, nearly the same or another place, and stays when the robot's own ends."""
    away_by, speaker, since = rng.choice([0.0, 0.02, 0.5]), robot.ros.speaker("odom", "Odometry", 2), time.time()

    def both(message: Any, now: float) -> Sent:
        other = copy.deepcopy(message)
        other.pose.pose.position.x += away_by
        speaker.publish(other)
        return [(message, now)] if now < since + 1.0 else []

    robot.odometry = both
    time.sleep(3.0)
    return []


def stranger(robot: Robot, rng: random.Random, *, filter_ends: bool) -> list[str]:
    """A stranger says at 20 Hz that the robot stands where it was, beside the filter or after it.

    A filter that is killed is in the graph for its lease of 20 s, so the robot is watched for longer.
    """
    speaker = robot.ros.speaker("estimate", "Odometry", 2)
    here = robot.driver.says(time.time())._replace(v=0.0, omega=0.0)

    def estimate(message: Any, now: float) -> Sent:
        other = robot.odometry_of(here, now)
        for at in (0, 7, 35):
            other.pose.covariance[at] = other.twist.covariance[at] = 1e-4
        speaker.publish(other)
        return [(message, now)]

    robot.odometry, at = estimate, time.time()
    if filter_ends:
        robot.chain.signal(FILTER, signal.SIGKILL)
    time.sleep(25.0 if filter_ends else 3.0)
    return robot.strays(at)


def second_waypoints(robot: Robot, rng: random.Random) -> list[str]:
    """Another source of waypoints sends the robot aside at 1 to 20 Hz."""
    speaker, side, rate = robot.ros.speaker("reference", "PoseStamped", 2), rng.choice([-1.0, 1.0]), rng.choice([1, 5, 20])

    def reference(message: Any, now: float) -> Sent:
        if rng.random() < rate / 20.0:
            other = stamped("PoseStamped", "odom", robot.clock(now))
            other.pose.position.y, other.pose.orientation.w = 50.0 * side, 1.0
            speaker.publish(other)
        return [(message, now)]

    robot.odometry, at = reference, time.time()
    time.sleep(3.0)
    return robot.strays(at)


MEASUREMENTS: dict[str, Fault] = {
    "odometry late": odometry_late,
    "odometry in a burst": odometry_burst,
    "odometry dead": partial(ends, what="odometry"),
    "odometry repeated": odometry_repeats,
    "odometry impossible": odometry_impossible,
    "two odometries": two_odometries,
    "clock offset": partial(clocks, kind="is off"),
    "clock set": partial(clocks, kind="is set"),
    "clock drifts": partial(clocks, kind="drifts"),
    "stamps rolled over": partial(clocks, kind="roll over"),
    "wrong fix": wrong_fix,
    "hostile variances": hostile_variances,
    "a stranger's estimate": partial(stranger, filter_ends=False),
    "a stranger's estimate after the filter": partial(stranger, filter_ends=True),
    "second source of waypoints": second_waypoints,
}
