"""Faults of the guard, injected live: real processes, real DDS, and an independent listener on ``/cmd_vel`` that judges.

Each worker is a process with a guard of its own in a ROS domain of its own. It is whoever commands, every button of the
emergency stop, and the robot, on rclpy alone: it knows nothing of the guard's code. It notes when each command was sent, and
when DDS says that the guard published each of its own (the source time, on the same clock). A motion is unsafe if the guard
publishes it more than 0.45 s after the newest motion command was sent (0.4 s, and 0.05 s for a guard that loses its processor
between the decision and the message), or after what the fault forbids. What a stopped process leaves on the wheels is not
judged: no process can help it.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from turtlebot_gym_agents.provenance import settings_of, write_json

AGE = 0.45
"""Longest time after the newest command at which a motion may be published, s."""
SETTLE = 0.06
"""Time for a message to take its effect, s: several turns of the guard, on a busy machine."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Inject faults into guards, and count unsafe motions."""

    faults: int = 1000
    """How many, the same number of each kind."""
    workers: int = 4
    """How many guards at a time, at least 2: every second one has emergency stops."""
    busy: int = 2
    """How many processes that only burn time run beside them."""
    seed: int = 0
    """Seed of what varies: durations, speeds, delays."""
    domain: int = 120
    """First of the ROS domains, one for each worker."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the results here too."""


class Robot:
    """A guard's process, all who speak to it, and the listener.

    Args:
        domain: Its ROS domain.
        buttons: Whether it has emergency stops. A suspended guard that has heard one stops for its silence too.
    """

    def __init__(self, domain: int, *, buttons: bool) -> None:
        import rclpy.node
        from geometry_msgs.msg import TwistStamped
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from std_msgs.msg import Bool
        from std_srvs.srv import SetBool

        self.context = Context()
        self.context.init([], domain_id=domain)
        self.node = rclpy.node.Node("faults", context=self.context)
        every = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.heard: list[tuple[float, float, float]] = []
        self.sent: list[float] = []
        self.kinds = TwistStamped, Bool, SetBool
        hear: Any = self._hear
        self.node.create_subscription(TwistStamped, "cmd_vel", hear, every)
        latest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.sources = {name: self.node.create_publisher(TwistStamped, f"cmd_vel_{name}", latest) for name in ("in", "teleop")}
        self.buttons = [self.node.create_publisher(Bool, "emergency_stop", latest) for _ in range(2)]
        self.client = self.node.create_client(SetBool, "cmd_vel_guard/enable")
        self.commands: dict[str, tuple[float, float]] = {}
        self.has_buttons = buttons
        self.pressed: list[bool | None] = [None, None]
        self.lock, self.over = threading.Lock(), threading.Event()
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)

        def spin() -> None:
            while not self.over.is_set():
                executor.spin_once(timeout_sec=0.05)

        self.threads = [threading.Thread(target=each, daemon=True) for each in (spin, self._speak)]
        for thread in self.threads:
            thread.start()
        words = [sys.executable, "-m", "turtlebot_gym_ros", "cmd_vel_guard", "--ros-args", "--log-level", "fatal"]
        self.guard = subprocess.Popen(words, env={**os.environ, "ROS_DOMAIN_ID": str(domain)})

    def _hear(self, message: Any, info: Any) -> None:
        self.heard.append((info["source_timestamp"] * 1e-9, message.twist.linear.x, message.twist.angular.z))

    def _speak(self) -> None:
        """Send what is commanded at 20 Hz and what the buttons say at 10 Hz."""
        turn = 0
        while not self.over.wait(0.05):
            turn += 1
            with self.lock:
                for name, command in self.commands.items():
                    self.command(name, *command)
                for which, pressed in enumerate(self.pressed):
                    if pressed is not None and turn % 2:
                        self.say(which, pressed)

    def command(self, name: str, v: float, omega: float, age: float = 0.0) -> None:
        """Send one command; by its stamp it is as old as it is said to be."""
        message, now = self.kinds[0](), time.time()
        message.header.stamp.sec, message.header.stamp.nanosec = int(now - age), int((now - age) % 1.0 * 1e9)
        message.twist.linear.x, message.twist.angular.z = v, omega
        if age < 0.4 and (v, omega) != (0.0, 0.0) and math.isfinite(v + omega):
            self.sent.append(now)
        self.sources[name].publish(message)

    def say(self, which: int, pressed: bool) -> None:
        """Let a button say once whether it is pressed."""
        self.buttons[which].publish(self.kinds[1](data=pressed))

    def set(self, **commands: tuple[float, float]) -> None:
        """Command this from now on, and nothing else."""
        with self.lock:
            self.commands = commands

    def enable(self, on: bool, patience: float = 5.0) -> bool:
        """Ask the guard, and return whether it agreed."""
        future, until = self.client.call_async(self.kinds[2].Request(data=on)), time.monotonic() + patience
        while not future.done() and time.monotonic() < until:
            time.sleep(0.002)
        return bool(future.done() and future.result().success)

    def drive(self, patience: float = 120.0) -> None:
        """Bring the robot to drive, whatever was before."""
        until = time.monotonic() + patience
        with self.lock:
            self.pressed = [False, False] if self.has_buttons else [None, None]
        while time.monotonic() < until:
            self.set(**{"in": (0.1, 0.2)})
            since = time.time()
            for _ in range(40):
                time.sleep(0.02)
                if any(v > 0.09 for at, v, _ in self.heard[-5:] if at > since):
                    time.sleep(0.1)
                    return
            self.enable(True, 1.0)
        raise RuntimeError("the robot does not drive")

    def motions(self, since: float) -> list[float]:
        """Return when motions were published."""
        return [at for at, v, omega in list(self.heard) if at > since and (v, omega) != (0.0, 0.0)]

    def lag(self, since: float) -> float:
        """Return the longest time between the newest command and a motion."""
        sent = list(self.sent)
        return max((at - sent[bisect_right(sent, at) - 1] for at in self.motions(since)), default=0.0)

    def hold(self, since: float) -> float:
        """Return the longest time from the newest command to the zero that ends its motion."""
        sent, heard = list(self.sent), [each for each in list(self.heard) if each[0] > since]
        ends = [at for (_, *before), (at, *now) in pairwise(heard) if before != [0.0, 0.0] == now]
        return max((at - sent[bisect_right(sent, at) - 1] for at in ends), default=0.0)

    def close(self) -> None:
        """End all."""
        self.over.set()
        for thread in self.threads:
            thread.join()
        self.guard.send_signal(signal.SIGCONT)
        self.guard.kill()
        self.guard.wait()
        self.node.destroy_node()
        self.context.shutdown()


