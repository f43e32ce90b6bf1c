"""Faults of what runs guard and standby: terminals, signals, the computer's clock; and of what a node is given to run.

See `faults_kinds`. A robot must stand 0.5 s after each of these.
"""

from __future__ import annotations

import mmap
import os
import random
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from faults_chain import Terminal
from faults_robot import Fault, Robot, nothing

STANDS = 0.5
"""Time after which the robot stands, s."""
SLACK = 0.1
"""Time that a busy machine may add, s."""
ON_THE_ROBOT = ("cmd_vel_guard", "cmd_vel_standby")
ENDING = [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM]
SUSPENDING = [signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU]
POLICY = """
import time
from pathlib import Path
import numpy as np

def drive(observation):
    fault = Path("fault").read_text()
    while fault == "hang" and Path("fault").read_text() == fault:
        time.sleep(0.01)
    if fault not in ("", "hang"):
        raise eval(fault)("the policy's own")
    return np.array([0.5, 0.0], np.float32)
"""


# Terminals and signals


def terminal(act: Callable[[Terminal], None]) -> Fault:
    """Return the fault of a terminal in which guard and standby run."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        with robot.chain.terminal(*ON_THE_ROBOT) as window:
            robot.drive_again()
            time.sleep(rng.uniform(0.0, 0.2))
            robot.record.began = at = time.time()
            act(window)
            time.sleep(2.0)
            return robot.moves_on(at + STANDS + SLACK)

    return fault


def signalled(numbers: list[signal.Signals]) -> Fault:
    """Return the fault by which guard and standby get the same signal at once."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        number = rng.choice(numbers)
        robot.record.began = at = robot.chain.signal(ON_THE_ROBOT[0], number)
        robot.chain.signal(ON_THE_ROBOT[1], number)
        time.sleep(2.0)
        return robot.moves_on(at + STANDS + SLACK)

    return fault


# The computer's clock


def clock_set(*sizes: float) -> Fault:
    """Return the fault by which the computer's clock is set by a time, s, when a person's radio and all sensors end."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        offset = robot.chain.folder / "offset"
        offset.write_bytes(bytes(mmap.PAGESIZE))
        preloaded = {"LD_PRELOAD": str(_clock(robot.chain.folder)), "CLOCK_SHIM": str(offset)}
        for name in ON_THE_ROBOT:
            robot.chain.restart(name, environment=preloaded)
        robot.record.trusts_source = False
        robot.drive_again()
        robot.teleop = (0.15, 0.0)
        robot.ros.ask("velocity_controller/enable", data=False)
        time.sleep(1.5)  # until it has said its zeros, each of which wakes the guard
        with robot.lock:
            robot.teleop, robot.odometry, robot.scan = None, nothing, lambda message: None
            robot.record.began = at = time.time()
            with offset.open("r+b") as file:
                file.write(struct.pack("d", rng.choice(sizes)))
        time.sleep(3.0)
        return robot.moves_on(at + STANDS + SLACK)

    return fault


def _clock(folder: Path) -> Path:
    """Return the library that sets a process's clock; it is compiled once."""
    library = folder / "clock.so"
    if not library.exists():
        source = Path(__file__).with_name("clock_shim.c")
        subprocess.run(
            ["gcc", "-O2", "-Wall", "-shared", "-fPIC", "-o", library, source, "-ldl", "-lm", "-lpthread"], check=True
        )
    return library


# What a node is given


def own_output(robot: Robot, rng: random.Random) -> list[str]:
    """The guard hears its own commands as a program's; a person drives, and ends."""
    robot.chain.restart("cmd_vel_guard", "-r", "cmd_vel_in:=cmd_vel")
    robot.teleop = (0.15, 0.0)
    until = time.monotonic() + 60.0
    while time.monotonic() < until and not (robot.enable() and robot.drives(time.time(), 2.0)):
        if robot.chain.refuses("cmd_vel_guard"):
            break
    time.sleep(0.5)
    with robot.lock:
        robot.record.began, robot.teleop = time.time(), None
    time.sleep(3.0)
    at = robot.record.began or 0.0
    return robot.moves_on(at + STANDS + SLACK)


def policy(*faults: str) -> Fault:
    """Return the fault of a policy that raises an exception of its own, or hangs: the robot stands, and the node answers."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        folder = robot.chain.folder
        (folder / "policy.py").write_text(POLICY)
        (folder / "fault").write_text("")
        path = os.pathsep.join([str(folder), *(entry for entry in sys.path if entry)])
        robot.chain.restart("velocity_controller", policy="policy:drive", environment={"PYTHONPATH": path})
        robot.drive_again()
        robot.record.began = at = time.time()
        (folder / "fault.new").write_text(rng.choice(faults))
        (folder / "fault.new").replace(folder / "fault")
        time.sleep(2.0)
        (folder / "fault").write_text("")
        time.sleep(1.0)
        answers = robot.ros.ask("velocity_controller/enable", data=False)
        reasons = robot.moves_on(at + STANDS + SLACK)
        return reasons if answers else [*reasons, "the controller is deaf"]

    return fault
