"""Robots by name. Does not depend on ROS, and knows no robot: other distributions do.

A distribution names its robots by an entry point of the group `GROUP`: a function that takes the value of the parameter
``robot`` and returns the numbers, by the names of the guard's parameters; None for a robot that it does not know. It raises
`ValueError` for one that it refuses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Any

GROUP = "cmd_vel_guard.robots"
"""The group of entry points."""
SOURCES: list[Callable[[str], Mapping[str, Any] | None]] = []
"""Functions that are asked besides those of entry points."""


def numbers_of(name: str) -> Mapping[str, Any]:
    """Return the numbers of a robot: any of the parameters max_linear to scan_frame.

    Raises:
        ValueError: If no distribution knows the robot, or one refuses it.
    """
    for known in (*SOURCES, *_installed()):
        if (numbers := known(name)) is not None:
            return numbers
    raise ValueError(
        f"robot must be one that an installed package knows, got {name!r}: leave robot empty, and set max_linear, max_angular, "
        f"wheel_separation and radius."
    )


@cache  # the metadata of all distributions are read
def _installed() -> tuple[Callable[[str], Mapping[str, Any] | None], ...]:
    """Return the functions of entry points."""
    return tuple(found.load() for found in entry_points(group=GROUP))
