"""The nodes' diagnostics in one table, with what each node waits for."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from cmd_vel_guard.process import Runner, refuse
from turtlebot_gym_ros.base.executor import FastExecutor
from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.graph.recorder import Recorder

LEVELS = ("ok", "warning", "error", "stale")


def main(argv: Sequence[str] | None = None) -> int:
    """Listen, print the table, and return 0 if all nodes that were heard run without remarks, else 1."""
    parser = argparse.ArgumentParser("python -m turtlebot_gym_ros status", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3.0, help="time to listen, s (default: 3)")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1; by default all nodes")
    options = parser.parse_args(argv)
    try:
        namespace = absolute(options.namespace)
    except ValueError as error:
        return refuse(error)
    runner = Runner(executor=FastExecutor)
    # It subscribes to no velocities: a node of the other type would report an error that only this program caused.
    recorder = Recorder(runner.context, topics={}, name="status", namespace=namespace)
    runner.add(recorder)
    runner.start()
    time.sleep(options.seconds)
    reports = dict(sorted(recorder.reports.items()))
    runner.close()
    first = max(map(len, ("node", *reports)))
    print(f"{'node':<{first}}  level    says")
    for name, (level, text) in reports.items():
        print(f"{name:<{first}}  {LEVELS[level]:<7}  {text}")
    return 0 if reports and not any(level for level, _ in reports.values()) else 1
