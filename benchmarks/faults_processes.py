"""Faults of processes, terminals and the computer's clock; each begins with a driving robot."""

from __future__ import annotations

import json
import mmap
import os
import random
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import IO, Any

from faults_chain import CONTROLLER, FILTER, GUARD, STANDBY
from faults_record import STANDS
from faults_robot import SETTLE, Fault, Robot, nothing

SET_STANDS, GUARD_STANDS = 0.6, 0.3
"""Times after a signal, or a clock's step, and after the end of a guard at which the robot stands on a busy machine, s."""
POLICY = """
import json, time
from pathlib import Path
import numpy as np

def drive(observation):
    order = Path("order").read_text()
    while order == "hang":
        time.sleep(0.01)
        order = Path("order").read_text()
    if order.isalpha():
        raise eval(order)("the policy's own")
    return np.array(json.loads(order), np.float32)
"""
"""A policy of one's own, which is ordered a motion, an exception, or to hang."""
AHEAD = "[0.5, 0.0]"


def order(robot: Robot, text: str) -> None:
    """Order something of the policy of one's own."""
    (robot.chain.folder / "order.new").write_text(text)
    (robot.chain.folder / "order.new").replace(robot.chain.folder / "order")


def by_policy(robot: Robot) -> None:
    """Let a policy of one's own drive ahead."""
    path = os.pathsep.join([str(robot.chain.folder), *filter(None, sys.path)])
    (robot.chain.folder / "policy.py").write_text(POLICY)
    order(robot, AHEAD)
    robot.chain.restart(CONTROLLER, policy="policy:drive", environment={"PYTHONPATH": path})
    robot.until(robot.begin)


def by_hand(robot: Robot, v: float, omega: float) -> None:
    """Let a person drive, and no program."""
    robot.ros.ask("velocity_controller/enable", data=False)
    time.sleep(1.5)  # until it has said its zeros, each of which wakes the guard
    robot.teleop = (v, omega)
    robot.until(lambda: robot.drives(3.0, v, omega), 0.0)


def ends(robot: Robot, rng: random.Random, what: str, motion: Any = None, how: Sequence[str] = ("KILL", "STOP")) -> list[str]:
    """A node, or guard and standby "both", or the odometry or a person's sticks end, during a motion, else while it drives."""
    if motion:
        share = motion(rng)  # of the robot's limits
        v, omega = 0.22 * share[0], 2.84 * share[1]
        if what in (GUARD, STANDBY, "sticks"):
            by_hand(robot, v, omega)
        else:
            by_policy(robot)
            order(robot, json.dumps(share))
            robot.until(lambda: robot.drives(3.0, v, omega), 0.0)
    time.sleep(rng.uniform(0.0, 0.2))
    at = time.time()
    if what == "odometry":
        robot.odometry = nothing
    elif what == "sticks":
        robot.teleop = None
    else:
        signal, names = rng.choice(how), (GUARD, STANDBY) if what == "both" else (what,)
        at = min(robot.chain.signal(name, signal) for name in names)
    if what == STANDBY and rng.random() < 0.5:  # the guard must stop it alone
        time.sleep(rng.uniform(0.1, 1.0))
        robot.odometry = nothing
    return robot.must_stand(at + {GUARD: GUARD_STANDS, "both": SET_STANDS}.get(what, STANDS))


def guard_restarts(robot: Robot, rng: random.Random) -> list[str]:
    """The guard is killed and started again while the program drives: its first message is zero."""
    robot.chain.kill(GUARD)
    time.sleep(1.5)  # until the standby has said its zeros, which are not the new guard's
    since = time.time()
    robot.chain.start(GUARD)
    robot.until(lambda: robot.record.heard[-1].arrived > since + 0.2, 30.0)
    first = next(command for command in list(robot.record.heard) if command.arrived > since + 0.2)
    return ["a new guard's first message was a motion"] if first.v or first.omega else []


def fence_without_filter(robot: Robot, rng: random.Random) -> list[str]:
    """A program that needs no filter drives inside a fence around the estimate, and the filter is killed or hangs."""
    robot.chain.restart(GUARD, geofence="2.0", geofence_topic="estimate")
    robot.chain.end(CONTROLLER)
    robot.beside = lambda message, now: robot.send_command("cmd_vel_in", 0.1, 0.0, which=2)
    robot.until(lambda: robot.enable() and robot.drives(2.0), 60.0)
    return robot.must_stand(robot.chain.signal(FILTER, rng.choice(["KILL", "STOP"])) + STANDS)


def suspended(robot: Robot, rng: random.Random, name: str, meanwhile: str) -> list[str]:
    """A process is suspended for 0.5 to 8 s; meanwhile the sources "live" or "die", or a button is "pressed" and released."""
    duration = rng.choice([rng.uniform(0.5, 3.0)] * 4 + [8.0])
    if (name, meanwhile) == (GUARD, "die"):  # a person's commands end too
        robot.teleop = (0.1, 0.0)
        time.sleep(0.2)
    stands = time.time() + (GUARD_STANDS if name == GUARD else STANDS)  # nobody else could stop it meanwhile
    robot.chain.signal(name, "STOP")
    time.sleep(duration * rng.uniform(0.1, 0.5))
    if meanwhile == "die":
        robot.teleop, robot.odometry = None, nothing
    if meanwhile == "pressed":
        robot.pressed[0] = True
        time.sleep(0.3)
        robot.pressed[0] = False
    time.sleep(0.4 * duration)
    until = robot.chain.signal(name, "CONT")
    if meanwhile == "pressed":
        return robot.must_stand((until if name == GUARD else until - 0.4 * duration) + SETTLE, 0.8)
    time.sleep(1.0)
    return robot.moves_on(stands, until) if until > stands else []


