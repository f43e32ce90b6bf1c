"""The faults to inject into a guard.

Each begins with a driving robot, and returns the number of unsafe motions besides those that were too late.
"""

from __future__ import annotations

import math
import random
import signal
import time

from faults_robot import Robot

SETTLE = 0.06
"""Time for a message to take effect, s: several cycles of the guard on a busy machine."""


def suspended(robot: Robot, rng: random.Random, low: float = 1.2, high: float = 3.0) -> int:
    """Stop the guard's process while two sources publish, both of which end meanwhile."""
    robot.set(**{"in": (0.15, 0.0), "teleop": (0.1, 0.0)})
    time.sleep(0.15)
    robot.guard.send_signal(signal.SIGSTOP)
    duration = rng.uniform(low, high)
    time.sleep(duration * rng.uniform(0.1, 0.6))
    robot.set()
    time.sleep(duration * 0.4)
    robot.guard.send_signal(signal.SIGCONT)
    time.sleep(0.6)
    return 0


def briefly_suspended(robot: Robot, rng: random.Random) -> int:
    """Stop the guard's process for 0.1 to 0.6 s."""
    return suspended(robot, rng, 0.1, 0.6)


def short_press(robot: Robot, rng: random.Random) -> int:
    """Press and release a button within 0 to 10 ms."""
    with robot.lock:
        robot.say(0, True)
        time.sleep(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.01)]))
        robot.say(0, False)
        since = time.time() + SETTLE
    time.sleep(0.5)
    return len(robot.motions(since))


def suspended_press(robot: Robot, rng: random.Random) -> int:
    """Press and release a button while the guard's process is stopped."""
    robot.guard.send_signal(signal.SIGSTOP)
    time.sleep(rng.uniform(0.05, 0.4))
    with robot.lock:
        robot.say(1, True)
        robot.say(1, False)
    time.sleep(rng.uniform(0.05, 0.4))
    since = time.time()
    robot.guard.send_signal(signal.SIGCONT)
    time.sleep(0.5)
    return len(robot.motions(since + SETTLE))


def two_buttons(robot: Robot, rng: random.Random) -> int:
    """Hold one of two buttons, and ask to be enabled."""
    which = rng.randrange(2)
    with robot.lock:
        robot.pressed[which] = True
    time.sleep(0.3)
    since = time.time()
    accepted = 0
    for _ in range(4):
        time.sleep(rng.uniform(0.0, 0.1))
        accepted += robot.enable(True)
    return accepted + len(robot.motions(since))


def button_dies(robot: Robot, rng: random.Random) -> int:
    """Let one of two buttons fall silent while the other continues."""
    which = rng.randrange(2)
    with robot.lock:
        robot.pressed[which] = None
    since = time.time() + 0.5 + SETTLE
    time.sleep(0.9)
    return robot.enable(True) + len(robot.motions(since))


def old_stamp(robot: Robot, rng: random.Random) -> int:
    """Send commands that are 1 to 60 s old by their stamp."""
    robot.set()
    since = time.time() + 0.4 + SETTLE
    for _ in range(20):
        robot.command(rng.choice(["in", "teleop"]), 0.15, 0.0, age=rng.choice([1.0, 60.0]))
        time.sleep(0.05)
    return len(robot.motions(since))


def flood(robot: Robot, rng: random.Random) -> int:
    """Send 2000 commands a second, for half a second, some of them stops."""
    robot.set()
    since, stops = time.time(), rng.random() < 0.5
    for k in range(1000):
        robot.command("in", 0.0 if stops and k % 2 else 0.1, 0.0)
        time.sleep(max(0.0, since + k * 0.0005 - time.time()))
    duration = time.time() - since
    time.sleep(0.5)
    published = sum(since < at <= since + duration for at, _, _ in list(robot.heard))
    return max(0, published - math.ceil(50.0 * duration) - 3)


def nonsense(robot: Robot, rng: random.Random) -> int:
    """Send commands that are not finite, or far above the limits."""
    since = time.time()
    robot.set(**{"in": rng.choice([(math.nan, 0.1), (0.1, math.inf), (9.0, -3.0), (1e300, 1e300), (-50.0, 0.0)])})
    time.sleep(0.6)
    commands = [(v, omega) for at, v, omega in list(robot.heard) if at > since]
    return sum(not abs(v) + abs(omega) * 0.08 <= 0.20971 for v, omega in commands)


def disabled(robot: Robot, rng: random.Random) -> int:
    """Disable the guard while commands continue, and enable it after the last one."""
    if not robot.enable(False):
        return 0  # a service that did not answer in time
    since = time.time()
    time.sleep(rng.uniform(0.1, 0.4))
    robot.set()
    robot.enable(True)
    time.sleep(0.4)
    return len(robot.motions(since))


WITHOUT_BUTTONS = (suspended, briefly_suspended, old_stamp, flood, nonsense, disabled)
WITH_BUTTONS = (short_press, suspended_press, two_buttons, button_dies)
FAULTS = {fault.__name__: fault for fault in (*WITHOUT_BUTTONS, *WITH_BUTTONS)}
