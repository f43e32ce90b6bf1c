"""Faults of messages: buttons, commands, odometry, clocks, fixes, strangers and floods."""

from __future__ import annotations

import copy
import math
import random
import time
from functools import partial
from typing import Any

from faults_chain import CONTROLLER, FILTER, GUARD
from faults_processes import NODES, SET_STANDS, ends, suspended
from faults_record import STANDS
from faults_robot import SETTLE, Fault, Robot, Sent, nothing
from faults_ros import stamped


def short_press(robot: Robot, rng: random.Random) -> list[str]:
    """A button is pressed and released within 0 to 10 ms."""
    with robot.lock:
        robot.say(0, True)
        time.sleep(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.01)]))
        robot.say(0, False)
    return robot.must_stand(time.time() + SETTLE)


def two_buttons(robot: Robot, rng: random.Random, pressed: bool | None) -> list[str]:
    """One of two buttons is held, or falls silent, which is None, and a person asks to be enabled."""
    robot.pressed[rng.randrange(2)] = pressed
    time.sleep(0.3 if pressed else 0.5 + SETTLE)
    at = time.time()
    enabled = [robot.ros.ask("cmd_vel_guard/enable", 0.5, data=True) for _ in range(4)]
    return robot.must_stand(at) + (["it was enabled while a button was pressed or silent"] if any(enabled) else [])


def button_lost(robot: Robot, rng: random.Random) -> list[str]:
    """A radio loses what a button says in 0.1 to 0.8 s, in which it is pressed, for half a second."""
    cut, radio = rng.choice([0.1, 0.3, 0.45, 0.6, 0.8]), robot.ros.radio  # shorter presses may be lost with a message or two
    with radio.cut():
        robot.pressed[1] = True
        time.sleep(min(cut, 0.5))
        robot.pressed[1] = cut <= 0.5
        time.sleep(max(cut - 0.5, 0.0))
    time.sleep(max(0.5 - cut, 0.0))
    robot.pressed[1] = False
    return robot.must_stand(time.time() + 0.5 + SETTLE)  # when its next messages show the gap


def button_restarts(robot: Robot, rng: random.Random) -> list[str]:
    """A button's program ends and another one begins, which is not pressed."""
    with robot.lock:
        robot.pressed[0] = None
        robot.ros.silence("emergency_stop", 0)
    time.sleep(rng.uniform(0.6, 1.0))
    robot.pressed[0] = False
    return robot.must_stand(time.time() + SETTLE)


def flooded(robot: Robot, rng: random.Random, topics: tuple[str, ...]) -> list[str]:
    """A process publishes on one of some topics as fast as it can, and the odometry dies meanwhile."""
    topic = rng.choice(topics)
    speaker = robot.ros.speaker(topic, 9)  # its discovery takes a third of a second: not a part of the fault
    message = stamped(topic, 0.0)
    if topic in ("cmd_vel_in", "cmd_vel_teleop"):  # a motion that is fresh when the flood begins
        message = stamped(topic, time.time())
        message.twist.linear.x = 0.1
    if topic in ("cmd_vel_in", "cmd_vel_teleop", "estimate"):  # an estimate without a stamp counts from when it was sent
        robot.record.rests_on(time.time())
    if topic in ("reference", "next_reference"):
        message.pose.orientation.w = 1.0
    robot.odometry, since = nothing, time.time()
    while time.time() < since + 2.0:
        speaker.publish(message)
    time.sleep(0.5)
    reasons = robot.judge(since)
    for name in (GUARD, CONTROLLER) if topic == "emergency_stop" else ():
        robot.chain.kill(name)  # a button that is gone for good: they must be started again
    return reasons


def old_stamp(robot: Robot, rng: random.Random) -> None:
    """Commands of a person are 1 to 60 s old by their stamp, when the odometry has ended."""
    robot.odometry = nothing
    time.sleep(0.7)
    for _ in range(20):
        robot.send_command("cmd_vel_teleop", 0.15, 0.0, age=rng.choice([1.0, 60.0]))
        time.sleep(0.05)


