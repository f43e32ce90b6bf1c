"""Faults of the live graph: the time until each stops the robot, and the commands that the robot receives afterwards."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from harness.tables import Figure
from ros_probe import GUARDED, Nodes, Probe, graph

AFTERWARDS = 1.5
"""Time for which the probe listens after the first zero, s: longer than zeros are sent."""
MOVERS = ("cmd_vel_guard", "velocity_controller")
"""Nodes that must be enabled. On an overloaded machine the emergency stop may seem silent to both at any time."""


class Fault(NamedTuple):
    """A fault and its repair; the robot is enabled again afterwards."""

    break_it: Callable[[Probe, Nodes], None]
    mend_it: Callable[[Probe, Nodes], None]


def kill(name: str) -> Fault:
    """Return the fault of a killed process."""
    return Fault(lambda probe, nodes: nodes.signal(name, signal.SIGKILL), lambda probe, nodes: nodes.start(name))


def emergency(pressed: bool | None) -> Fault:
    """Return the fault of an emergency stop that is pressed (true) or falls silent (None)."""

    def press(probe: Probe, nodes: Nodes) -> None:
        probe.pressed = pressed
        probe.tell_emergency()

    def release(probe: Probe, nodes: Nodes) -> None:
        probe.pressed = False

    return Fault(press, release)


def odometry(*, silent: bool) -> Callable[[Probe, Nodes], None]:
    """Return the function that stops or resumes the odometry."""
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
"""Faults, each of which must stop the robot. The guard's own death is not included, since it is not covered."""


def faults(repeats: int) -> dict[str, Any]:
    """Measure the time from each fault to the first zero that the robot receives, and the commands after it."""
    delays: dict[str, list[float]] = {name: [] for name in FAULTS}
    sent_after: dict[str, list[float]] = {name: [] for name in FAULTS}
    seen_after: dict[str, list[float]] = {name: [] for name in FAULTS}
    motions = zeros = 0
    with graph(speaks=True, remappings=GUARDED) as (probe, nodes):
        nodes.start("kalman_filter")
        nodes.start("waypoint_generator", waypoints="far.csv")
        nodes.start("velocity_controller")
        nodes.start("cmd_vel_guard")
        for _ in range(repeats):
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
    figures = [Figure(f"{name}: first zero, largest of {len(times)}", max(times), "s", 0.6) for name, times in delays.items()]
    figures.append(Figure(f"commands but zeros among the {zeros} that followed", motions, "", 1.0))
    details = {"heard_after_s": delays, "seen_in_python_after_s": seen_after, "sent_after_s": sent_after, "zeros": zeros}
    return {"figures": figures, **details}
