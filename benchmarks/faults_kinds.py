"""The faults to inject into a robot's chain.

Each begins with a driving robot, and returns the number of unsafe motions besides those that were later than 0.6 s after the
newest measurement: motions after a stop that a person has not ended, or towards a wall inside the stopping zone.
"""

from __future__ import annotations

import copy
import math
import random
import signal
import time
from collections.abc import Callable
from typing import Any

from faults_robot import DEAD_END, Robot

SETTLE = 0.1
"""Time for a message to take effect, s: several cycles of the guard on a busy machine."""
ZONE = 0.02
"""Distance between footprint and wall within which no motion towards it may be, m: less than half of the guard's margin."""

Fault = Callable[[Robot, random.Random], int]


def _after_stop(robot: Robot, wait: float = 0.8) -> int:
    """Count motions from now on, after a stop that only a person may end."""
    since = time.time() + SETTLE
    time.sleep(wait)
    return len(robot.motions(since))


# Measurements that are old


def odometry_late(robot: Robot, rng: random.Random) -> int:
    """Odometry is late by 0.5 to 30 s and says so; in half of the cases the filter begins with it."""
    late = rng.choice([0.5, 0.7, 1.0, 2.0, 5.0, 30.0])

    def delay(message: Any, now: float) -> list[tuple[Any, float]]:
        stamp = robot.clock(now - late)
        message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(stamp % 1.0 * 1e9)
        return [(message, now - late)]

    robot.began, robot.odometry = time.time(), delay
    if rng.random() < 0.5:
        robot.ask("kalman_filter/reset", 1.0)
    time.sleep(1.5)
    return 0


def odometry_burst(robot: Robot, rng: random.Random) -> int:
    """A radio holds the odometry of 1.5 s back, delivers it at once 0.6 to 2 s later, and is dead."""
    held: list[tuple[Any, float]] = []
    robot.odometry = lambda message, now: held.append((message, now)) or []
    time.sleep(1.5)
    robot.odometry = lambda message, now: []
    time.sleep(rng.uniform(0.6, 2.0))
    with robot.lock:
        for message, measured in held:
            robot.rests_on(measured)
            robot.speaker("odom", "Odometry").publish(message)
    time.sleep(1.2)
    return 0


def odometry_dies(robot: Robot, rng: random.Random) -> int:
    """Odometry ends."""
    robot.began, robot.odometry = time.time(), lambda message, now: []
    time.sleep(1.2)
    return 0


def odometry_repeats(robot: Robot, rng: random.Random) -> int:
    """The last odometry is sent again and again."""
    kept: list[tuple[Any, float]] = []

    def repeat(message: Any, now: float) -> list[tuple[Any, float]]:
        kept.append((message, now))
        return kept[:1]

    robot.began, robot.odometry = time.time(), repeat
    time.sleep(1.5)
    return 0


def odometry_impossible(robot: Robot, rng: random.Random) -> int:
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

    robot.began = at = time.time()
    robot.odometry = spoil
    time.sleep(1.5)
    return robot.moves(at + 0.7) + len(robot.motions(at + 0.7))


def scan_late(robot: Robot, rng: random.Random) -> int:
    """Scans are late by 0.7 to 5 s and say so, towards a wall."""
    late, kept = rng.choice([0.7, 1.0, 5.0]), []
    robot.walls = DEAD_END

    def delay(message: Any) -> Any:
        kept.append((time.time(), message))
        due = [each for at, each in kept if at <= time.time() - late]
        return due[-1] if due else None

    return _towards_wall(robot, delay)


# Processes that were suspended


def _suspended(name: str, *, dies: bool) -> Fault:
    """Return the fault that suspends a process for 0.5 to 8 s while what it hears dies or lives."""

    def fault(robot: Robot, rng: random.Random) -> int:
        duration = rng.choice([rng.uniform(0.5, 3.0)] * 4 + [8.0])
        with robot.suspended(name):
            time.sleep(duration * rng.uniform(0.1, 0.6))
            if dies:
                robot.odometry = lambda message, now: []
            time.sleep(duration * 0.4)
        time.sleep(1.0)
        return 0

    return fault


