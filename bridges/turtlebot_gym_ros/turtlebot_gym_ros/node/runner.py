"""Run shells: an executor in its own thread, so that the main thread is free for signals, tests and notebooks."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Thread
from typing import Protocol, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from turtlebot_gym_ros.node.block import Block
from turtlebot_gym_ros.node.discovery import leave, prepare
from turtlebot_gym_ros.node.shell import Shell
from turtlebot_gym_ros.node.swift import SwiftExecutor

P = TypeVar("P")


class Runnable(Protocol):
    """A shell, or anything else around a node."""

    node: Node

    def close(self) -> None:
        """Shut down."""
        ...


class Runner:
    """A context, and an executor that runs nodes in its own thread.

    Args:
        arguments: Command line, whose part after ``--ros-args`` applies to all its nodes.
        domain: ROS domain; None for that of the environment.
    """

    def __init__(self, arguments: Sequence[str] = (), *, domain: int | None = None) -> None:
        prepare()
        self.context = Context()
        # rclpy's own signal handlers end the context first, and then no zeros can be sent.
        options = SignalHandlerOptions.NO
        rclpy.init(args=list(arguments), context=self.context, domain_id=domain, signal_handler_options=options)
        self._executor = SwiftExecutor(context=self.context)
        self._running: list[Runnable] = []
        self._closing = False
        self._thread = Thread(target=self._spin, name="executor", daemon=True)

    def add(self, runnable: Runnable) -> None:
        """Add a node; it runs at once if the runner has started."""
        self._running.append(runnable)
        self._executor.add_node(runnable.node)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except Exception:
            if not self._closing:  # a stuck step may return after its node is gone
                raise

    def close(self) -> None:
        """Shut down the nodes, last added first, then the thread and the context, even if a block is stuck in a step."""
        self._closing = True
        self._executor.shutdown(timeout_sec=0.5)
        if self._thread.is_alive():
            self._thread.join(0.5)
        for runnable in reversed(self._running):
            runnable.close()
        self._running.clear()
        if self.context.ok():
            self.context.shutdown()


def refuse(error: BaseException) -> int:
    """Print the reason why a node does not start on one line, and return its exit code."""
    print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
    return 2


ENDINGS = (signal.SIGINT, signal.SIGTERM)
"""Signals by which a process is asked to end."""


@contextmanager
def endings_wait() -> Iterator[Callable[[], None]]:
    """Catch the signals in `ENDINGS`, and yield a function that waits for the first one, including one that came earlier.

    So no signal is lost while a node starts, and none acts by itself. Blocking signals is not enough: existing threads of a
    library do not block them, and a signal taken by such a thread ends the process. The handler writes to a pipe, whichever
    thread it runs in.
    """
    noted, note = os.pipe()
    os.set_blocking(note, False)
    handlers = {ending: signal.signal(ending, lambda *_: None) for ending in ENDINGS}
    before = signal.set_wakeup_fd(note, warn_on_full_buffer=False)

    def wait() -> None:
        while os.read(noted, 1)[0] not in ENDINGS:
            pass

    try:
        yield wait
    finally:
        signal.set_wakeup_fd(before)
        for ending, handler in handlers.items():
            signal.signal(ending, handler)
        os.close(noted)
        os.close(note)


def run(make: Callable[[P], Block], params: type[P], argv: Sequence[str] | None = None, *, name: str | None = None) -> int:
    """Run a block as a node until SIGINT or SIGTERM. Call it in the main thread.

    Args:
        make: Makes the block from its parameters: usually its class.
        params: The dataclass of its parameters.
        argv: Command line without the program's name; None for that of the process.
        name: The node's name; None for that of ``make``, in snake case.

    Returns:
        The exit code 2, with one line on stderr, if the parameters were refused. Otherwise the process ends with code 0.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    with endings_wait() as wait_for_the_end:
        try:
            runner = Runner(arguments)
        except Exception as error:  # rclpy raises a RuntimeError of its own for each kind of bad argument
            return refuse(error)
        try:
            # Arguments before --ros-args would be taken as remappings in an old syntax, or ignored.
            for unknown in remove_ros_args(arguments) + [word for word in arguments[:1] if word != "--ros-args"]:
                raise ValueError(f"unknown argument {unknown!r}; parameters are given as --ros-args -p NAME:=VALUE.")
            runner.add(Shell(make, params, name=name, context=runner.context))
        except (ValueError, TypeError, OSError, ImportError) as error:
            runner.close()
            return refuse(error)
        runner.start()
        wait_for_the_end()
        return leave(runner.context, runner.close)
