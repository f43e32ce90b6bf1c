"""Files of ROS 2 parameters: nodes, also in namespaces, each with its ``ros__parameters``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

KEY = "ros__parameters"


def nodes_in(content: Any) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node in a file's content by the node's name; empty if it is no file of ROS parameters.

    Parameters in groups, ``FollowPath: {max_vel_x: 0.2}``, are named with a dot, ``FollowPath.max_vel_x``.
    """
    found: dict[str, dict[str, Any]] = {}
    if isinstance(content, Mapping):
        for name, part in content.items():
            if isinstance(part, Mapping) and isinstance(part.get(KEY), Mapping):
                found.setdefault(str(name).rpartition("/")[2], {}).update(_flat(part[KEY]))
            elif isinstance(part, Mapping):
                for node, parameters in nodes_in(part).items():
                    found.setdefault(node, {}).update(parameters)
    return found


def _flat(group: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in group.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat


def number(value: Any) -> float | None:
    """Return a finite number; None for anything else."""
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < float("inf")
    return float(value) if is_number else None