def _suspended_pressed(name: str) -> Fault:
    """Return the fault in which a button is pressed and released while a process is suspended for 0.5 to 8 s."""

    def fault(robot: Robot, rng: random.Random) -> int:
        duration = rng.choice([0.5, 1.0, 2.0, 3.0, 5.0, 8.0])
        with robot.suspended(name):
            time.sleep(rng.uniform(0.1, 0.5) * duration)
            robot.began, robot.pressed[0] = time.time(), True
            time.sleep(0.3)
            robot.pressed[0] = False
            stopped = time.time()
            time.sleep(0.4 * duration)
        late = _after_stop(robot)
        return late if name == "cmd_vel_guard" else len(robot.motions(stopped))

    return fault


def guard_suspended_sources_die(robot: Robot, rng: random.Random) -> int:
    """A person and a program command the guard, and end while it is suspended."""
    robot.teleop = (0.1, 0.0)
    time.sleep(0.2)
    with robot.suspended("cmd_vel_guard"):
        duration = rng.choice([rng.uniform(0.3, 3.0)] * 4 + [8.0])
        time.sleep(0.5 * duration)
        robot.teleop = None
        robot.odometry = lambda message, now: []
        time.sleep(0.5 * duration)
    time.sleep(0.8)
    return 0


# Processes that end


def _guard_ends(number: signal.Signals) -> Fault:
    """Return the fault in which a driving guard is killed or hangs: the standby must stop the robot within 0.3 s."""

    def fault(robot: Robot, rng: random.Random) -> int:
        time.sleep(rng.uniform(0.0, 0.2))
        robot.began = at = time.time()
        robot.signal("cmd_vel_guard", number)
        time.sleep(1.0)
        return robot.moves(at + 0.3) + len(robot.motions(at + 0.3))

    return fault


def standby_ends(robot: Robot, rng: random.Random) -> int:
    """The standby is killed or hangs, in half of the cases the odometry ends too: the guard stops the robot within 0.7 s."""
    robot.began = at = time.time()
    robot.signal("cmd_vel_standby", rng.choice([signal.SIGKILL, signal.SIGSTOP]))
    time.sleep(rng.uniform(0.1, 1.0))
    if rng.random() < 0.5:
        robot.odometry = lambda message, now: []
    time.sleep(1.2)
    return robot.moves(at + 0.7) + len(robot.motions(at + 0.7))


def guard_restarts(robot: Robot, rng: random.Random) -> int:
    """The guard is killed and started again while the program drives: its first message is zero."""
    robot.kill("cmd_vel_guard")
    time.sleep(0.5)
    since = time.time()
    robot.start("cmd_vel_guard")
    while not (later := [command for at, *command in list(robot.heard) if at > since + 0.2]) and time.time() < since + 20.0:
        time.sleep(0.02)
    return int(not later or later[0] != [0.0, 0.0])


# Buttons


def short_press(robot: Robot, rng: random.Random) -> int:
    """A button is pressed and released within 0 to 10 ms."""
    with robot.lock:
        robot.began = time.time()
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
    return sum(robot.ask("cmd_vel_guard/enable", 0.5, data=True) for _ in range(4)) + len(robot.motions(since))


def button_lost(robot: Robot, rng: random.Random) -> int:
    """A radio loses what a button says in 0 to 0.3 s, in which it is pressed and released."""
    assert robot.radio
    robot.began = time.time()
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
        robot.began = time.time()
    time.sleep(0.5)
    return _after_stop(robot) + robot.enable()


def button_restarts(robot: Robot, rng: random.Random) -> int:
    """A button's program ends and another one begins, which is not pressed."""
    with robot.lock:
        robot.began = time.time()
        robot.pressed[0] = None
        robot.silence("emergency_stop", 0)
    time.sleep(rng.uniform(0.6, 1.0))
    robot.pressed[0] = False
    return _after_stop(robot)


# Floods


def _flooded(topic: str, kind: str) -> Fault:
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
            robot.rests_on(time.time())
        if kind == "PoseStamped":
            message.pose.orientation.w = 1.0
        robot.odometry = lambda message, now: []
        robot.began = time.time()
        robot.flood(topic, message, 2.0)
        time.sleep(0.5)
        for name in ("cmd_vel_guard", "velocity_controller") if kind == "Bool" else ():
            robot.kill(name)  # a button that is gone for good: they must be started again
        return 0

    return fault


