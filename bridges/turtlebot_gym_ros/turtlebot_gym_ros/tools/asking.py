"""A node that lives as long as a command, and the waits of such a command."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from rclpy.node import Node

from cmd_vel_guard.process import Runner, refuse
from cmd_vel_guard.session import INTERRUPTED
from turtlebot_gym_ros.base.executor import FastExecutor
from turtlebot_gym_ros.base.process import be_interruptible, go_on

T = TypeVar("T")
WAIT = 5.0
"""How long a command waits for the graph by default, s."""


def parser_of(name: str, description: str) -> argparse.ArgumentParser:
    """Return the parser of a tool, with the time for which it waits for the graph."""
    parser = argparse.ArgumentParser(f"python -m turtlebot_gym_ros {name}", description=description)
    parser.add_argument("--wait", type=float, default=WAIT, help=f"how long to wait for the graph, s (default: {WAIT:g})")
    return parser


@contextmanager
def asking() -> Iterator[Node]:
    """Run a node with a name of its own in a thread."""
    runner = Runner(executor=FastExecutor)
    be_interruptible()
    node = Node("turtlebot_gym_tool", context=runner.context, enable_rosout=False, start_parameter_services=False)
    runner.add(node)
    runner.start()
    try:
        yield node
    finally:
        runner.close()


def answered(main: Callable[[Any], int]) -> Callable[[Any], int]:
    """Decorate a command: a refusal is one line and the exit code 2, and Ctrl-C ends quietly."""

    def run(argv: Any = None) -> int:
        try:
            return main(argv)
        except (ValueError, TimeoutError) as error:
            return refuse(error)
        except KeyboardInterrupt:
            return INTERRUPTED

    return run


def until(found: Callable[[], T | None], seconds: float, missing: Callable[[], str]) -> T:
    """Return what ``found`` returns as soon as that is not None; after some seconds raise `TimeoutError` with ``missing``."""
    end = time.monotonic() + seconds
    while (value := found()) is None:
        go_on()
        if time.monotonic() > end:
            raise TimeoutError(missing())
        time.sleep(0.02)
    return value


def listen(seconds: float) -> None:
    """Let a tool's node hear for some seconds."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        go_on()
        time.sleep(0.05)


def remark_if_alone(node: Node) -> str:
    """Return a sentence that says where other nodes were looked for, if a tool's node hears none; else an empty text."""
    if any(name != node.get_name() for name in node.get_node_names()):
        return ""
    domain, reach = node.context.get_domain_id(), os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    where = f"ROS_DOMAIN_ID {domain}, ROS_AUTOMATIC_DISCOVERY_RANGE {reach}"
    return f" No node is heard at all ({where}): does the graph run, with the same values?"
