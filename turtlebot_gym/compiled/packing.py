"""Values in a flat buffer: from a value's own structure, functions that load it from an array and store it there.

The buffer is cut into tiles of `TILE` environments; in a tile each number of a value has a run of `TILE` places, one per
environment. So the compiled loop reads and writes whole vector registers, at distances that the compiler knows, and needs no
proof that two arrays do not overlap.
"""

from __future__ import annotations

import dataclasses
from collections import namedtuple
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel

TILE = 32
"""Environments per tile."""


@cache
def _tuple_type(dataclass_type: type) -> type:
    """Return the NamedTuple with a dataclass's fields: compiled code knows no dataclasses."""
    return namedtuple(dataclass_type.__name__, [item.name for item in dataclasses.fields(dataclass_type)])  # type: ignore[return-value]  # noqa: PYI024


def as_tuple(value: Any) -> Any:
    """Return a parameter dataclass, or a tuple of them, as NamedTuples with the same attributes."""
    if dataclasses.is_dataclass(value):
        return _tuple_type(type(value))(*(as_tuple(getattr(value, item.name)) for item in dataclasses.fields(value)))
    if isinstance(value, tuple):
        items = [as_tuple(item) for item in value]
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value


def flatten(value: Any) -> Iterator[float]:
    """Yield the numbers of a nested tuple in order."""
    if isinstance(value, tuple):
        for item in value:
            yield from flatten(item)
    else:
        yield float(value)


class Packing(NamedTuple):
    """How a type of value lies in a buffer."""

    size: int
    """Numbers in a value."""
    load: Callable[[Any, int], Any]
    """``load(buffer, at)`` returns the value whose first number is at ``buffer[at]``."""
    store: Callable[[Any, int, Any], None]
    """``store(buffer, at, value)`` writes it."""
    names: tuple[str, ...]
    """The dotted path of each number."""
    slices: dict[str, slice]
    """Where each tuple in the value is among its numbers, by its dotted path."""


def packing(example: Any) -> Packing:
    """Write the load and store functions of a value's type.

    Args:
        example: A (nested) NamedTuple of numbers, with the structure and the types (float, bool) of all of its kind.
    """
    types: dict[str, type] = {}
    places: list[str] = []
    names: list[str] = []
    writes: list[str] = []
    slices: dict[str, slice] = {}

    def read(value: Any, path: str) -> str:
        """Return the expression that reads a value, and note how to write it."""
        if not isinstance(value, tuple):
            places.append(f"buffer[at + {len(places) * TILE}]")
            names.append(path.partition(".")[2])
            writes.append(f"    {places[-1]} = {path}")
            return f"({places[-1]} != 0.0)" if isinstance(value, bool) else places[-1]
        start = len(places)
        fields = getattr(value, "_fields", None)
        if fields is None:
            expression = "(" + "".join(f"{read(item, f'{path}[{at}]')}, " for at, item in enumerate(value)) + ")"
        else:
            kind = f"T{len(types)}"
            types[kind] = type(value)
            expression = f"{kind}({', '.join(read(getattr(value, name), f'{path}.{name}') for name in fields)})"
        slices[path.partition(".")[2]] = slice(start, len(places))
        return expression

    source = "\n".join(
        ["def load(buffer, at):", f"    return {read(example, 'value')}", "def store(buffer, at, value):", *writes]
    )
    scope: dict[str, Any] = dict(types)
    exec(source, scope)  # made of field names only
    return Packing(len(places), kernel(scope["load"]), kernel(scope["store"]), tuple(names), slices)
