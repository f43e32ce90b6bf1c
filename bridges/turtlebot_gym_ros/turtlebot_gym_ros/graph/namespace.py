"""Namespaces: several robots in one graph, each with the same nodes and topics below a name of its own."""

from __future__ import annotations

import re

ROOT = "/"
"""The namespace of a graph that has none."""


def absolute(namespace: str) -> str:
    """Return a namespace as ROS writes it: "/robot1", or "/" for none.

    Raises:
        ValueError: If ROS would refuse it.
    """
    name = namespace.strip("/")
    if name and not re.fullmatch(r"(?!.*__)[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII):
        raise ValueError(f"namespace must be names of letters, digits and _, joined by /, such as robot1, got {namespace!r}.")
    return ROOT + name


def prefix_of(namespace: str) -> str:
    """Return what stands before a robot's frames by default: "robot1/", or nothing in the root."""
    name = absolute(namespace).strip("/")
    return f"{name}/" if name else ""


def remapping(namespace: str) -> list[str]:
    """Return the words of a node's command line that put it into a namespace."""
    return [] if absolute(namespace) == ROOT else ["--ros-args", "-r", f"__ns:={absolute(namespace)}"]