def nonsense(robot: Robot, rng: random.Random) -> list[str]:
    """Commands of a person are not finite, or far above the limits."""
    since = time.time()
    robot.teleop = rng.choice([(math.nan, 0.1), (0.1, math.inf), (9.0, -3.0), (1e300, 1e300), (-50.0, 0.0)])
    time.sleep(0.6)
    wheels = [abs(command.v) + abs(command.omega) * 0.08 for command in list(robot.record.heard) if command.sent > since]
    return [] if all(wheel <= 0.22001 for wheel in wheels) else ["a command was above the limits"]


def own_output(robot: Robot, rng: random.Random) -> list[str]:
    """The guard hears its own commands as a program's; a person drives, and ends."""
    robot.chain.restart(GUARD, "-r", "cmd_vel_in:=cmd_vel")
    robot.teleop = (0.15, 0.0)
    robot.until(lambda: robot.chain.refuses(GUARD) or (robot.enable() and robot.drives(2.0)), 60.0)
    time.sleep(0.5)
    robot.teleop = None
    return robot.must_stand(time.time() + SET_STANDS, 2.5)


def odometry_late(robot: Robot, rng: random.Random) -> None:
    """Odometry is late by 0.5 to 30 s and says so; in half of the cases the filter begins with it."""
    late = rng.choice([0.5, 0.7, 1.0, 2.0, 5.0, 30.0])

    def delay(message: Any, now: float) -> Sent:
        message.header.stamp = stamped("odom", robot.clock(now - late)).header.stamp
        return [(message, now - late)]

    robot.odometry = delay
    if rng.random() < 0.5:
        robot.ros.ask("kalman_filter/reset", 1.0)
    time.sleep(1.5)


def odometry_burst(robot: Robot, rng: random.Random) -> None:
    """A radio holds the odometry of 1.5 s back, delivers it at once 0.6 to 2 s later, and is dead."""
    held: Sent = []
    robot.odometry = lambda message, now: held.append((message, now)) or []
    time.sleep(1.5)
    robot.odometry = nothing
    time.sleep(rng.uniform(0.6, 2.0))
    with robot.lock:
        for message, measured in held:
            robot.record.rests_on(measured)
            robot.ros.speaker("odom").publish(message)
    time.sleep(1.2)


def odometry_repeats(robot: Robot, rng: random.Random) -> list[str]:
    """The last odometry is sent again and again."""
    last = time.time()
    message = robot.odometry_of(robot.driver.says(last), last)
    robot.odometry = lambda *_: [(message, last)]
    return robot.must_stand(time.time() + STANDS)


def odometry_impossible(robot: Robot, rng: random.Random) -> list[str]:
    """Odometry jumps by 5 m, states a speed of 50 m/s, or a variance that is no number."""
    spoiled = rng.choice([{"x": 5.0}, {"v": 50.0}, {"variance": math.nan}])
    robot.driver.tells(lambda true: true[-1]._replace(**{name: getattr(true[-1], name) + by for name, by in spoiled.items()}))
    return robot.must_stand(time.time() + STANDS)


def clocks(robot: Robot, rng: random.Random, kind: str) -> None:
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


def fix(robot: Robot, topic: str, x: float, variances: dict[int, float]) -> None:
    """Send a pose at an x, m, with some entries of its covariance."""
    message = stamped(topic, robot.clock(time.time()))
    message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1.0
    for at, variance in variances.items():
        message.pose.covariance[at] = variance
    robot.ros.speaker(topic, 2).publish(message)


def wrong_fix(robot: Robot, rng: random.Random) -> list[str]:
    """One fix says that the robot is far away; what moves then must still rest on fresh measurements."""
    x, estimates = rng.choice([1e3, -1e3, 1e300]), list[float]()
    subscription = robot.ros.hear("estimate", lambda estimate: estimates.append(estimate.pose.pose.position.x))
    time.sleep(0.3)
    fix(robot, "pose_fix", x, dict.fromkeys((0, 7, 35), rng.choice([1e-4, 1e-6, 1e-300])))
    time.sleep(1.0)
    robot.ros.node.destroy_subscription(subscription)
    return ["the estimate follows a wrong fix"] if any(abs(x) > 10.0 for x in estimates) else []