def flood_elsewhere(robot: Robot, rng: random.Random) -> int:
    """A flood on one of the other topics that the chain hears."""
    topics = {"cmd_vel_standby/alive": "Empty", "reset": "Empty", "nis": "DiagnosticArray", "next_reference": "PoseStamped"}
    topics["initialpose"] = "PoseWithCovarianceStamped"
    return _flooded(*rng.choice([*topics.items()]))(robot, rng)


# Clocks


def _clocks(kind: str) -> Fault:
    """Return the fault in which the robot's clock is off, is set, or drifts, and the odometry dies at last."""

    def fault(robot: Robot, rng: random.Random) -> int:
        size, began = rng.choice([-2.0, -1.0, -0.775, -0.3, 0.3, 0.775, 1.0, 2.0]), time.time()
        drift = (lambda now: now + 0.05 * size * (now - began)) if kind == "drift" else lambda now: now + size
        robot.clock = drift
        if kind == "offset":
            robot.ask("kalman_filter/reset", 1.0)
            robot.ask("velocity_controller/enable", 1.0, data=True)
        time.sleep(2.0)
        robot.odometry = lambda message, now: []
        time.sleep(1.0)
        return 0

    return fault


# Sensors that lie


def _towards_wall(robot: Robot, scan: Callable[[Any], Any]) -> int:
    """Drive towards a wall with a LiDAR that lies, and count whether the robot came too near."""
    robot.began = since = time.time()
    robot.walls, robot.scan = DEAD_END, scan
    time.sleep(6.0)
    return int(robot.nearest(since) < ZONE)


def _lidar(spoil: Callable[[Any], Any]) -> Fault:
    """Return the fault in which a LiDAR changes what it sends."""

    def fault(robot: Robot, rng: random.Random) -> int:
        return _towards_wall(robot, spoil)

    return fault


def lidar_frozen(robot: Robot, rng: random.Random) -> int:
    """The LiDAR repeats its last ranges with fresh stamps."""
    kept: list[Any] = []

    def freeze(message: Any) -> Any:
        kept.append(message.ranges)
        message.ranges = kept[0]
        return message

    return _towards_wall(robot, freeze)


def _filled(value: float, share: float = 1.0) -> Callable[[Any], Any]:
    def fill(message: Any) -> Any:
        count = len(message.ranges)
        message.ranges = [value if k < share * count else each for k, each in enumerate(message.ranges)]
        return message

    return fill


def _turned(message: Any) -> Any:
    half = len(message.ranges) // 2
    message.ranges = [*message.ranges[half:], *message.ranges[:half]]
    return message


