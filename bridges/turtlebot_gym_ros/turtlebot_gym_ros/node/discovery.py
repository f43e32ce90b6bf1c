"""How nodes find each other, on this machine only unless asked, and quickly; and how they leave.

A simulation on a network with robots must not drive one of them by accident, so discovery stays on this machine until
``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` is set. To be called before the first `rclpy.init`: the middleware reads it then.
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
"""Announces a participant every 0.2 s at first: of two that start at once the first packets are often lost."""
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_ASKED = (_RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")

LAST_WORD = 4.0
"""Time after which a process that was asked to end is ended, s: before launch files escalate, at 5 s."""
SETTLE = 0.3
"""Time after which what others that end at the same moment have to say is usually heard, s."""


def profiles_variable() -> str:
    """Return the variable from which this machine's Fast DDS reads its profile: version 3, as of Kilted, has renamed it."""
    folders = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    return _PROFILES[0 if any(Path(folder, "libfastdds.so").exists() for folder in folders if folder) else 1]


def prepare(*, local: bool = True) -> bool:
    """Set what the environment leaves open.

    Args:
        local: Whether to stay on this machine.

    Returns:
        Whether discovery stays on this machine because nobody asked for anything else.
    """
    if not any(name in os.environ for name in _PROFILES):
        os.environ[profiles_variable()] = str(PROFILE)
    stays = local and not any(os.environ.get(name) for name in _ASKED)
    if stays:
        os.environ[_RANGE] = "LOCALHOST"
    return stays


def leave(context: Context, close: Callable[[], object]) -> NoReturn:
    """Destroy a context's nodes, then its DDS participant in a quiet moment, and end the process with exit code 0.

    Fast DDS, as it is built for PyPI, hangs for ever where it destroys a participant while a discovery callback is under way:
    it waits for its end, and holds the lock that it needs (eProsima/Fast-DDS #6513). Many are under way where a whole graph
    ends at once. A participant goes with its last node, so one is left over until the others' leaving has been heard.

    Args:
        context: The context.
        close: Destroys its nodes.
    """
    from rclpy.node import Node

    faulthandler.dump_traceback_later(LAST_WORD, exit=True)  # ends what hangs in C all the same, and says where
    keeper = Node("_leaving", context=context, enable_rosout=False, start_parameter_services=False)
    close()
    time.sleep(SETTLE)
    keeper.destroy_node()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