def hostile_variances(robot: Robot, rng: random.Random) -> None:
    """A fix, or a person's pose, where the robot is, with variances that no sensor has."""
    topic, x = rng.choice(["pose_fix", "initialpose"]), robot.driver.says(time.time()).x
    for variance in (0.0, 1e-170, 1e-308, 5e-324, -1.0, math.inf, math.nan, 1e308):
        fix(robot, topic, x, {0: 1e-4, 7: 1e-4, 35: 1e-4} | dict.fromkeys(rng.choice([(0, 7, 35), (0, 7), (35,)]), variance))
        time.sleep(0.2)
    time.sleep(0.5)


def two_odometries(robot: Robot, rng: random.Random) -> None:
    """Another publisher of odometry says the same, nearly the same or another place, and stays when the robot's own ends."""
    away_by, speaker, since = rng.choice([0.0, 0.02, 0.5]), robot.ros.speaker("odom", 2), time.time()

    def say(message: Any, now: float) -> None:
        other = copy.deepcopy(message)
        other.pose.pose.position.x += away_by
        speaker.publish(other)

    robot.beside, robot.odometry = say, lambda message, now: [(message, now)] if now < since + 1.0 else []
    time.sleep(3.0)


def stranger(robot: Robot, rng: random.Random, *, filter_ends: bool) -> list[str]:
    """A stranger says at 20 Hz that the robot stands where it was, beside the filter or after it."""
    speaker, here = robot.ros.speaker("estimate", 2), robot.driver.says(time.time())._replace(v=0.0, omega=0.0)
    estimate = robot.odometry_of(here, time.time())
    for at in (0, 7, 35):
        estimate.pose.covariance[at] = estimate.twist.covariance[at] = 1e-4

    def say(message: Any, now: float) -> None:
        estimate.header.stamp = message.header.stamp
        speaker.publish(estimate)

    robot.beside, at = say, time.time()
    if filter_ends:
        robot.chain.signal(FILTER, "KILL")
    time.sleep(25.0 if filter_ends else 3.0)  # a filter that is killed is in the graph for its lease of 20 s
    return robot.strays(at)


def second_waypoints(robot: Robot, rng: random.Random) -> list[str]:
    """Another source of waypoints sends the robot aside at 1 to 20 Hz."""
    speaker, rate = robot.ros.speaker("reference", 2), rng.choice([1, 5, 20])
    reference = stamped("reference", 0.0)
    reference.pose.position.y, reference.pose.orientation.w = rng.choice([-50.0, 50.0]), 1.0

    def say(message: Any, now: float) -> None:
        reference.header.stamp = message.header.stamp
        if rng.random() < rate / 20.0:
            speaker.publish(reference)

    robot.beside, at = say, time.time()
    time.sleep(3.0)
    return robot.strays(at)


BUTTONS: dict[str, Fault] = {
    **{f"{what} suspended, button pressed": partial(suspended, name=name, meanwhile="pressed") for what, name in NODES.items()},
    "short press": short_press,
    "press lost by a radio": button_lost,
    "one of two buttons held": partial(two_buttons, pressed=True),
    "one of two buttons silent": partial(two_buttons, pressed=None),
    "button restarted": button_restarts,
    "flood on emergency_stop": partial(flooded, topics=("emergency_stop",)),
}
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
TOPICS = ("cmd_vel_in", "cmd_vel_teleop", "scan", "odom", "estimate", "reference", "pose_fix")
OTHERS = ("cmd_vel_standby/alive", "reset", "nis", "next_reference", "initialpose")
FLOODS: dict[str, Fault] = {
    **{f"flood on {topic}": partial(flooded, topics=(topic,)) for topic in TOPICS},
    "flood on another topic": partial(flooded, topics=OTHERS),
    "commands with old stamps": old_stamp,
    "commands that are nonsense": nonsense,
    "guard hears itself": own_output,
}
