"""Values in a flat buffer: from a value's own structure, functions that load it from an array and store it there.

The buffer is cut into tiles of `TILE` environments; in a tile each number of a value has a run of `TILE` places, one per
environment. So the compiled loop reads and writes whole vector registers, at distances that the compiler knows, and needs no
proof that two arrays do not overlap.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel

TILE = 32
"""Environments per tile."""


@cache
def _tuple_type(dataclass_type: type) -> type:
    """Return the NamedTuple with a dataclass's fields: compiled code knows no dataclasses."""
    return namedtuple(dataclass_type.__name__, [item.name for item in fields(dataclass_type)])  # type: ignore[return-value]  # noqa: PYI024


def as_tuple(value: Any) -> Any:
    """Return a parameter dataclass, or a tuple of them, as NamedTuples with the same attributes."""
    if is_dataclass(value):
        return _tuple_type(type(value))(*(as_tuple(getattr(value, item.name)) for item in fields(value)))
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
    slices: dict[str, slice]
    """Where each field of the value is among its numbers."""


def packing(example: Any) -> Packing:
    """Write the load and store functions of a value's type.

    Args:
        example: A (nested) NamedTuple of numbers, with the structure and the types (float, bool) of all of its kind.
    """
    types: dict[str, type] = {}
    reads: list[str] = []
    writes: list[str] = []

    def expression(value: Any, path: str) -> str:
        if not isinstance(value, tuple):
            place = f"buffer[at + {len(reads) * TILE}]"
            reads.append(place)
            writes.append(f"    {place} = {path}")
            return f"({place} != 0.0)" if isinstance(value, bool) else place
        if hasattr(value, "_fields"):
            name = f"{type(value).__name__}_{id(type(value))}"
            types[name] = type(value)
            items = [expression(getattr(value, item), f"{path}.{item}") for item in value._fields]  # type: ignore[attr-defined]
            return f"{types[name] and name}({', '.join(items)})"
        return "(" + "".join(expression(item, f"{path}[{at}]") + ", " for at, item in enumerate(value)) + ")"

    slices = {}
    tree = []
    for name in example._fields:
        start = len(reads)
        tree.append(expression(getattr(example, name), f"value.{name}"))
        slices[name] = slice(start, len(reads))
    source = "\n".join(
        ["def load(buffer, at):", f"    return example_type({', '.join(tree)})", "def store(buffer, at, value):", *writes]
    )
    scope: dict[str, Any] = {**types, "example_type": type(example)}
    exec(source, scope)  # the source is made of field names only
    return Packing(len(reads), kernel(scope["load"]), kernel(scope["store"]), slices)
