"""Values of flags from text, for words KEY=VALUE; an error is one line that names the key."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from turtlebot_gym.config import refusal, short_repr
from turtlebot_gym.files import parse_yaml
from turtlebot_gym_agents.commands.flags import read_whole

_NOTHING = ("none", "null", "")
_TRUTHS = {"true": True, "yes": True, "false": False, "no": False}


def typed(key: str, kind: Any, text: str) -> Any:
    """Return a text as a value of a type.

    Raises:
        ValueError: If it is of another type.
    """
    kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if NoneType in kinds and text.lower() in _NOTHING:
        return None
    chosen = [one for one in kinds if one is not NoneType]
    for one in chosen[:-1]:
        try:
            return _typed(key, one, text)
        except ValueError:
            pass
    return _typed(key, chosen[-1], text)


def free(key: str, text: str) -> Any:
    """Return a text as a value in YAML, in which 3e-4 is a number.

    Raises:
        ValueError: If it is no YAML.
    """
    try:
        return parse_yaml(text)
    except ValueError as error:
        raise ValueError(f"{key} must be a value in YAML, got {short_repr(text)}: {error}") from error


def _typed(key: str, kind: Any, text: str) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is bool:
        if text.lower() not in _TRUTHS:
            raise refusal(key, "true or false", text)
        return _TRUTHS[text.lower()]
    if kind in (int, float):
        try:
            return read_whole(text) if kind is int else float(text)
        except (ValueError, OverflowError):
            raise refusal(key, "a whole number" if kind is int else "a number", text) from None
    if kind is Path:
        return Path(text)
    if origin is Literal and text not in parts:
        raise refusal(key, f"one of {', '.join(map(str, parts))}", text)
    if origin is tuple:
        return _sequence(key, parts, free(key, text) if text.startswith("[") else [text])
    if origin is dict:
        value = free(key, text)
        if not isinstance(value, Mapping):
            raise refusal(key, "a mapping, such as {effort: 0.2}", text)
        return {str(name): _typed(f"{key}.{name}", parts[1], str(part)) for name, part in value.items()}
    return text


def _sequence(key: str, kinds: tuple[Any, ...], value: Any) -> tuple[Any, ...]:
    """Return a list as a tuple of values of types, or of any number of values of one type."""
    many = kinds[-1] is Ellipsis
    if not isinstance(value, list) or (not many and len(value) != len(kinds)):
        raise refusal(key, "a list, such as [a, b]" if many else f"a list of {len(kinds)} values", value)
    each = [kinds[0]] * len(value) if many else kinds
    return tuple(
        _sequence(key, get_args(kind), part) if get_origin(kind) is tuple else _typed(key, kind, str(part))
        for kind, part in zip(each, value, strict=True)
    )