# The faults. Each begins on a robot that drives, and returns how many motions were unsafe beyond those that came too late.


def suspended(robot: Robot, rng: random.Random, low: float = 1.2, high: float = 3.0) -> int:
    """Stop the guard's process while two sources publish, which both end meanwhile."""
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
    """The same for 0.1 to 0.6 s."""
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
    """Let one of two buttons fall silent while the other goes on."""
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
    """Command what is not finite, or far above the limits."""
    since = time.time()
    robot.set(**{"in": rng.choice([(math.nan, 0.1), (0.1, math.inf), (9.0, -3.0), (1e300, 1e300), (-50.0, 0.0)])})
    time.sleep(0.6)
    told = [(v, omega) for at, v, omega in list(robot.heard) if at > since]
    return sum(not abs(v) + abs(omega) * 0.08 <= 0.20971 for v, omega in told)


def disabled(robot: Robot, rng: random.Random) -> int:
    """Disable the guard while commands go on, and enable it when none is sent any more."""
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
FAULTS = {each.__name__: each for each in (*WITHOUT_BUTTONS, *WITH_BUTTONS)}


def work(at: int, config: Config, buttons: bool, tasks: Any, results: Any) -> None:
    """Inject the faults of one worker."""
    from turtlebot_gym_ros.node.discovery import prepare

    prepare()
    robot = Robot(config.domain + at, buttons=buttons)
    try:
        while (task := tasks.get()) is not None:
            name, number = task
            rng = random.Random(f"{config.seed} {name} {number}")
            robot.drive()
            since = time.time()
            beyond = FAULTS[name](robot, rng)
            robot.set()
            lag = robot.lag(since)
            results.put((name, beyond + (lag > AGE), lag, robot.hold(since)))
            if robot.guard.poll() is not None:
                raise RuntimeError("the guard has ended")
            del robot.heard[:-100], robot.sent[:-100]
    except Exception as error:
        results.put((None, repr(error), 0.0, 0.0))
    finally:
        robot.close()


def burn() -> None:
    """Be a busy neighbour, for as long as somebody waits."""
    parent = os.getppid()
    while os.getppid() == parent:
        pass


def measure(config: Config) -> dict[str, dict[str, Any]]:
    """Inject all faults, and return the counts by kind."""
    spawn = multiprocessing.get_context("spawn")
    tasks, results = {buttons: spawn.Queue() for buttons in (False, True)}, spawn.Queue()
    order = [(name, number) for name in FAULTS for number in range(math.ceil(config.faults / len(FAULTS)))]
    random.Random(config.seed).shuffle(order)
    for name, number in order:
        tasks[FAULTS[name] in WITH_BUTTONS].put((name, number))
    neighbours = [spawn.Process(target=burn, daemon=True) for _ in range(config.busy)]
    share = [bool(at % 2) for at in range(config.workers)]
    workers = [spawn.Process(target=work, args=(at, config, on, tasks[on], results)) for at, on in enumerate(share)]
    for process in (*neighbours, *workers):
        process.start()
    for on in share:
        tasks[on].put(None)
    zero = {"injected": 0, "unsafe": 0, "longest_lag": 0.0, "longest_hold": 0.0}
    found: dict[str, dict[str, Any]] = {name: dict(zero) for name in FAULTS}
    try:
        with Progress(console=Console(stderr=True)) as progress:
            bar = progress.add_task("faults", total=len(order))
            for _ in order:
                name, unsafe, lag, hold = results.get(timeout=240.0)
                if name is None:
                    raise RuntimeError(unsafe)
                kind = found[name]
                kind["injected"] += 1
                kind["unsafe"] += unsafe > 0
                kind["longest_lag"] = max(kind["longest_lag"], lag)
                kind["longest_hold"] = max(kind["longest_hold"], hold)
                progress.advance(bar)
    finally:
        for process in neighbours:
            process.kill()
        for process in workers:
            process.join(timeout=10.0)
            if process.is_alive():
                process.terminate()
    return found


def main() -> int:
    """Measure, and print the table."""
    config = tyro.cli(Config, description=__doc__)
    found = measure(config)
    table = Table("fault", "injected", "unsafe", "last motion sent, s", "zero sent, s", caption="after the newest command")
    for name, kind in found.items():
        table.add_row(
            name, str(kind["injected"]), str(kind["unsafe"]), f"{kind['longest_lag']:.3f}", f"{kind['longest_hold']:.3f}"
        )
    total = {key: sum(kind[key] for kind in found.values()) for key in ("injected", "unsafe")}
    table.add_row("all", str(total["injected"]), str(total["unsafe"]))
    Console().print(table)
    if config.json:
        load = os.getloadavg()
        write_json(config.json, {"faults": found, "total": total, "load": load}, config=settings_of(config))
    return int(total["unsafe"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
