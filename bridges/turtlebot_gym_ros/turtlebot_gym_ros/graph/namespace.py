"""Namespaces: several robots in one graph, each with the same nodes and topics below its own name."""

from __future__ import annotations

import re

ROOT = "/"
"""Root namespace, for a graph without its own."""


def absolute(namespace: str) -> str:
    """Return a namespace in ROS's form: "/robot1", or "/" for none.

    Raises:
        ValueError: If ROS would refuse it.
    """
    name = namespace.strip("/")
    if name and not re.fullmatch(r"(?!.*__)[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII):
        raise ValueError(f"namespace must be names of letters, digits and _, joined by /, such as robot1, got {namespace!r}.")
    return ROOT + name


def prefix_of(namespace: str) -> str:
    """Return the default prefix of a robot's frames: "robot1/", or empty in the root namespace."""
    name = absolute(namespace).strip("/")
    return f"{name}/" if name else ""


def remapping(namespace: str) -> list[str]:
    """Return the command-line arguments that put a node into a namespace."""
    return [] if absolute(namespace) == ROOT else ["--ros-args", "-r", f"__ns:={absolute(namespace)}"]
