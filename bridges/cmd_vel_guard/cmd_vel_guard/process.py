"""Run a node in the main thread until a signal ends it; a node that moves a robot sends zeros first."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from cmd_vel_guard.executor import SteadyExecutor
from cmd_vel_guard.reports import sturdy
from cmd_vel_guard.session import SUSPENSIONS, lifeline, listening

LAST_WORD = 4.0
"""Time after which a process that was asked to end is terminated, s; launch files escalate at 5 s."""
SETTLE = 0.3
"""Time in which the announcements of nodes that end at the same moment usually arrive, s."""
SPIN = 0.03
"""Longest time without a look for signals, s."""
PROFILE = Path(__file__).with_name("fastdds.xml")
"""Profile of Fast DDS that announces a participant every 0.2 s at first, since the first packets of two that start at once are
often lost."""
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


def prepare() -> None:
    """Set the environment variables of Fast DDS, unless there are some; it reads them at the first `rclpy.init`."""
    if not any(name in os.environ for name in _PROFILES):
        folders = filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep))
        is_new = any(Path(folder, "libfastdds.so").exists() for folder in folders)  # version 3 renamed the variable
        os.environ[_PROFILES[0 if is_new else 1]] = str(PROFILE)
        # A killed process leaves its shared memory behind, and others may not hear those that start later (eProsima/Fast-DDS
        # #5469): a standby was deaf to 2 of 46 guards that followed a killed one. Sockets end with their process.
        os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


def precede(priority: int) -> None:
    """Let this process run before ordinary ones and those of a lower priority, where the system permits it (``ulimit -r``)."""
    with suppress(OSError):  # inherited by the threads of DDS, which begin later
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))


def _refuse(error: BaseException) -> int:
    print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
    return 2


def run(make: Callable[[Context], Any], argv: Sequence[str] | None = None, *, lifelines: Sequence[int] = ()) -> int:
    """Run a node until a signal ends it. Call it in the main thread.

    The node's ``halt`` sends zeros, before the process ends and before it is suspended. Its ``may_end``, if any, is asked all
    the time whether the process may end, and told whether it was asked to.

    Args:
        make: Makes the node in a context; a ValueError, TypeError, OSError, ImportError or RuntimeError refuses its arguments.
        argv: Command line without the program's name; None for that of the process.
        lifelines: Files at whose end the process is asked to end, besides that of the process that started it, see `session`.

    Returns:
        The exit code 2, with one line on stderr, if the arguments were refused. Otherwise the process ends: with code 0, or 1
        after an error in a callback.
    """
    prepare()
    arguments, context, failures = list(sys.argv[1:] if argv is None else argv), Context(), 0
    with listening([*lifeline(), *lifelines]) as wait:
        try:
            # rclpy's own signal handlers end the context first, and then no zeros can be sent.
            rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
        except Exception as error:  # rclpy raises one of its own for each kind of bad argument
            return _refuse(error)
        try:
            # Arguments before --ros-args would be taken as remappings in an old syntax, or ignored.
            for unknown in remove_ros_args(arguments) + [word for word in arguments[:1] if word != "--ros-args"]:
                raise ValueError(f"unknown argument {unknown!r}; parameters are given as --ros-args -p NAME:=VALUE.")
            node = make(context)
        except (ValueError, TypeError, OSError, ImportError, RuntimeError) as error:
            context.shutdown()
            return _refuse(error)
        for service in node.services:  # those of rclpy for parameters raise if a request has an unknown type
            service.callback = sturdy(node, service.srv_name, service.callback)
        executor = SteadyExecutor(context=context)
        executor.add_node(node)
        gc.freeze()  # what is there stays: each full collection through it would hold up callbacks for 0.1 s, more under load

        def asked() -> bool:
            while (number := wait(0.0)) in SUSPENSIONS:
                node.halt()
                os.kill(os.getpid(), signal.SIGSTOP)
            return number is not None

        may_end, ends = getattr(node, "may_end", bool), False
        try:
            while not may_end(ends := asked() or ends):
                executor.spin_once(timeout_sec=SPIN)
        except BaseException:
            traceback.print_exc()
            failures = 1
        return _leave(node, executor, context, code=failures)


def _leave(node: Any, executor: SteadyExecutor, context: Context, *, code: int) -> NoReturn:
    """Send zeros, destroy a node, then its DDS participant when the network is quiet, and end the process.

    The PyPI build of Fast DDS deadlocks if it destroys a participant during a discovery callback: it waits for the callback
    while it holds the lock that the callback needs (eProsima/Fast-DDS #6513). Many callbacks run when a whole graph ends at
    once. A participant is destroyed with its last node, so one node is kept until the departure of the others has been
    announced.
    """
    faulthandler.dump_traceback_later(LAST_WORD, exit=True)  # also ends a hang in C, and shows where it is
    keeper = Node("_leaving", context=context, enable_rosout=False, start_parameter_services=False)
    executor.shutdown(timeout_sec=0.5)
    node.halt()
    node.destroy_node()
    context.shutdown()
    time.sleep(SETTLE)
    keeper.destroy_node()
    with suppress(OSError):  # of a terminal that is closed
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)
