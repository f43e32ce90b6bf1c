"""Faults of processes, buttons and commands, see `faults_kinds`."""

from __future__ import annotations

import math
import random
import signal
import time

from faults_record import AGE, OVERDUE
from faults_robot import Fault, Robot, nothing

PRESS = 0.5
"""Time for which a person presses a button whose radio is bad, s; a shorter press may be lost with a message or two."""
SETTLE = 0.1
"""Time for a message to take effect, s: several cycles of the guard on a busy machine."""


def _after_stop(robot: Robot, wait: float = 0.8) -> list[str]:
    """Return that there was motion from now on, after a stop that only a person may end."""
    since = time.time() + SETTLE
    time.sleep(wait)
    return robot.moves_on(since)


# Processes that were suspended


def suspended(name: str, *, dies: bool) -> Fault:
    """Return the fault that suspends a process for 0.5 to 8 s while what it hears dies or lives."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        duration = rng.choice([rng.uniform(0.5, 3.0)] * 4 + [8.0])
        since = time.time()
        with robot.chain.suspended(name):
            time.sleep(duration * rng.uniform(0.1, 0.6))
            if dies:
                robot.odometry = nothing
            time.sleep(duration * 0.4)
            until = time.time()
        time.sleep(1.0)
        stands = 0.3 if name == "cmd_vel_guard" else AGE + OVERDUE  # nobody else could stop it meanwhile
        return robot.moves_on(since + stands, until) if until > since + stands else []

    return fault


def suspended_pressed(name: str) -> Fault:
    """Return the fault in which a button is pressed and released while a process is suspended for 0.5 to 8 s."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        duration = rng.choice([0.5, 1.0, 2.0, 3.0, 5.0, 8.0])
        with robot.chain.suspended(name):
            time.sleep(rng.uniform(0.1, 0.5) * duration)
            robot.record.began, robot.pressed[0] = time.time(), True
            time.sleep(0.3)
            robot.pressed[0] = False
            stopped = time.time()
            time.sleep(0.4 * duration)
        late = _after_stop(robot)
        return late if name == "cmd_vel_guard" else robot.moves_on(stopped + SETTLE)

    return fault


def guard_suspended_sources_die(robot: Robot, rng: random.Random) -> list[str]:
    """A person and a program command the guard, and end while it is suspended."""
    robot.teleop = (0.1, 0.0)
    time.sleep(0.2)
    with robot.chain.suspended("cmd_vel_guard"):
        duration = rng.choice([rng.uniform(0.3, 3.0)] * 4 + [8.0])
        time.sleep(0.5 * duration)
        robot.teleop = None
        robot.odometry = nothing
        time.sleep(0.5 * duration)
    time.sleep(0.8)
    return []


# Processes that end


