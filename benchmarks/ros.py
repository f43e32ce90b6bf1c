"""The live ROS 2 graph in figures: how fast it answers, how evenly it ticks, what it costs, how soon a fault stops the robot.

Each node is a process of its own, on real DDS in a ROS domain of its own, on this machine only. This program is the
independent probe: it speaks and listens on rclpy alone. A command has arrived when DDS has it (``received_timestamp``): a
Python callback sees it later, and much later where the probe's own publisher waits for a process that was stopped. Run
``make bench-ros`` on an idle machine; the load during each part stands beside its figures.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import islice, permutations
from math import cos, sin
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import rclpy
import tyro
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from numpy.typing import ArrayLike, NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from rich.console import Console
from rich.table import Table
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from turtlebot_gym.values import STOP, Pose, Senses
from turtlebot_gym_agents.provenance import write_json
from turtlebot_gym_ros.blocks import KalmanFilter, VelocityController
from turtlebot_gym_ros.node.discovery import prepare
from turtlebot_gym_ros.nodes import MODES

PERIOD = 0.05
"""Period of the probe's odometry, s."""
PATIENCE = 60.0
"""Longest wait for a state, s."""
AFTERWARDS = 1.5
"""How long the probe listens on after the first zero, s: for longer than zeros are sent."""
FAR = Pose(1000.0, 0.0, 0.0)
"""A waypoint that is never reached."""
MOVERS = ("cmd_vel_guard", "velocity_controller")
"""Nodes that have to be enabled. On an overloaded machine both may take the emergency stop for silent at any time."""
NODES = MODES["autonomous"]
ORDERS = [NODES, NODES[::-1], *islice(permutations(NODES), 7, 23, 4)]
"""Each node is first, second, third and last in some of these, and before and after every other."""
GUARDED = {"velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"]}
"""Remappings with which the guard stands between controller and robot."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Measure the live graph."""

    messages: int = 1000
    """Odometry messages of which the latency is measured."""
    jitter_seconds: float = 60.0
    """How long the graph is watched at 50 Hz, s."""
    memory_minutes: float = 10.0
    """How long it is watched at 20 Hz, also for CPU and memory, min."""
    repeats: int = 5
    """How often each fault is brought about."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the results here too."""


class Figure(NamedTuple):
    """A result."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    """What it must stay below; None where it is only told."""


class Heard(NamedTuple):
    """A command that the probe received."""

    time: float  # s, steady clock, in the callback
    arrival: float  # s, steady clock, at DDS
    v: float  # m/s
    omega: float  # rad/s
    stamp: float  # s, by who sent it

    @property
    def is_zero(self) -> bool:
        """Whether it stops the robot."""
        return self.v == 0.0 and self.omega == 0.0


class Nodes:
    """The processes, by the names of their nodes."""

    def __init__(self, folder: Path, remappings: dict[str, list[str]]) -> None:
        self._folder, self._remappings = folder, remappings
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._parameters: dict[str, dict[str, Any]] = {}

    def start(self, name: str, **parameters: Any) -> None:
        """Start a node; one that was killed is started again with the parameters it had."""
        if name in self._processes:
            self._processes[name].wait()
        given = self._parameters.setdefault(name, parameters)
        words = [word for key, value in given.items() for word in ("-p", f"{key}:={value}")]
        command = [sys.executable, "-m", "turtlebot_gym_ros", name, "--ros-args", *words, *self._remappings.get(name, [])]
        with (self._folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(command, cwd=self._folder, stdout=log, stderr=log)

    def __iter__(self) -> Iterator[str]:
        return iter(self._processes)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a node."""
        self._processes[name].send_signal(number)

    def cpu(self, name: str) -> float:
        """Return the processor time that a node has used, s."""
        stat = Path(f"/proc/{self._processes[name].pid}/stat").read_text().rpartition(")")[2].split()
        return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")  # utime and stime, proc(5)

    def memory(self, name: str) -> int:
        """Return the resident memory of a node, kB."""
        status = Path(f"/proc/{self._processes[name].pid}/status").read_text()
        return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS:"))

    def close(self) -> None:
        """End all of them."""
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self._processes.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


