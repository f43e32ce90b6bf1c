"""The nodes' diagnostics in one table, with what each node waits for."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from turtlebot_gym_ros.graph.namespace import absolute, remapping
from turtlebot_gym_ros.graph.recorder import Recorder
from turtlebot_gym_ros.node.runner import Runner, refuse
from turtlebot_gym_ros.nodes import MODES

LEVELS = ("ok", "warning", "error", "stale")


def main(argv: Sequence[str] | None = None) -> int:
    """Listen, print the table, and return 0 if all nodes of the loop are running without errors, else 1."""
    parser = argparse.ArgumentParser(prog="status", description="Print what each node of the graph reports and waits for.")
    parser.add_argument("--mode", choices=list(MODES), default="autonomous", help="which nodes are expected")
    parser.add_argument("--seconds", type=float, default=3.0, help="longest time to listen, s (default 3)")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1; by default all nodes")
    options = parser.parse_args(argv)
    expected = MODES[options.mode]
    try:
        namespace = absolute(options.namespace)
    except ValueError as error:
        return refuse(error)
    runner = Runner()
    recorder = Recorder(runner.context, name="status", namespace=namespace)
    runner.add(recorder)
    runner.start()
    until = time.monotonic() + options.seconds
    while time.monotonic() < until and not all(name in recorder.reports for name in expected):
        time.sleep(0.05)
    reports = dict(recorder.reports)
    runner.close()
    start = "".join(f" {word}" for word in remapping(namespace))
    names = (*expected, *sorted(set(reports) - set(expected)))
    width = max(map(len, names))
    print(f"{'node':<{width}}  level    says")
    for name in names:
        level, text = reports.get(name, (3, f"not there: python -m turtlebot_gym_ros {name}{start}"))
        print(f"{name:<{width}}  {LEVELS[level]:<7}  {text}")
    return 0 if all(reports.get(name, (3, ""))[0] == 0 for name in expected) else 1
