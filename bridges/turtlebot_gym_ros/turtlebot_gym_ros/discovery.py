"""How nodes find each other: on this machine only unless asked, and quickly.

A simulation on a network with robots must not drive one of them by accident, so discovery stays on this machine until
``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` is set. To be called before the first `rclpy.init`: the middleware reads it then.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILE = Path(__file__).with_name("fastdds.xml")
"""Announces a participant every 0.2 s at first: of two that start at once the first packets are often lost."""
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_ASKED = (_RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


def prepare(*, local: bool = True) -> bool:
    """Set what the environment leaves open.

    Args:
        local: Whether to stay on this machine.

    Returns:
        Whether discovery stays on this machine because nobody asked for anything else.
    """
    if not any(name in os.environ for name in _PROFILES):
        os.environ[_PROFILES[0]] = str(PROFILE)
        os.environ[_PROFILES[1]] = str(PROFILE)
    stays = local and not any(os.environ.get(name) for name in _ASKED)
    if stays:
        os.environ[_RANGE] = "LOCALHOST"
    return stays