def guard_ends(number: signal.Signals) -> Fault:
    """Return the fault in which a driving guard is killed or hangs: the standby must stop the robot within 0.3 s."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        time.sleep(rng.uniform(0.0, 0.2))
        robot.record.began = at = robot.chain.signal("cmd_vel_guard", number)
        time.sleep(1.0)
        return robot.moves_on(at + 0.3)

    return fault


def standby_ends(robot: Robot, rng: random.Random) -> list[str]:
    """The standby is killed or hangs, in half of the cases the odometry ends too: the guard stops the robot within 0.7 s."""
    robot.record.began = at = robot.chain.signal("cmd_vel_standby", rng.choice([signal.SIGKILL, signal.SIGSTOP]))
    time.sleep(rng.uniform(0.1, 1.0))
    if rng.random() < 0.5:
        robot.odometry = nothing
    time.sleep(1.2)
    return robot.moves_on(at + 0.7)


def guard_restarts(robot: Robot, rng: random.Random) -> list[str]:
    """The guard is killed and started again while the program drives: its first message is zero."""
    robot.chain.kill("cmd_vel_guard")
    time.sleep(1.5)  # until the standby has said its zeros, which are not the new guard's
    since = time.time()
    robot.chain.start("cmd_vel_guard")
    while time.time() < since + 30.0:
        later = [command for command in list(robot.record.heard) if command.arrived > since + 0.2]
        if later:
            return ["a new guard's first message was a motion"] if later[0].moves else []
        time.sleep(0.02)
    return ["a new guard said nothing"]


# Buttons


def short_press(robot: Robot, rng: random.Random) -> list[str]:
    """A button is pressed and released within 0 to 10 ms."""
    with robot.lock:
        robot.record.began = time.time()
        robot.say(0, True)
        time.sleep(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.01)]))
        robot.say(0, False)
    return _after_stop(robot)


def two_buttons(robot: Robot, rng: random.Random) -> list[str]:
    """One of two buttons is held, and a person asks to be enabled."""
    with robot.lock:
        robot.pressed[rng.randrange(2)] = True
    time.sleep(0.3)
    since = time.time()
    enabled = sum(robot.ros.ask("cmd_vel_guard/enable", 0.5, data=True) for _ in range(4))
    return [*(["it was enabled while a button was pressed"] if enabled else []), *robot.moves_on(since)]


def button_lost(robot: Robot, rng: random.Random) -> list[str]:
    """A radio loses what a button says in 0.1 to 0.8 s, in which it is pressed, for half a second."""
    assert robot.ros.radio
    robot.record.began = time.time()
    cut = rng.choice([0.1, 0.3, 0.45, 0.6, 0.8])
    with robot.ros.radio.cut():
        robot.pressed[1] = True
        time.sleep(min(cut, PRESS))
        if cut > PRESS:
            robot.pressed[1] = False
            time.sleep(cut - PRESS)
    time.sleep(max(PRESS - cut, 0.0))
    robot.pressed[1] = False
    time.sleep(0.5)  # until its next messages, which show the gap
    return _after_stop(robot)


def button_dies(robot: Robot, rng: random.Random) -> list[str]:
    """One of two buttons falls silent while the other continues."""
    with robot.lock:
        robot.pressed[rng.randrange(2)] = None
        robot.record.began = time.time()
    time.sleep(0.5)
    late = _after_stop(robot)
    return [*late, *(["it was enabled while a button was silent"] if robot.enable() else [])]


def button_restarts(robot: Robot, rng: random.Random) -> list[str]:
    """A button's program ends and another one begins, which is not pressed."""
    with robot.lock:
        robot.record.began = time.time()
        robot.pressed[0] = None
        robot.ros.silence("emergency_stop", 0)
    time.sleep(rng.uniform(0.6, 1.0))
    robot.pressed[0] = False
    return _after_stop(robot)


# Floods


def flooded(topic: str, kind: str) -> Fault:
    """Return the fault in which a process publishes on a topic as fast as it can, and the odometry dies meanwhile."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        if "header" in robot.ros.kinds[kind].get_fields_and_field_types():
            frame = {"TwistStamped": "base_footprint", "LaserScan": "base_scan"}.get(kind, "odom")
            message = robot.ros.stamped(kind, frame, 0.0)
        else:
            message = robot.ros.kinds[kind]()
        robot.ros.speaker(topic, kind, 9)  # its discovery takes a third of a second on a busy machine: not a part of the fault
        if kind == "TwistStamped":  # a motion that is fresh when the flood begins
            message.header.stamp = robot.ros.stamped(kind, "", time.time()).header.stamp
            message.twist.linear.x = 0.1
        if kind == "TwistStamped" or topic == "estimate":  # an estimate without a stamp counts from when it was sent
            robot.record.rests_on(time.time())
        if kind == "PoseStamped":
            message.pose.orientation.w = 1.0
        robot.odometry = nothing
        robot.record.began = since = time.time()
        robot.ros.flood(topic, message, 2.0)
        time.sleep(0.5)
        reasons = robot.judge(since)
        for name in ("cmd_vel_guard", "velocity_controller") if kind == "Bool" else ():
            robot.chain.kill(name)  # a button that is gone for good: they must be started again
        return reasons

    return fault


def flood_elsewhere(robot: Robot, rng: random.Random) -> list[str]:
    """A flood on one of the other topics that the chain hears."""
    topics = {"cmd_vel_standby/alive": "Empty", "reset": "Empty", "nis": "DiagnosticArray", "next_reference": "PoseStamped"}
    topics["initialpose"] = "PoseWithCovarianceStamped"
    return flooded(*rng.choice([*topics.items()]))(robot, rng)


# Commands


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
    return ["a command was above the limits"] if not all(wheel <= 0.22001 for wheel in wheels) else []


def disabled(robot: Robot, rng: random.Random) -> list[str]:
    """The guard is disabled while commands continue."""
    robot.record.began = time.time()
    if not any(robot.enable(False) for _ in range(3)):
        return ["the guard does not answer"]
    return _after_stop(robot)
