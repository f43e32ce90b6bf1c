"""Nodes and tools by name: ``python -m turtlebot_gym_ros NODE --ros-args ...``, ``python -m turtlebot_gym_ros topics``."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any

from cmd_vel_guard.discovery import prepare
from cmd_vel_guard.session import INTERRUPTED
from turtlebot_gym_ros.nodes import BLOCKS, NODES, TOOLS, load, target_of

HELP = """usage: python -m turtlebot_gym_ros NODE [NODE ...] [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...]

{nodes}

Several nodes run in one process; -p NODE:NAME:=VALUE and -r NODE:FROM:=TO are for one of them.
The guard runs apart, python -m cmd_vel_guard NODE.

without ros2cli, TOOL [--help]:

{tools}

velocity_controller starts disabled: watch the robot, and enable it. Only policies such as vfh see obstacles,
by /scan; cmd_vel_guard stops before them unless collision_monitor:=false.
Discovery stays on this machine unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise; to reach a robot, set it to SUBNET.
bringup and status have their own options: see their --help."""


EXTRAS = {"rclpy": "ros", "yaml": "ros", "rosbags": "deploy", "matplotlib": "gym", "PIL": "gym"}
"""The extra that brings a module."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a node, and return its exit code."""
    from turtlebot_gym_agents.process import ending_quietly, let_threads_sleep

    let_threads_sleep()
    return ending_quietly(_run)(argv)


def _run(argv: Sequence[str] | None) -> int:
    name, *rest = list(sys.argv[1:] if argv is None else argv) or ["--help"]
    if name in ("-h", "--help"):
        nodes, tools = ("\n".join(f"  {each:<20} {help}" for each, (_, help) in of.items()) for of in (NODES, TOOLS))
        print(HELP.format(nodes=nodes, tools=tools))
        return 0
    takes_ros_arguments = name in (*BLOCKS, "data_logger")
    names = [name, *takewhile(NODES.__contains__, rest if takes_ros_arguments else [])]
    try:
        target_of(name)
        if len(names) > 1 and (others := [each for each in names if each not in BLOCKS]):
            raise ValueError(f"{others[0]} runs in a process of its own: start it apart.")
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    prepare()
    try:
        if takes_ros_arguments and {"-h", "--help"} & {*rest}:
            print("\n\n".join(map(_explained, names)))
            return 0
        entry = load(name)
        if name not in BLOCKS:
            return entry(rest)
        blocks = [(each, load(each)) for each in names]
        from cmd_vel_guard.process import run
        from turtlebot_gym_ros.base.executor import FastExecutor
        from turtlebot_gym_ros.node.shell import Shell
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        extra = EXTRAS.get("rclpy" if missing.endswith(("_msgs", "_srvs", "_interfaces")) else missing)
        if extra is None:
            raise
        sourced = "source a ROS 2 installation, or " if extra == "ros" else ""
        print(f"error: {missing} is missing: {sourced}pip install 'turtlebot-gym[{extra}]'.", file=sys.stderr)
        return 2
    makes = [partial(Shell, block, block.Params, name=each) for each, block in blocks]
    return run(makes, rest[len(names) - 1 :], executor=FastExecutor, in_thread=True)


def _explained(name: str) -> str:
    from cmd_vel_guard.explain import explain  # loads NumPy, whose threads are told to sleep first

    made, program = load(name), f"python -m turtlebot_gym_ros {name}"
    if name not in BLOCKS:
        module = import_module(made.__module__)
        return explain(program, module.__doc__, module.Parameters)
    from turtlebot_gym_ros.base.frames import Common

    return explain(program, made.__doc__, Common, made.Params)


def end_quietly() -> None:
    """Let Ctrl-C end this program without a traceback until a node or a command decides otherwise: imports take seconds."""

    def end(*_: Any) -> None:
        os.write(2, b"interrupted\n")
        os._exit(INTERRUPTED)

    signal.signal(signal.SIGINT, end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def run_as_program() -> int:
    """Run the node with the name of this program: the entry point of ``ros2 run turtlebot_gym_ros NODE``."""
    end_quietly()
    sys.argv = ["turtlebot_gym_ros", Path(sys.argv[0]).name, *sys.argv[1:]]
    return main()


if __name__ == "__main__":
    end_quietly()
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # the interpreter's shutdown can hang in DDS and would change the exit code of a refusal