def disabled(robot: Robot, rng: random.Random) -> list[str]:
    """The guard is disabled while commands continue."""
    answers = any(robot.enable(False) for _ in range(3))
    return robot.must_stand(time.time() + SETTLE) + ([] if answers else ["the guard does not answer"])


def policy(robot: Robot, rng: random.Random, orders: tuple[str, ...]) -> list[str]:
    """A policy raises an exception of its own, or hangs: the robot stands, and the node answers."""
    by_policy(robot)
    at = time.time()
    order(robot, rng.choice(orders))
    time.sleep(2.0)
    order(robot, AHEAD)
    time.sleep(1.0)
    answers = robot.ros.ask("velocity_controller/enable", data=False)
    return robot.must_stand(at + SET_STANDS) + ([] if answers else ["the controller is deaf"])


def terminal(robot: Robot, rng: random.Random, act: Callable[[IO[bytes]], object]) -> list[str]:
    """Something happens to the keyboard of the terminal in which guard and standby run."""
    with robot.chain.terminal() as keyboard:
        robot.until(robot.begin)
        time.sleep(rng.uniform(0.0, 0.2))
        at = time.time()
        act(keyboard)
        return robot.must_stand(at + SET_STANDS)


def clock_set(robot: Robot, rng: random.Random, sizes: tuple[float, ...]) -> list[str]:
    """The computer's clock is set by a time, s, when a person's radio and all sensors end."""
    offset, library = robot.chain.folder / "offset", robot.chain.folder / "clock.so"
    source = Path(__file__).parent / "clock_shim.c"
    offset.write_bytes(bytes(mmap.PAGESIZE))
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", "-o", library, source, "-ldl", "-lm", "-lpthread"], check=True)
    for name in (GUARD, STANDBY):
        robot.chain.restart(name, environment={"LD_PRELOAD": str(library), "CLOCK_SHIM": str(offset)})
    robot.record.trusts_source = False
    robot.until(robot.begin)
    by_hand(robot, 0.15, 0.0)
    with robot.lock:
        robot.teleop, robot.odometry, robot.scan = None, nothing, lambda message: None
        at = time.time()
        with offset.open("r+b") as file:
            file.write(struct.pack("d", rng.choice(sizes)))
    return robot.must_stand(at + SET_STANDS, 2.5)


NODES = {"filter": FILTER, "controller": CONTROLLER, "guard": GUARD}
PROCESSES: dict[str, Fault] = {
    **{f"{what} suspended, sources die": partial(suspended, name=name, meanwhile="die") for what, name in NODES.items()},
    **{f"{what} suspended, sources live": partial(suspended, name=name, meanwhile="live") for what, name in NODES.items()},
    "guard killed": partial(ends, what=GUARD, how=("KILL",)),
    "guard hangs": partial(ends, what=GUARD, how=("STOP",)),
    "guard restarted": guard_restarts,
    "standby killed or hung": partial(ends, what=STANDBY),
    "guard disabled": disabled,
    "policy raises an exit": partial(policy, orders=("SystemExit", "KeyboardInterrupt", "GeneratorExit")),
    "policy hangs": partial(policy, orders=("hang",)),
}
MOTIONS: dict[str, Fault] = {
    f"{what} ends, robot {verb}": partial(ends, what=name, motion=motion)
    for what, name in {**NODES, "standby": STANDBY, "odometry": "odometry", "sticks": "sticks"}.items()
    for verb, motion in {
        "reverses": lambda rng: (-rng.uniform(0.5, 0.9), 0.0),
        "turns": lambda rng: (0.0, rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.5)),
    }.items()
}
MOTIONS["filter ends, fence by its estimate"] = fence_without_filter
ENDS: dict[str, Fault] = {
    "terminal closed": partial(terminal, act=lambda keyboard: keyboard.close()),
    "Ctrl-C": partial(terminal, act=lambda keyboard: keyboard.write(b"\x03")),
    "Ctrl-Z": partial(terminal, act=lambda keyboard: keyboard.write(b"\x1a")),
    "Ctrl-\\": partial(terminal, act=lambda keyboard: keyboard.write(b"\x1c")),
    "guard and standby hung up": partial(ends, what="both", how=("HUP",)),
    "guard and standby ended by a signal": partial(ends, what="both", how=("INT", "TERM", "QUIT", "USR1", "USR2", "ALRM")),
    "guard and standby suspended by a signal": partial(ends, what="both", how=("TSTP", "TTIN", "TTOU")),
    "computer's clock set back": partial(clock_set, sizes=(-0.775, -2.0, -30.0, -3600.0)),
    "computer's clock set ahead": partial(clock_set, sizes=(0.775, 2.0, 30.0, 3600.0)),
}