class Probe:
    """The robot, as far as the graph can tell: odometry and an emergency stop go out, commands come in. One thread does it all.

    Args:
        speaks: Whether it publishes odometry; if not, a plant does.
    """

    def __init__(self, *, speaks: bool) -> None:
        self.node = Node("probe")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.heard: list[Heard] = []
        self.ticks: list[float] = []
        """Arrivals of the plant's true state, s."""
        self.sent: list[float] = []
        """When odometry was published, s."""
        self.headings: list[float] = []
        self.stamp = time.time_ns()
        """Of the next odometry, ns."""
        self.silent = False
        """Whether the odometry has stopped."""
        self.pressed: bool | None = False
        """What the emergency stop says; None is nothing."""
        self._draws = np.random.default_rng(0)
        self.node.create_subscription(TwistStamped, "cmd_vel", self._hear, 100)
        self.node.create_subscription(Odometry, "true_state", lambda message: self.ticks.append(time.monotonic()), 100)
        if speaks:
            self._odometry = self.node.create_publisher(Odometry, "odom", 10)
            self._emergency = self.node.create_publisher(Bool, "emergency_stop", 10)
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.node.create_timer(PERIOD, self._send, clock=steady)
            self.node.create_timer(0.1, self.tell_emergency, clock=steady)

    def _hear(self, message: TwistStamped, info: dict[str, int]) -> None:
        now, age = time.monotonic(), 1e-9 * (time.time_ns() - info["received_timestamp"])
        twist, stamp = message.twist, 1e-9 * Time.from_msg(message.header.stamp).nanoseconds
        self.heard.append(Heard(now, now - age, twist.linear.x, twist.angular.z, stamp))

    def _send(self) -> None:
        """Publish odometry of a robot that stands still and looks about, so that each message leads to a command of its own."""
        message = Odometry()
        message.header.frame_id = "odom"
        message.header.stamp = Time(nanoseconds=self.stamp).to_msg()
        self.stamp += round(PERIOD * 1e9)
        heading = self._draws.uniform(-0.5, 0.5)
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = sin(0.5 * heading), cos(0.5 * heading)
        if not self.silent:
            self.headings.append(heading)
            self.sent.append(time.monotonic())
            self._odometry.publish(message)

    def tell_emergency(self) -> None:
        """Publish what the emergency stop says."""
        if self.pressed is not None:
            self._emergency.publish(Bool(data=self.pressed))

    def spin(self, seconds: float) -> None:
        """Work for some time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def until(self, condition: Callable[[], Any], *, patience: float = PATIENCE) -> None:
        """Work until a condition holds; patience in s.

        Raises:
            TimeoutError: If it does not hold in time.
        """
        deadline = time.monotonic() + patience
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"waited {patience} s in vain.")
            self._executor.spin_once(timeout_sec=0.01)

    def enable(self, name: str) -> None:
        """Call a node's ``~/enable`` until it agrees."""
        client = self.node.create_client(SetBool, f"{name}/enable")

        def agrees() -> bool:
            future = client.call_async(SetBool.Request(data=True))
            self._executor.spin_until_future_complete(future, timeout_sec=1.0)
            answer = future.result() if future.done() else None
            return answer is not None and answer.success

        self.until(client.service_is_ready)
        self.until(agrees)  # a request to a server that was killed, and is not missed yet, gets no answer: ask again
        self.node.destroy_client(client)

    def drive(self, *names: str) -> None:
        """Enable nodes, and wait until the robot is driven."""
        for name in names:
            self.enable(name)
        begin = len(self.heard)
        self.until(lambda: any(not command.is_zero for command in self.heard[begin:]))
        self.spin(0.5)


