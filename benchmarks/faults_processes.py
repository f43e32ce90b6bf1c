"""Faults of processes, buttons and commands, see `faults_kinds`."""

from __future__ import annotations

import math
import random
import signal
import time

from faults_robot import Fault, Robot, nothing

SETTLE = 0.1
"""Time for a message to take effect, s: several cycles of the guard on a busy machine."""


def _after_stop(robot: Robot, wait: float = 0.8) -> int:
    """Count motions from now on, after a stop that only a person may end."""
    since = time.time() + SETTLE
    time.sleep(wait)
    return len(robot.record.motions(since))


# Processes that were suspended


def suspended(name: str, *, dies: bool) -> Fault:
    """Return the fault that suspends a process for 0.5 to 8 s while what it hears dies or lives."""

    def fault(robot: Robot, rng: random.Random) -> int:
        duration = rng.choice([rng.uniform(0.5, 3.0)] * 4 + [8.0])
        with robot.nodes.suspended(name):
            time.sleep(duration * rng.uniform(0.1, 0.6))
            if dies:
                robot.odometry = nothing
            time.sleep(duration * 0.4)
        time.sleep(1.0)
        return 0

    return fault


def suspended_pressed(name: str) -> Fault:
    """Return the fault in which a button is pressed and released while a process is suspended for 0.5 to 8 s."""

    def fault(robot: Robot, rng: random.Random) -> int:
        duration = rng.choice([0.5, 1.0, 2.0, 3.0, 5.0, 8.0])
        with robot.nodes.suspended(name):
            time.sleep(rng.uniform(0.1, 0.5) * duration)
            robot.record.began, robot.pressed[0] = time.time(), True
            time.sleep(0.3)
            robot.pressed[0] = False
            stopped = time.time()
            time.sleep(0.4 * duration)
        late = _after_stop(robot)
        return late if name == "cmd_vel_guard" else len(robot.record.motions(stopped))

    return fault


def guard_suspended_sources_die(robot: Robot, rng: random.Random) -> int:
    """A person and a program command the guard, and end while it is suspended."""
    robot.teleop = (0.1, 0.0)
    time.sleep(0.2)
    with robot.nodes.suspended("cmd_vel_guard"):
        duration = rng.choice([rng.uniform(0.3, 3.0)] * 4 + [8.0])
        time.sleep(0.5 * duration)
        robot.teleop = None
        robot.odometry = nothing
        time.sleep(0.5 * duration)
    time.sleep(0.8)
    return 0


# Processes that end


def guard_ends(number: signal.Signals) -> Fault:
    """Return the fault in which a driving guard is killed or hangs: the standby must stop the robot within 0.3 s."""

    def fault(robot: Robot, rng: random.Random) -> int:
        time.sleep(rng.uniform(0.0, 0.2))
        robot.record.began = at = time.time()
        robot.nodes.signal("cmd_vel_guard", number)
        time.sleep(1.0)
        return robot.record.moving(at + 0.3)

    return fault


def standby_ends(robot: Robot, rng: random.Random) -> int:
    """The standby is killed or hangs, in half of the cases the odometry ends too: the guard stops the robot within 0.7 s."""
    robot.record.began = at = time.time()
    robot.nodes.signal("cmd_vel_standby", rng.choice([signal.SIGKILL, signal.SIGSTOP]))
    time.sleep(rng.uniform(0.1, 1.0))
    if rng.random() < 0.5:
        robot.odometry = nothing
    time.sleep(1.2)
    return robot.record.moving(at + 0.7)


def guard_restarts(robot: Robot, rng: random.Random) -> int:
    """The guard is killed and started again while the program drives: its first message is zero."""
    robot.nodes.kill("cmd_vel_guard")
    time.sleep(0.5)
    since = time.time()
    robot.start("cmd_vel_guard")
    while time.time() < since + 20.0:
        later = [command for at, *command in list(robot.record.heard) if at > since + 0.2]
        if later:
            return int(later[0] != [0.0, 0.0])
        time.sleep(0.02)
    return 1


# Buttons


def short_press(robot: Robot, rng: random.Random) -> int:
    """A button is pressed and released within 0 to 10 ms."""
    with robot.lock:
        robot.record.began = time.time()
        robot.say(0, True)
        time.sleep(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.01)]))
        robot.say(0, False)
    return _after_stop(robot)


