"""Measure the live ROS 2 graph: latency, jitter, CPU and memory, and the time from a fault to the stop.

Each node runs in its own process, on real DDS in a separate ROS domain, on this machine only. An independent probe publishes
and listens, see `ros_probe`. Run ``make bench-ros`` on an idle machine; the load during each part is reported with its figures.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice, permutations
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rich.table import Table

from harness.machine import cores
from harness.study import Study, measured, run
from harness.tables import Figure, figures_table
from ros_faults import MOVERS, faults
from ros_probe import FAR, GUARDED, PATIENCE, PERIOD, graph
from turtlebot_gym import values
from turtlebot_gym.values import STOP, Pose
from turtlebot_gym_agents.policies.named import SAFETY
from turtlebot_gym_ros.base.discovery import prepare
from turtlebot_gym_ros.blocks import KalmanFilter, VelocityController
from turtlebot_gym_ros.nodes import MODES

NODES = MODES["autonomous"]
PROTECTED = ("vfh", "ppo-rooms", "planner")
"""Policies that drive rooms without and with the safety layer."""
ORDERS = [NODES, NODES[::-1], *islice(permutations(NODES), 7, 23, 4)]
"""Launch orders: each node is first, second, third and last in some of them, and before and after every other."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Measure the live graph."""

    messages: int = 1000
    """Number of odometry messages for the latency."""
    jitter_seconds: float = 60.0
    """Time for which the graph is watched at 50 Hz, s."""
    memory_minutes: float = 10.0
    """Time for which it is watched at 20 Hz, also for CPU and memory, min."""
    repeats: int = 5
    """Number of repetitions of each fault."""
    layer_seconds: float = 20.0
    """Time for which a room is driven with and without the safety layer, s."""
    layer_rooms: int = 3
    """Number of these rooms."""
    only: tuple[str, ...] = ()
    """Parts to measure; by default all."""


def expected(headings: list[float]) -> NDArray[np.float64]:
    """Return the commands (n, 2) of filter and controller for some odometry, as plain objects in a loop."""
    kalman_filter = KalmanFilter(KalmanFilter.Params())
    controller = VelocityController(VelocityController.Params(policy="proportional", period=PERIOD))
    commands = []
    for k, heading in enumerate(headings):
        odometry = values.Odometry(Pose(0.0, 0.0, heading), STOP, True)
        estimate = kalman_filter.step(PERIOD if k else 0.0, odometry)["estimate"]
        command = controller.step(PERIOD if k else 0.0, estimate, FAR, None)["command"]
        commands.append(command)
    return np.array(commands)


def starts() -> dict[str, Any]:
    """Measure the time from launching four processes at once, in several orders, until all of them have published."""
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
    figure = Figure(name, max(seconds), "s", 5.0)
    return {"figures": [figure], "seconds": dict(zip(map(" ".join, ORDERS), seconds, strict=True))}


def latency(config: Config) -> dict[str, Any]:
    """Measure the time from odometry to the resulting command, with filter and controller in separate processes."""
    n = config.messages
    with graph(speaks=True, remappings={}) as (probe, nodes):
        nodes.start("kalman_filter")
        nodes.start("waypoint_generator", waypoints="far.csv")
        nodes.start("velocity_controller", policy="proportional", period=PERIOD)
        probe.drive("velocity_controller")
        before = len(probe.heard)
        probe.until(lambda: len(probe.heard) > before)  # the next odometry is most of a period away
        probe.silent = True
        probe.spin(2.0)  # a gap after which filter and controller restart, as `expected` does
        probe.silent, begin, first = False, len(probe.sent), len(probe.heard)
        probe.until(lambda: len(probe.sent) >= begin + n, patience=PATIENCE + n * PERIOD)
        probe.silent = True
        probe.spin(0.2)
    heard, sent = probe.heard[first:], np.array(probe.sent[begin:])
    commands = np.array([(command.v, command.omega) for command in heard])
    # A command belongs to the odometry from which it follows, up to the rounding of the heading's quaternion: all are distinct.
    follows = (np.abs(expected(probe.headings[begin:])[:, None] - commands) < 1e-9).all(2)
    answered = np.flatnonzero(follows.any(1))
    answers = [heard[k] for k in follows.argmax(1)[answered]]
    delays = 1e3 * (np.array([command.arrival for command in answers]) - sent[answered])
    in_python = 1e3 * (np.array([command.time for command in answers]) - sent[answered])
    p50, p99, worst = (float(value) for value in np.percentile(delays, [50.0, 99.0, 100.0]))
    figures = [
        Figure("/odom to /cmd_vel, p50", p50, "ms", 3.0),
        Figure("/odom to /cmd_vel, p99", p99, "ms", 6.0),
        Figure("/odom to /cmd_vel, largest", worst, "ms"),
        Figure("/odom to a Python callback on /cmd_vel, p50", float(np.percentile(in_python, 50.0)), "ms"),
        Figure("/odom to a Python callback on /cmd_vel, p99", float(np.percentile(in_python, 99.0)), "ms"),
        Figure("odometry without the command that follows from it", len(sent) - len(answers), "", 1.0),
    ]
    return {"figures": figures, "odometry": len(sent), "commands": len(heard)}