@contextmanager
def graph(*, speaks: bool, remappings: dict[str, list[str]]) -> Iterator[tuple[Probe, Nodes]]:
    """Yield a probe, and processes to be started, which end with the block; where it fails, print what they said."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "far.csv").write_text(f"{FAR.x},{FAR.y},{FAR.theta}\n")
        nodes = Nodes(Path(folder), remappings)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            yield Probe(speaks=speaks), nodes
        except Exception:
            for log in Path(folder).glob("*.log"):
                print(f"--- {log.stem}\n{log.read_text()[-2000:]}", file=sys.stderr)
            raise
        finally:
            nodes.close()
            rclpy.shutdown()


def expected(headings: list[float]) -> NDArray[np.float64]:
    """Return the commands (n, 2) that filter and controller answer odometry with, as plain objects in a loop."""
    kalman_filter = KalmanFilter(KalmanFilter.Params())
    controller = VelocityController(VelocityController.Params(policy="proportional", period=PERIOD))
    commands = []
    for k, heading in enumerate(headings):
        odometry = Senses(Pose(0.0, 0.0, heading), STOP, True)
        estimate = kalman_filter.step(PERIOD if k else 0.0, odometry)["estimate"]
        command = controller.step(PERIOD if k else 0.0, estimate, FAR, None)["command"]
        commands.append(command)
    return np.array(commands)


def same(commands: ArrayLike, others: ArrayLike) -> int:
    """Return how many commands (n, 2) are the same, but for the heading's way through a quaternion."""
    return int((np.abs(np.subtract(commands, others)) < 1e-9).all(1).sum())


def starts() -> tuple[list[Figure], dict[str, Any]]:
    """Measure the time from launching four processes at once, in several orders, until all of them are heard."""
    seconds = []
    for order in ORDERS:
        with graph(speaks=False, remappings={}) as (probe, nodes):
            topics = {"odom": Odometry, "estimate": Odometry, "reference": PoseStamped, "cmd_vel": TwistStamped}
            silent = set(topics)
            for topic, kind in topics.items():
                probe.node.create_subscription(kind, topic, lambda _, silent=silent, topic=topic: silent.discard(topic), 10)
            for name in order:
                nodes.start(name, **({"start_enabled": True} if name == "velocity_controller" else {}))
            begin = time.monotonic()
            probe.until(lambda silent=silent: not silent)
            seconds.append(time.monotonic() - begin)
    name = f"all of 4 processes are heard, slowest of {len(ORDERS)} orders"
    return [Figure(name, max(seconds), "s", 5.0)], {"seconds": dict(zip(map(" ".join, ORDERS), seconds, strict=True))}


def latency(config: Config) -> tuple[list[Figure], dict[str, Any]]:
    """Measure the time from odometry to the command that it leads to, filter and controller each in a process of its own."""
    n = config.messages
    with graph(speaks=True, remappings={}) as (probe, nodes):
        nodes.start("kalman_filter")
        nodes.start("waypoint_generator", waypoints="far.csv")
        nodes.start("velocity_controller", policy="proportional", period=PERIOD)
        probe.drive("velocity_controller")
        before = len(probe.heard)
        probe.until(lambda: len(probe.heard) > before)  # the next odometry is most of a period away
        begin, first = len(probe.sent), len(probe.heard)
        probe.stamp += 2_000_000_000  # a gap after which filter and controller begin again, as `expected` does
        probe.until(lambda: len(probe.sent) >= begin + n, patience=PATIENCE + n * PERIOD)
        probe.silent = True
        probe.spin(0.2)
    heard, sent = probe.heard[first:], np.array(probe.sent[begin:])
    commands = np.array([(command.v, command.omega) for command in heard])
    m = min(len(sent), len(heard))
    delays = 1e3 * (np.array([command.arrival for command in heard[:m]]) - sent[:m])
    in_python = 1e3 * (np.array([command.time for command in heard[:m]]) - sent[:m])
    should = expected(probe.headings[begin:])
    own, previous = same(commands[:m], should[:m]), same(commands[1:m], should[: m - 1])
    p50, p99, worst = (float(value) for value in np.percentile(delays, [50.0, 99.0, 100.0]))
    return [
        Figure("/odom to /cmd_vel, p50", p50, "ms", 3.0),
        Figure("/odom to /cmd_vel, p99", p99, "ms", 6.0),
        Figure("/odom to /cmd_vel, largest", worst, "ms"),
        Figure("/odom to a Python callback on /cmd_vel, p50", float(np.percentile(in_python, 50.0)), "ms"),
        Figure("/odom to a Python callback on /cmd_vel, p99", float(np.percentile(in_python, 99.0)), "ms"),
        Figure("commands that are not those of their own odometry", len(sent) - own, "", 1.0),
    ], {"odometry": len(sent), "commands": len(heard), "own": own, "of_the_odometry_before": previous}


