"""Messages as YAML, in both directions, as ros2cli reads and writes them."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from turtlebot_gym.validation import did_you_mean, short_repr
from turtlebot_gym_ros.base.names import message_type

LONGEST = 128
"""Elements of an array that `text_of` shows, as in ros2cli."""


def message_of(type_name: str, text: str) -> Any:
    """Return a message of a type, such as "std_msgs/msg/Bool", with fields from YAML: "{data: false}".

    Raises:
        ValueError: If the type is not installed, the text is no mapping, or a field is unknown or has another type.
    """
    return filled(message_type(type_name)(), text)


def filled(message: Any, text: str) -> Any:
    """Return a message, with the fields that YAML gives.

    Raises:
        ValueError: If the text is no mapping, or a field is unknown or has another type.
    """
    try:
        values = yaml.safe_load(text) if text.strip() else {}
    except yaml.YAMLError as error:
        raise ValueError(f"values must be YAML such as '{{data: true}}': {' '.join(str(error).split())}.") from error
    _fill(message, values, "")
    return message


def _fill(message: Any, values: Any, path: str) -> None:
    """Write values into the fields of a message; ``path`` is where it stands in the whole."""
    kinds = message.get_fields_and_field_types()
    if not isinstance(values, Mapping):
        raise ValueError(f"{path or 'values'} must be a mapping of {', '.join(kinds) or 'nothing'}, got {short_repr(values)}.")
    for name, value in values.items():
        at = f"{path}.{name}" if path else str(name)
        if name not in kinds:
            raise ValueError(f"there is no field {at!r}; there are {', '.join(kinds)}.{did_you_mean(str(name), kinds)}")
        old = getattr(message, name)
        if hasattr(old, "get_fields_and_field_types"):
            _fill(old, value, at)
            continue
        new = _as(kinds[name], value, at)
        try:
            checked = type(message)(check_fields=True, **{name: new})
        except (AssertionError, TypeError, ValueError) as error:
            raise ValueError(f"{at} must be {kinds[name]}, got {short_repr(value)}.") from error
        setattr(message, name, getattr(checked, name))


def _as(kind: str, value: Any, path: str) -> Any:
    """Return a value of YAML as a field of a kind takes it: whole numbers as floats, mappings as messages."""
    if isinstance(value, list):
        return [
            _as(kind.partition("[")[0].removeprefix("sequence<").partition(">")[0].partition(",")[0], each, path)
            for each in value
        ]
    if kind in ("double", "float") and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if "/" in kind and isinstance(value, Mapping):
        message = message_type(kind.replace("/", "/msg/"))()
        _fill(message, value, path)
        return message
    return value


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