def watch(*, rate: float, seconds: float) -> dict[str, Any]:
    """Measure the plant's jitter, and each node's CPU and memory, while the whole graph drives squares."""
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
    return {
        "figures": figures,
        "intervals": len(jitter),
        "seconds": spent,
        "memory_at_s": times[::every],
        "memory_kb": {name: values[::every] for name, values in memory.items()},
    }


def layer(config: Config) -> dict[str, Any]:
    """Measure what the safety layer adds to the controller: graphs in rooms that differ in it alone, in turn."""
    shares: dict[str, list[float]] = {policy + end: [] for policy in PROTECTED for end in ("", SAFETY)}
    delays: dict[str, list[float]] = {policy: [] for policy in shares}
    for seed in range(config.layer_rooms):
        for policy in shares:
            share, some = in_room(policy, seed, config.layer_seconds)
            shares[policy].append(share)
            delays[policy] += some
    figures = []
    for policy in shares:
        p50, p99 = (float(value) for value in np.percentile(delays[policy], [50.0, 99.0]))
        figures += [
            Figure(f"CPU of velocity_controller with {policy}, 10 commands a second", float(np.mean(shares[policy])), "%"),
            Figure(f"/odom to /cmd_vel with {policy}, p50", p50, "ms"),
            Figure(f"/odom to /cmd_vel with {policy}, p99", p99, "ms"),
        ]
    return {"figures": figures, "commands": {policy: len(some) for policy, some in delays.items()}, "cpu": shares}


def in_room(policy: str, seed: int, seconds: float) -> tuple[float, list[float]]:
    """Drive a room of the world "office" in real time.

    Returns:
        The controller's share of a core, %, and the time of each command since the newest odometry, ms.
    """
    with graph(speaks=False, remappings={}) as (probe, nodes):
        arrivals: list[float] = []

        def hear(_: Odometry, info: dict[str, int]) -> None:
            arrivals.append(time.monotonic() - time.time() + 1e-9 * info["received_timestamp"])

        probe.node.create_subscription(Odometry, "odom", hear, 100)
        nodes.start("turtlebot_simulator", world="office", seed=seed)
        nodes.start("kalman_filter")
        nodes.start("waypoint_generator", waypoints="room")
        nodes.start("velocity_controller", policy=policy, goal_tolerance=0.0)
        probe.spin(5.0)  # a controller that is late at its first use refuses what it hears, and waits to be enabled again
        probe.drive("velocity_controller")
        probe.spin(1.0)
        first, begin, used = len(probe.heard), time.monotonic(), nodes.cpu("velocity_controller")
        probe.spin(seconds)
        share = 100.0 * (nodes.cpu("velocity_controller") - used) / (time.monotonic() - begin)
    odometry, commands = np.sort(arrivals), np.array([command.arrival for command in probe.heard[first:]])
    newest = np.searchsorted(odometry, commands) - 1
    return share, (1e3 * (commands - odometry[newest])).tolist()


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of all parts with the machine's load around each, and a table."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that no node is left behind
    os.environ["ROS_DOMAIN_ID"] = str(215 + os.getpid() % 17)  # above those of users and the tests
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    prepare()
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "start": starts,
        "latency": lambda: latency(config),
        "graph at 20 Hz": lambda: watch(rate=20.0, seconds=60.0 * config.memory_minutes),
        "graph at 50 Hz": lambda: watch(rate=50.0, seconds=config.jitter_seconds),
        "faults": lambda: faults(config.repeats),
        "layer": lambda: layer(config),
    }
    results, figures = dict(measured({name: parts[name] for name in config.only or parts})), []
    for part, result in results.items():
        where = "{}, load {:.1f} to {:.1f}: ".format(part, *result["load"])
        figures += [figure._replace(name=where + figure.name) for figure in result["figures"]]
    return {"cores": cores(), "parts": results}, [figures_table(figures, "below", title=f"{cores()} cores")]


if __name__ == "__main__":
    run(Config, measure)
