"""Names in the graph: of message types, and of namespaces, in which several robots share one graph."""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any


def absolute(namespace: str, what: str = "namespace") -> str:
    """Return a namespace in ROS's form: "/robot1", or "/" for none; or another absolute name, which the message calls ``what``.

    Raises `ValueError` for a name that ROS would refuse.
    """
    name = namespace.strip("/")
    if name and not re.fullmatch(r"(?!.*__)[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII):
        raise ValueError(f"{what} must be names of letters, digits and _, joined by /, such as robot1, got {namespace!r}.")
    return f"/{name}"


def prefix_of(namespace: str) -> str:
    """Return the default prefix of a robot's frames: "robot1/", or empty in the root namespace."""
    name = absolute(namespace).strip("/")
    return f"{name}/" if name else ""


def message_type(name: str) -> Any:
    """Return a message type by its name in the graph, "std_msgs/msg/Bool"; raise `ValueError` if it is not installed."""
    package, *kinds = name.split("/")
    try:
        folder, kind = kinds
        return getattr(import_module(f"{package}.{folder}"), kind)
    except (ValueError, ImportError, AttributeError) as error:
        raise ValueError(f"{name!r} is no message type that is installed here, such as std_msgs/msg/Bool: {error}.") from error
