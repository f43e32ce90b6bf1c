"""Parameters that are those of a preset or a file, but for some fields: a mapping with the key ``base``.

``{"base": "rough", "odometry": {"dropout_probability": 0.1}}`` is the noise ``rough`` with another share of lost measurements.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

from turtlebot_gym.validation import did_you_mean, refusal

BASE = "base"
"""Key of a mapping whose other keys change some fields of what this one names."""

T = TypeVar("T")


def split(given: Any) -> tuple[Any, Mapping[str, Any]]:
    """Return what an option is based on, and the fields that differ; none if it is no mapping with a base."""
    if isinstance(given, Mapping) and BASE in given:
        return given[BASE], {name: value for name, value in given.items() if name != BASE}
    return given, {}


def vary(value: T, changes: Mapping[str, Any], name: str) -> T:
    """Return parameters with other values of some fields.

    Args:
        value: The parameters, a dataclass.
        changes: New values by field; those of a field that is parameters itself may be a mapping of some of its fields.
        name: What messages call the parameters.

    Raises:
        ValueError: If there is no such field, or a value breaks its rule.
    """
    if not changes:
        return value
    if not is_dataclass(value):
        raise refusal(name, "parameters, of which fields can be changed", value)
    known, given = [item.name for item in fields(value) if item.init], {}
    for key, change in changes.items():
        if key not in known:
            has = f"{type(value).__name__} has no {' '.join(str(key).split())}; it has {', '.join(known)}."
            raise ValueError(f"{name}: {has}{did_you_mean(key, known)}")
        part = getattr(value, key)
        inside = is_dataclass(part) and isinstance(change, Mapping) and "name" not in change  # a name chooses another class
        given[key] = vary(part, change, f"{name}.{key}") if inside else change
    made: Any = value
    return replace(made, **given)


def flattened(changes: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield keys with dots, and values, of nested mappings."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and value:
            yield from flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
