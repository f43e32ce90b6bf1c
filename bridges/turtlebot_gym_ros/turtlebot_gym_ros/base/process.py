"""Run nodes, in this thread or with an executor in its own, so that the main thread is free for signals and notebooks."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from threading import Event, Thread
from typing import Any, NoReturn

import rclpy
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from turtlebot_gym_ros.base.discovery import prepare
from turtlebot_gym_ros.base.executor import best_executor
from turtlebot_gym_ros.base.parameters import words_of
from turtlebot_gym_ros.base.reports import sturdy
from turtlebot_gym_ros.base.session import ENDINGS, LIFELINE, SUSPENSIONS, counts, lifeline
from turtlebot_gym_ros.base.session import listening as _endings_wait

LAST_WORD = 4.0
"""Time after which a process that was asked to end is terminated, s; launch files escalate at 5 s."""
KILL = 10.0
"""Time after which a node's process that was asked to end is killed, s."""
SETTLE = 0.3
"""Time in which the announcements of nodes that end at the same moment usually arrive, s."""
SPIN = 0.03
"""Longest time without a look for signals where callbacks run in the main thread, s."""
_interrupted = Event()


class Runner:
    """A context, and an executor that runs nodes in its own thread.

    Args:
        arguments: Command line, whose part after ``--ros-args`` applies to all its nodes.
        domain: ROS domain; None for that of the environment.
        executor: Type of the executor; None for `executor.best_executor`.
        local: Whether discovery stays on this machine unless the environment says otherwise.
        beside: Another runner, whose context, with its arguments and domain, it shares and leaves open. On a busy machine the
            nodes of a new context hear nothing for up to 3 s, those of a known one after milliseconds.
    """

    def __init__(
        self,
        arguments: Sequence[str] = (),
        *,
        domain: int | None = None,
        executor: type[Executor] | None = None,
        local: bool = True,
        beside: Runner | None = None,
    ) -> None:
        prepare(local=local)
        self.context = beside.context if beside else Context()
        self._owns_context = not beside
        if not beside:
            # rclpy's own signal handlers end the context first, and then no zeros can be sent.
            options = SignalHandlerOptions.NO
            rclpy.init(args=list(arguments), context=self.context, domain_id=domain, signal_handler_options=options)
        self._executor = (executor or best_executor())(context=self.context)
        self._running: list[Any] = []
        self._closing = False
        self._thread = Thread(target=self._spin, name="executor", daemon=True)
        self.failed: Callable[[], None] = lambda: None
        """Called if the thread ends with an error, after which no node runs any more."""

    def add(self, runnable: Any) -> None:
        """Add a node, or an object with one; it runs at once if the runner has started.

        If it has a ``close``, that publishes what is left to publish, and of an object it also destroys the node. Before
        the process is suspended, its ``halt`` or its ``switch`` stops the robot.
        """
        self._running.append(runnable)
        node = getattr(runnable, "node", runnable)
        for service in node.services:  # those of rclpy for parameters raise if a request has an unknown type
            service.callback = sturdy(node, service.srv_name, service.callback)
        self._executor.add_node(node)

    def require_names(self) -> None:
        """Check that each node has a name of its own.

        Raises:
            ValueError: If two have the same: a remapping of ``__node`` is for all of them.
        """
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

    def suspend(self) -> None:
        """Suspend this process while the robot stands; nothing moves the robot until the process runs again."""
        with ExitStack() as resting:
            for runnable in self._running:
                getattr(runnable, "halt", bool)()
                if switch := getattr(runnable, "switch", None):
                    resting.enter_context(switch.at_rest())
            os.kill(os.getpid(), signal.SIGSTOP)

    def close(self) -> None:
        """Shut down the nodes, last added first, then the thread and the context, even if a block is stuck in a step."""
        self._closing = True
        self._executor.shutdown(timeout_sec=0.5)
        if self._thread.is_alive():
            self._thread.join(0.5)
        for runnable in reversed(self._running):
            if hasattr(runnable, "close"):
                runnable.close()
            if isinstance(runnable, Node) or not hasattr(runnable, "close"):
                getattr(runnable, "node", runnable).destroy_node()
        self._running.clear()
        if self._owns_context and self.context.ok():
            self.context.shutdown()


def refuse(error: BaseException) -> int:
    """Print the reason why a node does not start on one line, and return its exit code."""
    print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
    return 2


def be_interruptible() -> None:
    """Let signals that end a process raise KeyboardInterrupt, and note it: one that is raised within a destructor is lost."""
    shown = sys.unraisablehook

    def interrupt(*_: object) -> None:
        _interrupted.set()
        raise KeyboardInterrupt

    _interrupted.clear()
    sys.unraisablehook = lambda lost: None if lost.exc_type is KeyboardInterrupt else shown(lost)
    for ending in filter(counts, ENDINGS):
        signal.signal(ending, interrupt)


def go_on() -> None:
    """Raise KeyboardInterrupt if it was noted: call it before motions, and again and again in a wait that may be long."""
    if _interrupted.is_set():
        raise KeyboardInterrupt


def run(
    makes: Sequence[Callable[..., Any]],
    argv: Sequence[str] | None = None,
    *,
    in_thread: bool = False,
    local: bool = True,
) -> int:
    """Run nodes in one process until a signal ends it. Call it in the main thread.

    A node that moves a robot sends zeros first, also before it is suspended.

    Args:
        makes: Make a node each, in a ``context``; a ValueError, TypeError, OSError, ImportError or RuntimeError refuses its
            arguments.
        argv: Command line without the program's name; None for that of the process.
        in_thread: Whether callbacks run in a thread of their own, so that even a stuck one does not keep the process from
            ending; else in this one.
        local: Whether discovery stays on this machine unless the environment says otherwise.

    Returns:
        The exit code 2, with one line on stderr, if the arguments were refused. Otherwise the process ends: with code 0, or 1
        after an error in a callback.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    failures: list[int] = []
    with _endings_wait(lifeline()) as wait:
        try:
            runner = Runner(arguments, local=local)
        except Exception as error:  # rclpy raises a RuntimeError of its own for each kind of bad argument
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
            try:
                while not asked(0.0):
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


@contextmanager
def processes(
    nodes: Sequence[tuple[str, Mapping[str, Any]]], words: Sequence[str], environment: Mapping[str, str] | None = None
) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run nodes of this package in processes of their own, and end them; they end also if this process is killed.

    Args:
        nodes: Their names and parameters.
        words: ROS arguments of each, such as remappings.
        environment: Variables of each besides those of this process.
    """
    running: list[subprocess.Popen[bytes]] = []
    # A signal at the parent's death, as Linux knows it, would also come when the thread ends that started them.
    theirs, ours = os.pipe()
    try:
        for name, parameters in nodes:
            command = [sys.executable, "-m", "turtlebot_gym_ros", name, "--ros-args", *words_of(parameters), *words]
            variables = {**os.environ, **(environment or {}), LIFELINE: str(theirs)}
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # until it is ready to end quietly
            running.append(subprocess.Popen(command, env=variables, pass_fds=[theirs]))
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield running
    finally:
        for process in running:
            process.terminate()
        for process in running:
            try:
                process.wait(KILL)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        os.close(theirs)
        os.close(ours)
