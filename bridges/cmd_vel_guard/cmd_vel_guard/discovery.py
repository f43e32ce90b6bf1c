"""Discovery of nodes, fast and by default on this machine only.

A simulation on a network with robots must not drive one of them by accident, so discovery stays on this machine until
``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` is set. Call `prepare` before the first `rclpy.init`, when the middleware reads it.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILE = Path(__file__).with_name("fastdds.xml")
"""Profile of Fast DDS that announces a participant every 0.2 s at first, since the first packets of two that start at once are
often lost."""
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_ASKED = (_RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


def prepare(*, local: bool = True) -> None:
    """Set environment variables that are not set yet; discovery stays on this machine if ``local``."""
    if not any(name in os.environ for name in _PROFILES):
        folders = filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep))
        is_new = any(Path(folder, "libfastdds.so").exists() for folder in folders)  # version 3, since Kilted, renamed it
        os.environ[_PROFILES[0 if is_new else 1]] = str(PROFILE)
        # A killed process leaves its shared memory behind, and others may not hear those that start later (eProsima/Fast-DDS
        # #5469): a standby was deaf to 2 of 46 guards that followed a killed one. Sockets end with their process.
        os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    if local and not any(os.environ.get(name) for name in _ASKED):
        os.environ[_RANGE] = "LOCALHOST"
