"""The nodes' diagnostics in one table, with what each node waits for."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence

from cmd_vel_guard.process import Runner, refuse
from turtlebot_gym_ros.base.executor import FastExecutor
from turtlebot_gym_ros.base.names import absolute, remapping
from turtlebot_gym_ros.graph.recorder import Recorder
from turtlebot_gym_ros.nodes import MODES

LEVELS = ("ok", "warning", "error", "stale")


def _expected(mode: str, reports: Mapping[str, object]) -> tuple[str, ...]:
    """Return the nodes of a mode; a localizer that is there takes the place of the filter."""
    filtering = "localizer" if "localizer" in reports else "kalman_filter"
    return tuple(filtering if name == "kalman_filter" else name for name in MODES[mode])


def main(argv: Sequence[str] | None = None) -> int:
    """Listen, print the table, and return 0 if all nodes of the loop are running without errors, else 1."""
    parser = argparse.ArgumentParser("python -m turtlebot_gym_ros status", description=__doc__)
    parser.add_argument("--mode", choices=list(MODES), default="autonomous", help="which nodes are expected")
    parser.add_argument("--seconds", type=float, default=3.0, help="longest time to listen, s (default: 3)")
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
    until = time.monotonic() + options.seconds
    while time.monotonic() < until and not recorder.reports.keys() >= {*_expected(options.mode, recorder.reports)}:
        time.sleep(0.05)
    reports = dict(recorder.reports)
    runner.close()
    expected = _expected(options.mode, reports)
    start = "".join(f" {word}" for word in remapping(namespace))
    names = (*expected, *sorted(set(reports) - set(expected)))
    rows = {name: reports.get(name, (3, f"not there: python -m turtlebot_gym_ros {name}{start}")) for name in names}
    first = max(map(len, ("node", *rows)))
    print(f"{'node':<{first}}  level    says")
    for name, (level, text) in rows.items():
        print(f"{name:<{first}}  {LEVELS[level]:<7}  {text}")
    return 0 if all(reports.get(name, (3, ""))[0] == 0 for name in expected) else 1
