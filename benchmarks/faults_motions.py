"""Faults while the robot reverses or turns on the spot: whatever ends, it must stand as soon as if it drove ahead.

A person drives for what ends on the robot, a program for what a program needs; see `faults_kinds`.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

from faults_record import AGE, OVERDUE
from faults_robot import Fault, Robot, Unseen, nothing

STANDS = {"cmd_vel_guard": 0.3, "cmd_vel_standby": 0.7}
"""Time after its end at which the robot stands, s, if it is less than `AGE` and `OVERDUE`, or more."""
BY_HAND = frozenset({"cmd_vel_guard", "cmd_vel_standby", "sticks"})
"""What ends while a person drives; else a program does."""
FENCE_STANDS = 0.7
"""Time after the last pose at which a robot with a fence stands, s."""
POLICY = """
import json
from pathlib import Path
import numpy as np

def drive(observation):
    return np.array(json.loads(Path("action").read_text()), np.float32)
"""


def reverses(rng: random.Random) -> tuple[float, float]:
    """Return a motion backwards, as shares of the robot's limits."""
    return -rng.uniform(0.5, 0.9), 0.0


def turns(rng: random.Random) -> tuple[float, float]:
    """Return a turn on the spot, as shares of the robot's limits."""
    return 0.0, rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.5)


def command_of(motion: tuple[float, float]) -> tuple[float, float]:
    """Return the command for a motion, m/s and rad/s."""
    return 0.22 * motion[0], 2.84 * motion[1]


def by_hand(robot: Robot, motion: tuple[float, float]) -> None:
    """Let a person drive, and no program."""
    robot.ros.ask("velocity_controller/enable", data=False)
    time.sleep(1.5)  # until it has said its zeros, each of which wakes the guard
    robot.teleop = command_of(motion)
    until_moves(robot, motion)


def by_program(robot: Robot, motion: tuple[float, float]) -> None:
    """Let a policy drive, at first ahead."""
    action = robot.chain.folder / "action"
    (robot.chain.folder / "policy.py").write_text(POLICY)
    action.write_text("[0.5, 0.0]")
    path = os.pathsep.join([str(robot.chain.folder), *(entry for entry in sys.path if entry)])
    robot.chain.restart("velocity_controller", policy="policy:drive", environment={"PYTHONPATH": path})
    robot.drive_again()
    action.with_suffix(".new").write_text(json.dumps(motion))
    action.with_suffix(".new").replace(action)
    until_moves(robot, motion)


def until_moves(robot: Robot, motion: tuple[float, float], patience: float = 3.0) -> None:
    """Wait until the last five commands for the wheels are a motion.

    Raises:
        Unseen: If they are not within a time, s.
    """
    (v, omega), until = command_of(motion), time.monotonic() + patience
    while sum(each.v * v + each.omega * omega > 0.5 * (v * v + omega * omega) for each in robot.record.heard[-5:]) < 5:
        if time.monotonic() > until:
            raise Unseen("the robot did not move so")
        time.sleep(0.02)


def ends(name: str, motion: Callable[[random.Random], tuple[float, float]]) -> Fault:
    """Return the fault in which a node is killed or hangs, or the odometry or a person's sticks end, during a motion."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        (by_hand if name in BY_HAND else by_program)(robot, motion(rng))
        time.sleep(rng.uniform(0.0, 0.2))
        at = time.time()
        if name == "odometry":
            robot.odometry = nothing
        elif name == "sticks":
            robot.teleop = None
        else:
            at = robot.chain.signal(name, rng.choice([signal.SIGKILL, signal.SIGSTOP]))
        robot.record.began, stands = at, STANDS.get(name, AGE + OVERDUE)
        time.sleep(stands + 1.0)
        return robot.moves_on(at + stands)

    return fault


def fence_without_filter(robot: Robot, rng: random.Random) -> list[str]:
    """A program that needs no filter drives inside a fence around the estimate, and the filter is killed or hangs."""
    robot.chain.restart("cmd_vel_guard", geofence="2.0", geofence_topic="estimate")
    robot.chain.end("velocity_controller")
    speaker = robot.ros.speaker("cmd_vel_in", "TwistStamped", 2)

    def drive(message: Any, now: float) -> list[tuple[Any, float]]:
        command = robot.ros.stamped("TwistStamped", "base_footprint", now)
        command.twist.linear.x = 0.1
        robot.record.rests_on(now)
        speaker.publish(command)
        return [(message, now)]

    robot.odometry, until = drive, time.monotonic() + 60.0
    while not (robot.enable() and robot.drives(time.time(), 2.0)):
        if time.monotonic() > until:
            raise Unseen("the robot did not drive inside its fence")
    robot.record.began = at = robot.chain.signal("kalman_filter", rng.choice([signal.SIGKILL, signal.SIGSTOP]))
    time.sleep(FENCE_STANDS + 1.0)
    return robot.moves_on(at + FENCE_STANDS)
