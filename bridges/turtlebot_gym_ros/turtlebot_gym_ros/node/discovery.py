"""Discovery of nodes, fast and by default on this machine only, and their clean shutdown.

A simulation on a network with robots must not drive one of them by accident, so discovery stays on this machine until
``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` is set. Call `prepare` before the first `rclpy.init`, when the middleware reads it.
"""

from __future__ import annotations

import faulthandler
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from rclpy.context import Context

PROFILE = Path(__file__).with_name("fastdds.xml")
"""Profile that announces a participant every 0.2 s at first, since the first packets of two that start at once are often
lost."""
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_ASKED = (_RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")

LAST_WORD = 4.0
"""Time after which a process that was asked to end is terminated, s; launch files escalate at 5 s."""
SETTLE = 0.3
"""Time in which the announcements of nodes that end at the same moment usually arrive, s."""


def profiles_variable() -> str:
    """Return the variable from which this machine's Fast DDS reads its profile; version 3, since Kilted, renamed it."""
    folders = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    return _PROFILES[0 if any(Path(folder, "libfastdds.so").exists() for folder in folders if folder) else 1]


def prepare(*, local: bool = True) -> bool:
    """Set environment variables that are not set yet.

    Args:
        local: Whether discovery stays on this machine.

    Returns:
        Whether discovery stays on this machine by this default.
    """
    if not any(name in os.environ for name in _PROFILES):
        os.environ[profiles_variable()] = str(PROFILE)
    stays = local and not any(os.environ.get(name) for name in _ASKED)
    if stays:
        os.environ[_RANGE] = "LOCALHOST"
    return stays


def leave(context: Context, close: Callable[[], object]) -> NoReturn:
    """Destroy a context's nodes, then its DDS participant when the network is quiet, and end the process with exit code 0.

    The PyPI build of Fast DDS deadlocks if it destroys a participant during a discovery callback: it waits for the callback
    while it holds the lock that the callback needs (eProsima/Fast-DDS #6513). Many callbacks run when a whole graph ends at
    once. A participant is destroyed with its last node, so one node is kept until the departure of the others has been
    announced.

    Args:
        context: The context.
        close: Function that destroys its nodes.
    """
    from rclpy.node import Node

    faulthandler.dump_traceback_later(LAST_WORD, exit=True)  # also ends a hang in C, and shows where it is
    keeper = Node("_leaving", context=context, enable_rosout=False, start_parameter_services=False)
    close()
    time.sleep(SETTLE)
    keeper.destroy_node()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
