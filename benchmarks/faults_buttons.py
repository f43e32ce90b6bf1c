"""Faults of buttons, commands and floods."""

from __future__ import annotations

import math
import random
import time
from functools import partial

from faults_chain import CONTROLLER, GUARD
from faults_processes import NODES, SET_STANDS, suspended
from faults_robot import SETTLE, Fault, Robot, nothing
from faults_ros import stamped


def short_press(robot: Robot, rng: random.Random) -> list[str]:
    """A button is pressed and released within 0 to 10 ms."""
    with robot.lock:
        robot.say(0, True)
        time.sleep(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.01)]))
        robot.say(0, False)
    return robot.must_stand(time.time() + SETTLE)


def two_buttons(robot: Robot, rng: random.Random) -> list[str]:
    """One of two buttons is held, and a person asks to be enabled."""
    robot.pressed[rng.randrange(2)] = True
    time.sleep(0.3)
    at = time.time()
    enabled = sum(robot.ros.ask("cmd_vel_guard/enable", 0.5, data=True) for _ in range(4))
    return robot.must_stand(at) + (["it was enabled while a button was pressed"] if enabled else [])


def button_lost(robot: Robot, rng: random.Random) -> list[str]:
    """A radio loses what a button says in 0.1 to 0.8 s, in which it is pressed, for half a second."""
    assert robot.ros.radio
    cut, press = rng.choice([0.1, 0.3, 0.45, 0.6, 0.8]), 0.5  # a shorter press may be lost with a message or two
    with robot.ros.radio.cut():
        robot.pressed[1] = True
        time.sleep(min(cut, press))
        robot.pressed[1] = cut <= press
        time.sleep(max(cut - press, 0.0))
    time.sleep(max(press - cut, 0.0))
    robot.pressed[1] = False
    return robot.must_stand(time.time() + 0.5 + SETTLE)  # when its next messages show the gap


def button_dies(robot: Robot, rng: random.Random) -> list[str]:
    """One of two buttons falls silent while the other continues."""
    robot.pressed[rng.randrange(2)] = None
    moves = robot.must_stand(time.time() + 0.5 + SETTLE)
    return moves + (["it was enabled while a button was silent"] if robot.enable() else [])


def button_restarts(robot: Robot, rng: random.Random) -> list[str]:
    """A button's program ends and another one begins, which is not pressed."""
    with robot.lock:
        robot.pressed[0] = None
        robot.ros.silence("emergency_stop", 0)
    time.sleep(rng.uniform(0.6, 1.0))
    robot.pressed[0] = False
    return robot.must_stand(time.time() + SETTLE)


def flooded(robot: Robot, rng: random.Random, topics: dict[str, str]) -> list[str]:
    """A process publishes on one of some topics as fast as it can, and the odometry dies meanwhile."""
    topic, kind = rng.choice([*topics.items()])
    speaker = robot.ros.speaker(topic, kind, 9)  # its discovery takes a third of a second: not a part of the fault
    message = stamped(kind, {"TwistStamped": "base_footprint", "LaserScan": "base_scan"}.get(kind, "odom"), 0.0)
    if kind == "TwistStamped":  # a motion that is fresh when the flood begins
        message = stamped(kind, "base_footprint", time.time())
        message.twist.linear.x = 0.1
    if kind == "TwistStamped" or topic == "estimate":  # an estimate without a stamp counts from when it was sent
        robot.record.rests_on(time.time())
    if kind == "PoseStamped":
        message.pose.orientation.w = 1.0
    robot.odometry, since = nothing, time.time()
    while time.time() < since + 2.0:
        speaker.publish(message)
    time.sleep(0.5)
    reasons = robot.judge(since)
    for name in (GUARD, CONTROLLER) if kind == "Bool" else ():
        robot.chain.kill(name)  # a button that is gone for good: they must be started again
    return reasons


def old_stamp(robot: Robot, rng: random.Random) -> list[str]:
    """Commands of a person are 1 to 60 s old by their stamp, when the odometry has ended."""
    robot.odometry = nothing
    time.sleep(0.7)
    for _ in range(20):
        robot.send_command("cmd_vel_teleop", 0.15, 0.0, age=rng.choice([1.0, 60.0]))
        time.sleep(0.05)
    return []


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
    robot.until(lambda: robot.chain.refuses(GUARD) or (robot.enable() and robot.drives(time.time(), 2.0)), 60.0)
    time.sleep(0.5)
    robot.teleop = None
    return robot.must_stand(time.time() + SET_STANDS, 2.5)


BUTTONS: dict[str, Fault] = {
    **{f"{what} suspended, button pressed": partial(suspended, name=name, meanwhile="pressed") for what, name in NODES.items()},
    "short press": short_press,
    "press lost by a radio": button_lost,
    "one of two buttons held": two_buttons,
    "one of two buttons silent": button_dies,
    "button restarted": button_restarts,
    "flood on emergency_stop": partial(flooded, topics={"emergency_stop": "Bool"}),
}
TOPICS = {
    "cmd_vel_in": "TwistStamped",
    "cmd_vel_teleop": "TwistStamped",
    "scan": "LaserScan",
    "odom": "Odometry",
    "estimate": "Odometry",
    "reference": "PoseStamped",
    "pose_fix": "PoseWithCovarianceStamped",
}
OTHER_TOPICS = {
    "cmd_vel_standby/alive": "Empty",
    "reset": "Empty",
    "nis": "Vector3Stamped",
    "next_reference": "PoseStamped",
    "initialpose": "PoseWithCovarianceStamped",
}
FLOODS: dict[str, Fault] = {
    **{f"flood on {topic}": partial(flooded, topics={topic: kind}) for topic, kind in TOPICS.items()},
    "flood on another topic": partial(flooded, topics=OTHER_TOPICS),
    "commands with old stamps": old_stamp,
    "commands that are nonsense": nonsense,
    "guard hears itself": own_output,
}
