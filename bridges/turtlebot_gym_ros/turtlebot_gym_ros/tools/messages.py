"""Messages as YAML, as ros2cli writes them."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
import yaml

from turtlebot_gym.config import did_you_mean

LONGEST = 128
"""Elements of an array that `text_of` shows, as in ros2cli."""


def plain_of(value: Any, longest: int = LONGEST) -> Any:
    """Return a message as mappings, lists, numbers and texts; longer arrays are cut."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain_of(getattr(value, name), longest) for name in value.get_fields_and_field_types()}
    if isinstance(value, (array, np.ndarray, list, tuple)):
        shown = [plain_of(each, longest) for each in value[:longest]]
        return shown + ([f"... {len(value) - longest} more"] if len(value) > longest else [])
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    return value.item() if isinstance(value, np.generic) else value


class _Dumper(yaml.SafeDumper):
    """Writes mappings in lines, and lists of numbers on one."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write each value where it stands."""
        return True


_Dumper.add_representer(
    list,
    lambda dumper, values: dumper.represent_sequence(
        "tag:yaml.org,2002:seq", values, flow_style=not any(isinstance(value, (dict, list)) for value in values)
    ),
)


def text_of(message: Any, longest: int = LONGEST) -> str:
    """Return a message as YAML, with at most ``longest`` elements of each array."""
    text = yaml.dump(
        plain_of(message, longest), Dumper=_Dumper, sort_keys=False, default_flow_style=False, allow_unicode=True, width=120
    )
    return text.removesuffix("\n").removesuffix("\n...")


def field_of(message: Any, path: str) -> Any:
    """Return a field of a message, such as "pose.pose.position"; the message itself for an empty path.

    Raises:
        ValueError: If there is no such field.
    """
    for name in filter(None, path.split(".")):
        names = message.get_fields_and_field_types() if hasattr(message, "get_fields_and_field_types") else {}
        if name not in names:
            there = f"there are {', '.join(names)}" if names else "what stands there has none"
            raise ValueError(f"no field {name!r} of {path!r}; {there}.{did_you_mean(name, names)}")
        message = getattr(message, name)
    return message
