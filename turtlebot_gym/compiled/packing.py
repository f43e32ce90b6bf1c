"""Values in a flat buffer: where each number of a value stands, and functions that load it from there and store it.

The buffer is divided into tiles of `TILE` environments; in a tile each number of a value has a run of `TILE` places,
one per environment: a cache line.
"""

from __future__ import annotations

import dataclasses
from collections import namedtuple
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.heart import begin, step
from turtlebot_gym.observations import observing
from turtlebot_gym.systems import System
from turtlebot_gym.values import STOP, Pose

TILE = 8
"""Environments per tile: numbers in a cache line, and in the widest vector register."""


def aligned(count: int) -> NDArray[np.float64]:
    """Return so many zeros, at the start of a cache line.

    numpy starts large arrays 16 bytes after one; each load and store of a widest vector would then touch two lines.
    """
    room = np.zeros(count + TILE)
    start = -room.ctypes.data // room.itemsize % TILE
    return room[start : start + count]


@cache
def _numbers_of(dataclass_type: type) -> tuple[str, ...]:
    """Return the names of fields that hold numbers; no kernel may read the others."""
    return tuple(item.name for item in dataclasses.fields(dataclass_type) if item.metadata.get("number", True))


@cache
def _tuple_type(dataclass_type: type) -> type:
    """Return a NamedTuple with a dataclass's fields, since compiled code does not support dataclasses.

    It has a name in this module, by which a pickle finds it.
    """
    name = f"{dataclass_type.__module__}.{dataclass_type.__qualname__}".replace(".", "_")
    kind: Any = namedtuple(name, _numbers_of(dataclass_type))  # noqa: PYI024
    kind.__module__ = __name__
    globals()[name] = kind
    return kind


def as_tuple(value: Any) -> Any:
    """Return a parameter dataclass, or a tuple of them, as NamedTuples with the same attributes."""
    if dataclasses.is_dataclass(value):
        return _tuple_type(type(value))(*(as_tuple(getattr(value, name)) for name in _numbers_of(type(value))))
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


def _items(value: tuple[Any, ...], path: str) -> Iterator[tuple[str, Any]]:
    """Yield the items of a tuple with their dotted paths."""
    fields, dot = getattr(value, "_fields", None), "." if path else ""
    for at, item in enumerate(value):
        yield f"{path}{dot}{fields[at]}" if fields else f"{path}[{at}]", item


def mapped(value: Any, function: Callable[[str, Any], Any], path: str = "") -> Any:
    """Return a nested tuple with ``function(path, number)`` in place of each number, by its dotted path."""
    if not isinstance(value, tuple):
        return function(path, value)
    items = [mapped(item, function, inner) for inner, item in _items(value, path)]
    return type(value)(*items) if hasattr(value, "_fields") else tuple(items)


def in_floats(value: Any) -> Any:
    """Return a nested tuple with integers converted to floats, as a buffer holds them."""
    return mapped(value, lambda path, number: number if isinstance(number, bool) else float(number))


def _slices(value: Any, path: str, at: int, found: dict[str, slice]) -> int:
    """Record the range of numbers of each tuple in a value whose first number has an index; return the next index."""
    if not isinstance(value, tuple):
        return at + 1
    start = at
    for inner, item in _items(value, path):
        at = _slices(item, inner, at, found)
    found[path] = slice(start, at)
    return at


class Packing(NamedTuple):
    """Layout of a type of value in a buffer."""

    example: Any
    """A value of the type, its integers as floats."""
    names: tuple[str, ...]
    """The dotted path of each number."""
    slices: dict[str, slice]
    """Range of numbers of each tuple in the value, by its dotted path."""
    places: tuple[int, ...]
    """Place of each number: numbers that are always equal share one."""
    size: int
    """Number of places."""
    load: Callable[[Any, int], Any]
    """``load(buffer, at)`` returns the value whose first number is at ``buffer[at]``."""
    store: Callable[[Any, int, Any], None]
    """``store(buffer, at, value)`` writes it."""


def packing(example: Any, places: Sequence[int] | None = None) -> Packing:
    """Return the layout of a value's type, with functions, made from its structure, that load and store it.

    Args:
        example: A (nested) NamedTuple of numbers with the structure and the types (float, bool) of all such values.
        places: The place of each number; None for one after another.
    """
    types: dict[str, Any] = {}
    names: list[str] = []
    leaves: list[str] = []
    slices: dict[str, slice] = {}

    def number(path: str, value: Any) -> None:
        place = f"buffer[at + {(len(names) if places is None else places[len(names)]) * TILE}]"
        names.append(path)
        leaves.append(f"({place} != 0.0)" if isinstance(value, bool) else place)

    def read(value: Any) -> str:
        if not isinstance(value, tuple):
            return next(numbers)
        kind = f"T{len(types)}" if hasattr(value, "_fields") else ""
        if kind:
            types[kind] = type(value)
        return f"{kind}({''.join(f'{read(item)}, ' for item in value)})"

    mapped(example, number)
    _slices(example, "", 0, slices)
    numbers = iter(leaves)
    where = tuple(range(len(names))) if places is None else tuple(places)
    writes = [
        f"    buffer[at + {place * TILE}] = value{'.' * (not name.startswith('['))}{name}"
        for place, name in zip(where, names, strict=True)
    ]
    source = ["def load(buffer, at):", f"    return {read(example)}", "def store(buffer, at, value):", *writes, "    return"]
    scope: dict[str, Any] = types
    exec("\n".join(source), scope)  # made of field names only
    return Packing(in_floats(example), tuple(names), slices, where, max(where, default=-1) + 1, scope["load"], scope["store"])


class Layout(NamedTuple):
    """Layout of a system's values."""

    parameters: Packing
    world: Packing
    """The tile: the only state that is kept between steps."""
    outcome: Packing
    observation: Packing


@cache
def layout_of(system: System) -> Layout:
    """Return the layout of a system's values in a tile, from an example of each."""
    p, waypoints, around = as_tuple(system.example), (Pose(0.0, 0.0, 0.0),), system.surroundings
    scene = around.at(around.make([system.example]), 0) if around else ()
    world = begin(system, system.lay_out(1, p, scene)[0], 1, waypoints, p, scene)
    world, outcome = step(system, world, STOP, 1, waypoints, p, scene)
    for term in system.terms:
        if not term.in_scene:
            term.example(world, p)
    return Layout(*map(packing, (p, world, outcome, observing(system.terms)(world, p))))
