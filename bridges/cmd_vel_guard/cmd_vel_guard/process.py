"""Run nodes until a signal ends the process; nodes that move a robot send zeros first."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from threading import Thread
from typing import Any, NoReturn

import rclpy
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from cmd_vel_guard.discovery import prepare
from cmd_vel_guard.executor import SteadyExecutor
from cmd_vel_guard.reports import sturdy
from cmd_vel_guard.session import SUSPENSIONS, lifeline, listening

LAST_WORD = 4.0
"""Time after which a process that was asked to end is terminated, s; launch files escalate at 5 s."""
SETTLE = 0.3
"""Time in which the announcements of nodes that end at the same moment usually arrive, s."""
SPIN = 0.03
"""Longest time without a look for signals where callbacks run in the main thread, s."""


class Runner:
    """A context, and an executor that runs nodes in the thread that calls `spin_once`, or in one of its own.

    The arguments after ``--ros-args`` are for all its nodes. Discovery stays on this machine if ``local``, see `prepare`.
    """

    def __init__(self, arguments: Sequence[str] = (), *, executor: type[Executor] = SteadyExecutor, local: bool = True) -> None:
        prepare(local=local)
        self.context = Context()
        # rclpy's own signal handlers end the context first, and then no zeros can be sent.
        rclpy.init(args=list(arguments), context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self._executor = executor(context=self.context)
        self._running: list[Any] = []
        self._closing = False
        self._thread = Thread(target=self._spin, name="executor", daemon=True)
        self.failed: Callable[[], None] = lambda: None
        """Called if the thread ends with an error, after which no node runs any more."""

    def add(self, runnable: Any) -> None:
        """Add a node, or an object with one; it runs at once if the runner has started.

        Its ``halt`` stops the robot before the process is suspended or ends, and its ``at_rest``, a context, until a suspended
        process goes on. Its ``close`` publishes what is left to publish, and of an object it also destroys the node. Its
        ``may_end`` is asked all the time whether the process may end, and told whether it was asked to.
        """
        self._running.append(runnable)
        node = getattr(runnable, "node", runnable)
        for service in node.services:  # those of rclpy for parameters raise if a request has an unknown type
            service.callback = sturdy(node, service.srv_name, service.callback)
        self._executor.add_node(node)

    def require_names(self) -> None:
        """Raise `ValueError` if two nodes have the same name: a remapping of ``__node`` is for all of them."""
        names = [getattr(runnable, "node", runnable).get_fully_qualified_name() for runnable in self._running]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise ValueError(f"two nodes are called {twice}: rename one of them by -r NODE:__node:=NAME.")

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def spin_once(self) -> None:
        """Run the callback that is ready next in this thread, and wait for it at most `SPIN`; instead of `start`."""
        self._executor.spin_once(timeout_sec=SPIN)

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except BaseException:  # even a SystemExit ends this thread
            if not self._closing:  # a stuck step may return after its node is gone
                self.failed()
                raise

    def may_end(self, asked: bool) -> bool:
        """Return whether the process may end, which was asked to end or not."""
        return all(getattr(runnable, "may_end", bool)(asked) for runnable in self._running)

    def suspend(self) -> None:
        """Suspend this process while the robot stands; nothing moves the robot until the process runs again."""
        with ExitStack() as resting:
            for runnable in self._running:
                getattr(runnable, "halt", bool)()
                if rest := getattr(runnable, "at_rest", None):
                    resting.enter_context(rest())
            os.kill(os.getpid(), signal.SIGSTOP)

    def close(self) -> None:
        """Shut down the nodes, last added first, then the thread and the context, even if a block is stuck in a step."""
        self._closing = True
        self._executor.shutdown(timeout_sec=0.5)
        if self._thread.is_alive():
            self._thread.join(0.5)
        for runnable in reversed(self._running):
            getattr(runnable, "halt", bool)()
            getattr(runnable, "close", bool)()
            if isinstance(runnable, Node) or not hasattr(runnable, "close"):
                getattr(runnable, "node", runnable).destroy_node()
        self._running.clear()
        if self.context.ok():
            self.context.shutdown()


def precede(priority: int) -> None:
    """Let this process run before ordinary ones and those of a lower priority, where the system permits it (``ulimit -r``)."""
    with suppress(OSError):  # inherited by the threads of DDS, which begin later
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))


def refuse(error: BaseException) -> int:
    """Print the reason why a node does not start on one line, and return its exit code."""
    print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
    return 2


def run(
    makes: Sequence[Callable[..., Any]],
    argv: Sequence[str] | None = None,
    *,
    executor: type[Executor] = SteadyExecutor,
    in_thread: bool = False,
    local: bool = True,
    lifelines: Sequence[int] = (),
) -> int:
    """Run nodes in one process until a signal ends it. Call it in the main thread.

    Each of ``makes`` makes a node in a ``context``; an error refuses its arguments: exit code 2, with one line on stderr.
    Otherwise the process ends with code 0, or 1 after an error in a callback; also when a lifeline ends, see `session`.
    Callbacks run in this thread, or in one of their own, so that even a stuck one does not keep the process from ending.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    failures: list[int] = []
    with listening([*lifeline(), *lifelines]) as wait:
        try:
            runner = Runner(arguments, executor=executor, local=local)
        except Exception as error:  # rclpy raises one of its own for each kind of bad argument
            return refuse(error)
        try:
            # Arguments before --ros-args would be taken as remappings in an old syntax, or ignored.
            for unknown in remove_ros_args(arguments) + [word for word in arguments[:1] if word != "--ros-args"]:
                raise ValueError(f"unknown argument {unknown!r}; parameters are given as --ros-args -p NAME:=VALUE.")
            for make in makes:
                runner.add(make(context=runner.context))
            runner.require_names()
        except (ValueError, TypeError, OSError, ImportError, RuntimeError) as error:
            runner.close()
            return refuse(error)
        gc.freeze()  # what is there stays: each full collection through it would hold up callbacks for 0.1 s, more under load

        def fail() -> None:
            failures.append(1)
            os.kill(os.getpid(), signal.SIGTERM)

        def asked(timeout: float | None = None) -> bool:
            while (number := wait(timeout)) in SUSPENSIONS:
                runner.suspend()
            return number is not None

        if in_thread:
            runner.failed = fail
            runner.start()
            asked()
        else:
            ends = False
            try:
                while not runner.may_end(ends := asked(0.0) or ends):
                    runner.spin_once()
            except BaseException:
                traceback.print_exc()
                failures.append(1)
        return _leave(runner, code=len(failures))


def _leave(runner: Runner, *, code: int) -> NoReturn:
    """Close a runner's nodes, then its DDS participant when the network is quiet, and end the process.

    The PyPI build of Fast DDS deadlocks if it destroys a participant during a discovery callback: it waits for the callback
    while it holds the lock that the callback needs (eProsima/Fast-DDS #6513). Many callbacks run when a whole graph ends at
    once. A participant is destroyed with its last node, so one node is kept until the departure of the others has been
    announced.
    """
    faulthandler.dump_traceback_later(LAST_WORD, exit=True)  # also ends a hang in C, and shows where it is
    keeper = Node("_leaving", context=runner.context, enable_rosout=False, start_parameter_services=False)
    runner.close()
    time.sleep(SETTLE)
    keeper.destroy_node()
    with suppress(OSError):  # of a terminal that is closed
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)