def _four_beams(message: Any) -> Any:
    step = len(message.ranges) // 4
    message.ranges = list(message.ranges)[step // 2 :: step]
    message.angle_min, message.angle_increment = message.angle_increment * (step // 2), 0.5 * math.pi
    message.angle_max = message.angle_min + 1.5 * math.pi
    return message


def wrong_fix(robot: Robot, rng: random.Random) -> int:
    """One fix says that the robot is far away; what moves then must still rest on fresh measurements."""
    message = robot.stamped("PoseWithCovarianceStamped", "odom", robot.clock(time.time()))
    message.pose.pose.position.x, message.pose.pose.orientation.w = rng.choice([1e3, -1e3, 1e300]), 1.0
    for at in (0, 7, 35):
        message.pose.covariance[at] = rng.choice([1e-4, 1e-300])
    estimates: list[float] = []
    hear: Any = lambda estimate: estimates.append(estimate.pose.pose.position.x)  # noqa: E731
    subscription = robot.node.create_subscription(robot.kinds["Odometry"], "estimate", hear, 10)
    time.sleep(0.3)
    robot.speaker("pose_fix", "PoseWithCovarianceStamped", 2).publish(message)
    time.sleep(1.0)
    robot.node.destroy_subscription(subscription)
    return sum(abs(x) > 10.0 for x in estimates)


def two_odometries(robot: Robot, rng: random.Random) -> int:
    """Another publisher of odometry says that the robot is 2 m away, and stays when the robot's own ends."""
    robot.began = since = time.time()

    def both(message: Any, now: float) -> list[tuple[Any, float]]:
        other = copy.deepcopy(message)
        other.pose.pose.position.x += 2.0
        robot.speaker("odom", "Odometry", 2).publish(other)
        return [(message, now)] if now < since + 1.0 else []

    robot.odometry = both
    time.sleep(3.0)
    return 0


# Commands


def old_stamp(robot: Robot, rng: random.Random) -> int:
    """Commands of a person are 1 to 60 s old by their stamp, when the odometry has ended."""
    robot.odometry = lambda message, now: []
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
    commands = [(v, omega) for at, v, omega in list(robot.heard) if at > since]
    return sum(not abs(v) + abs(omega) * 0.08 <= 0.22001 for v, omega in commands)


def disabled(robot: Robot, rng: random.Random) -> int:
    """The guard is disabled while commands continue."""
    robot.began = time.time()
    return _after_stop(robot) if robot.enable(False) else 0  # a service that did not answer in time is no stop


WITH_BUTTONS: dict[str, Fault] = {
    "filter suspended, button pressed": _suspended_pressed("kalman_filter"),
    "controller suspended, button pressed": _suspended_pressed("velocity_controller"),
    "guard suspended, button pressed": _suspended_pressed("cmd_vel_guard"),
    "short press": short_press,
    "press lost by a radio": button_lost,
    "one of two buttons held": two_buttons,
    "one of two buttons silent": button_dies,
    "button restarted": button_restarts,
    "flood on emergency_stop": _flooded("emergency_stop", "Bool"),
}
WITHOUT_BUTTONS: dict[str, Fault] = {
    "odometry late": odometry_late,
    "odometry in a burst": odometry_burst,
    "odometry dead": odometry_dies,
    "odometry repeated": odometry_repeats,
    "odometry impossible": odometry_impossible,
    "scans late": scan_late,
    "filter suspended, sources die": _suspended("kalman_filter", dies=True),
    "filter suspended, sources live": _suspended("kalman_filter", dies=False),
    "controller suspended, sources die": _suspended("velocity_controller", dies=True),
    "controller suspended, sources live": _suspended("velocity_controller", dies=False),
    "guard suspended, sources die": guard_suspended_sources_die,
    "guard suspended, sources live": _suspended("cmd_vel_guard", dies=False),
    "guard killed": _guard_ends(signal.SIGKILL),
    "guard hangs": _guard_ends(signal.SIGSTOP),
    "guard restarted": guard_restarts,
    "standby killed or hung": standby_ends,
    "flood on cmd_vel_in": _flooded("cmd_vel_in", "TwistStamped"),
    "flood on cmd_vel_teleop": _flooded("cmd_vel_teleop", "TwistStamped"),
    "flood on scan": _flooded("scan", "LaserScan"),
    "flood on odom": _flooded("odom", "Odometry"),
    "flood on estimate": _flooded("estimate", "Odometry"),
    "flood on reference": _flooded("reference", "PoseStamped"),
    "flood on pose_fix": _flooded("pose_fix", "PoseWithCovarianceStamped"),
    "flood on another topic": flood_elsewhere,
    "clock offset": _clocks("offset"),
    "clock set": _clocks("step"),
    "clock drifts": _clocks("drift"),
    "LiDAR frozen": lidar_frozen,
    "LiDAR covered": _lidar(_filled(math.nan)),
    "LiDAR all zero": _lidar(_filled(0.0)),
    "LiDAR all infinite": _lidar(_filled(math.inf)),
    "LiDAR turned by 180 degrees": _lidar(_turned),
    "LiDAR of four beams": _lidar(_four_beams),
    "wrong fix": wrong_fix,
    "two odometries": two_odometries,
    "commands with old stamps": old_stamp,
    "commands that are nonsense": nonsense,
    "guard disabled": disabled,
}
FAULTS = {**WITHOUT_BUTTONS, **WITH_BUTTONS}