def two_buttons(robot: Robot, rng: random.Random) -> int:
    """One of two buttons is held, and a person asks to be enabled."""
    with robot.lock:
        robot.pressed[rng.randrange(2)] = True
    time.sleep(0.3)
    since = time.time()
    return sum(robot.ask("cmd_vel_guard/enable", 0.5, data=True) for _ in range(4)) + len(robot.record.motions(since))


def button_lost(robot: Robot, rng: random.Random) -> int:
    """A radio loses what a button says in 0 to 0.3 s, in which it is pressed and released."""
    assert robot.radio
    robot.record.began = time.time()
    with robot.radio.cut():
        with robot.lock:
            robot.say(1, True)
            robot.say(1, False)
        time.sleep(rng.choice([0.0, 0.1, 0.3]))
    time.sleep(0.1)  # until its next message, which shows the gap
    return _after_stop(robot)


def button_dies(robot: Robot, rng: random.Random) -> int:
    """One of two buttons falls silent while the other continues."""
    with robot.lock:
        robot.pressed[rng.randrange(2)] = None
        robot.record.began = time.time()
    time.sleep(0.5)
    return _after_stop(robot) + robot.enable()


def button_restarts(robot: Robot, rng: random.Random) -> int:
    """A button's program ends and another one begins, which is not pressed."""
    with robot.lock:
        robot.record.began = time.time()
        robot.pressed[0] = None
        robot.silence("emergency_stop", 0)
    time.sleep(rng.uniform(0.6, 1.0))
    robot.pressed[0] = False
    return _after_stop(robot)


# Floods


def flooded(topic: str, kind: str) -> Fault:
    """Return the fault in which a process publishes on a topic as fast as it can, and the odometry dies meanwhile."""

    def fault(robot: Robot, rng: random.Random) -> int:
        if "header" in robot.kinds[kind].get_fields_and_field_types():
            message = robot.stamped(kind, {"TwistStamped": "base_footprint", "LaserScan": "base_scan"}.get(kind, "odom"), 0.0)
        else:
            message = robot.kinds[kind]()
        robot.speaker(topic, kind, 9)  # its discovery takes a third of a second on a busy machine: not a part of the fault
        if kind == "TwistStamped":  # a motion that is fresh when the flood begins
            message.header.stamp = robot.stamped(kind, "", time.time()).header.stamp
            message.twist.linear.x = 0.1
        if kind == "TwistStamped" or topic == "estimate":  # an estimate without a stamp counts from when it was sent
            robot.record.rests_on(time.time())
        if kind == "PoseStamped":
            message.pose.orientation.w = 1.0
        robot.odometry = nothing
        robot.record.began = time.time()
        robot.flood(topic, message, 2.0)
        time.sleep(0.5)
        for name in ("cmd_vel_guard", "velocity_controller") if kind == "Bool" else ():
            robot.nodes.kill(name)  # a button that is gone for good: they must be started again
        return 0

    return fault


def flood_elsewhere(robot: Robot, rng: random.Random) -> int:
    """A flood on one of the other topics that the chain hears."""
    topics = {"cmd_vel_standby/alive": "Empty", "reset": "Empty", "nis": "DiagnosticArray", "next_reference": "PoseStamped"}
    topics["initialpose"] = "PoseWithCovarianceStamped"
    return flooded(*rng.choice([*topics.items()]))(robot, rng)


# Commands


def old_stamp(robot: Robot, rng: random.Random) -> int:
    """Commands of a person are 1 to 60 s old by their stamp, when the odometry has ended."""
    robot.odometry = nothing
    time.sleep(0.7)
    for _ in range(20):
        robot.send_command("cmd_vel_teleop", 0.15, 0.0, age=rng.choice([1.0, 60.0]))
        time.sleep(0.05)
    return 0


def nonsense(robot: Robot, rng: random.Random) -> int:
    """Commands of a person are not finite, or far above the limits."""
    since = time.time()
    robot.teleop = rng.choice([(math.nan, 0.1), (0.1, math.inf), (9.0, -3.0), (1e300, 1e300), (-50.0, 0.0)])
    time.sleep(0.6)
    commands = [(v, omega) for at, v, omega in list(robot.record.heard) if at > since]
    return sum(not abs(v) + abs(omega) * 0.08 <= 0.22001 for v, omega in commands)


def disabled(robot: Robot, rng: random.Random) -> int:
    """The guard is disabled while commands continue."""
    robot.record.began = time.time()
    return _after_stop(robot) if robot.enable(False) else 0  # a service that did not answer in time is no stop