def watch(*, rate: float, seconds: float) -> tuple[list[Figure], dict[str, Any]]:
    """Measure the plant's jitter, and each node's share of a core and its memory, while the whole graph drives squares."""
    period = 1.0 / rate
    with graph(speaks=False, remappings=GUARDED) as (probe, nodes):
        nodes.start("turtlebot_simulator", period=period)
        nodes.start("kalman_filter", period=period)
        nodes.start("waypoint_generator", period=period, laps=100)
        nodes.start("velocity_controller", period=period)
        nodes.start("cmd_vel_guard")
        nodes.start("data_logger", output="bag")
        probe.drive(*MOVERS)
        probe.spin(5.0)  # discovery and first use are over
        first, begin = len(probe.ticks), time.monotonic()
        cpu = {name: nodes.cpu(name) for name in nodes}
        times: list[float] = []
        memory: dict[str, list[int]] = {name: [] for name in nodes}
        while (at := time.monotonic() - begin) < seconds:
            times.append(at)
            for name in nodes:
                memory[name].append(nodes.memory(name))
            probe.spin(1.0)
        spent = time.monotonic() - begin
        shares = {name: 100.0 * (nodes.cpu(name) - cpu[name]) / spent for name in nodes}
    jitter = 1e3 * np.abs(np.diff(probe.ticks[first:]) - period)
    half = len(times) // 2
    slopes = {name: 60.0 * np.polyfit(times[half:], values[half:], 1)[0] for name, values in memory.items()}
    figures = [
        Figure(f"jitter of the plant at {rate:g} Hz, p99", float(np.percentile(jitter, 99.0)), "ms", 5.0),
        Figure(f"jitter of the plant at {rate:g} Hz, largest", float(jitter.max()), "ms"),
        *(
            Figure(f"CPU of {name} at {rate:g} Hz", share, "%", 10.0 if rate == 20.0 else None)
            for name, share in shares.items()
        ),
    ]
    if rate == 20.0:
        figures += [
            Figure(f"memory of {name}, slope over {spent / 120.0:.1f} min", slope, "kB/min", 100.0)
            for name, slope in slopes.items()
        ]
    every = max(1, len(times) // 60)
    return figures, {
        "intervals": len(jitter),
        "seconds": spent,
        "memory_at_s": times[::every],
        "memory_kb": {name: values[::every] for name, values in memory.items()},
    }


class Fault(NamedTuple):
    """What goes wrong, and how it is put right; the robot is enabled again afterwards."""

    break_it: Callable[[Probe, Nodes], None]
    mend_it: Callable[[Probe, Nodes], None]


def kill(name: str) -> Fault:
    """Return the fault that a process is killed."""
    return Fault(lambda probe, nodes: nodes.signal(name, signal.SIGKILL), lambda probe, nodes: nodes.start(name))


def emergency(pressed: bool | None) -> Fault:
    """Return the fault that the emergency stop is pressed (true) or falls silent (None)."""

    def press(probe: Probe, nodes: Nodes) -> None:
        probe.pressed = pressed
        probe.tell_emergency()

    def release(probe: Probe, nodes: Nodes) -> None:
        probe.pressed = False

    return Fault(press, release)


def odometry(*, silent: bool) -> Callable[[Probe, Nodes], None]:
    """Return what stops the odometry, or lets it go on."""
    return lambda probe, nodes: setattr(probe, "silent", silent)


FAULTS = {
    "kill -9 of the controller": kill("velocity_controller"),
    "kill -9 of the filter": kill("kalman_filter"),
    "kill -9 of the waypoint generator": kill("waypoint_generator"),
    "SIGSTOP of the controller": Fault(
        lambda probe, nodes: nodes.signal("velocity_controller", signal.SIGSTOP),
        lambda probe, nodes: nodes.signal("velocity_controller", signal.SIGCONT),
    ),
    "odometry stops": Fault(odometry(silent=True), odometry(silent=False)),
    "emergency stop is pressed": emergency(True),
    "emergency stop falls silent": emergency(None),
}
"""Each must stop the robot. The guard's own death is not among them: it is not covered."""


def faults(config: Config) -> tuple[list[Figure], dict[str, Any]]:
    """Measure the time from each fault to the first zero that the robot hears, and what it hears from then on."""
    delays: dict[str, list[float]] = {name: [] for name in FAULTS}
    sent_after: dict[str, list[float]] = {name: [] for name in FAULTS}
    seen_after: dict[str, list[float]] = {name: [] for name in FAULTS}
    motions = zeros = 0
    with graph(speaks=True, remappings=GUARDED) as (probe, nodes):
        nodes.start("kalman_filter")
        nodes.start("waypoint_generator", waypoints="far.csv")
        nodes.start("velocity_controller")
        nodes.start("cmd_vel_guard")
        for _ in range(config.repeats):
            for name, (break_it, mend_it) in FAULTS.items():
                probe.drive(*MOVERS)
                sent = len(probe.sent)
                probe.until(lambda sent=sent: len(probe.sent) > sent)
                begin, start, clock = len(probe.heard), time.monotonic(), time.time()  # just after an odometry
                break_it(probe, nodes)
                probe.until(lambda begin=begin: any(command.is_zero for command in probe.heard[begin:]))
                probe.spin(AFTERWARDS)
                heard = probe.heard[begin:]
                first = next(k for k, command in enumerate(heard) if command.is_zero)
                delays[name].append(heard[first].arrival - start)
                seen_after[name].append(heard[first].time - start)
                sent_after[name].append(heard[first].stamp - clock)
                zeros += len(heard) - first
                motions += sum(not command.is_zero for command in heard[first:])
                mend_it(probe, nodes)
    figures = [Figure(f"{name}: first zero, largest of {len(each)}", max(each), "s", 0.6) for name, each in delays.items()]
    figures.append(Figure(f"commands but zeros among the {zeros} that followed", motions, "", 1.0))
    return figures, {"heard_after_s": delays, "seen_in_python_after_s": seen_after, "sent_after_s": sent_after, "zeros": zeros}


def measure(config: Config) -> dict[str, Any]:
    """Return the results of all parts, each with the load of the machine before and after it (1 min average)."""
    parts: dict[str, Callable[[], tuple[list[Figure], dict[str, Any]]]] = {
        "start": starts,
        "latency": lambda: latency(config),
        "graph at 20 Hz": lambda: watch(rate=20.0, seconds=60.0 * config.memory_minutes),
        "graph at 50 Hz": lambda: watch(rate=50.0, seconds=config.jitter_seconds),
        "faults": lambda: faults(config),
    }
    results: dict[str, Any] = {}
    for name, part in parts.items():
        before = os.getloadavg()[0]
        figures, details = part()
        results[name] = {"load": [before, os.getloadavg()[0]], "figures": figures, **details}
    return {"cores": len(os.sched_getaffinity(0)), "parts": results}


def main() -> None:
    """Measure, print a table, and write JSON."""
    config = tyro.cli(Config, description=__doc__)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that no node is left behind
    os.environ["ROS_DOMAIN_ID"] = str(215 + os.getpid() % 17)  # above those that people and the tests use
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    prepare()
    result = measure(config)
    table = Table("", "figure", "below", "met", "load", title=f"{result['cores']} cores")
    for part, results in result["parts"].items():
        table.add_section()
        for name, value, unit, limit in results["figures"]:
            before, after = results["load"]
            must, met = ("", "") if limit is None else (f"{limit:g}", "yes" if value < limit else "NO")
            table.add_row(f"{part}: {name}", f"{value:.3g} {unit}", must, met, f"{before:.1f} to {after:.1f}")
    Console().print(table)
    if config.json is not None:
        write_json(config.json, result, config=asdict(config))


if __name__ == "__main__":
    main()
