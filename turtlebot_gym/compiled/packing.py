"""Values in a flat buffer: where each number of a value stands, and functions that load it from there and store it.

The buffer is divided into tiles of `TILE` environments; in a tile each number of a value has a run of `TILE` places,
one per environment: a cache line.
"""

from __future__ import annotations

import dataclasses
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.values import Array, Number, tuple_like
from turtlebot_gym.heart import step, step_of
from turtlebot_gym.observations.columns import observing
from turtlebot_gym.rewards import default_weights
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
    """Return a NamedTuple with a dataclass's fields, since compiled code does not support dataclasses."""
    name = f"{dataclass_type.__module__}.{dataclass_type.__qualname__}".replace(".", "_")
    return namedtuple(name, _numbers_of(dataclass_type))  # noqa: PYI024


def as_tuple(value: Any) -> Any:
    """Return a parameter dataclass, or a tuple of them, as NamedTuples with the same attributes."""
    if dataclasses.is_dataclass(value):
        return _tuple_type(type(value))(*(as_tuple(getattr(value, name)) for name in _numbers_of(type(value))))
    if isinstance(value, tuple):
        return tuple_like(value, [as_tuple(item) for item in value])
    return value


def numbers_of(value: Any) -> Iterator[Any]:
    """Yield the numbers of a nested tuple in order."""
    if isinstance(value, tuple) and not isinstance(value, Number):
        for item in value:
            yield from numbers_of(item)
    else:
        yield value


def flatten(value: Any) -> Iterator[float]:
    """Yield the numbers of a nested tuple in order, as floats."""
    return map(float, numbers_of(value))


def filled(like: Any, numbers: Iterator[Any]) -> Any:
    """Return a nested tuple with others in place of its numbers, in order."""
    if not isinstance(like, tuple):
        return next(numbers)
    return tuple_like(like, [filled(item, numbers) for item in like])


def _name(value: Any, path: str, names: list[str], slices: dict[str, slice]) -> None:
    """Record the dotted paths of the numbers in a value, and the range of numbers of each tuple by its path."""
    if not isinstance(value, tuple):
        names.append(path)
        return
    start, fields, dot = len(names), getattr(value, "_fields", None), "." if path else ""
    for at, item in enumerate(value):
        _name(item, f"{path}{dot}{fields[at]}" if fields else f"{path}[{at}]", names, slices)
    slices[path] = slice(start, len(names))


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

    @property
    def size(self) -> int:
        """Number of places."""
        return max(self.places, default=-1) + 1


def packing(example: Any, places: Sequence[int] | None = None) -> Packing:
    """Return the layout of a value's type.

    Args:
        example: A (nested) NamedTuple of numbers with the structure and the types (float, bool) of all such values.
        places: The place of each number; None for one after another.
    """
    names: list[str] = []
    slices: dict[str, slice] = {}
    _name(example, "", names, slices)
    floats = (number if isinstance(number, bool) else float(number) for number in numbers_of(example))
    return Packing(filled(example, floats), tuple(names), slices, tuple(range(len(names)) if places is None else places))


class Access(NamedTuple):
    """Kernels that load a value from a buffer, and store it there."""

    load: Callable[[Any, Any], Any]
    """``load(buffer, at)`` returns the value whose first number is at ``buffer[at]``."""
    store: Callable[[Any, Any, Any], None]
    """``store(buffer, at, value)`` writes it."""


def access(pack: Packing, constants: Mapping[int, float] = MappingProxyType({}), distance: int = TILE) -> Access:
    """Return how values are loaded and stored; translated kernels have an instruction for each number.

    Args:
        pack: The layout.
        constants: What always stands at some places: it is neither loaded nor stored.
        distance: From a place to the next one, in numbers.
    """
    example, kinds = pack.example, tuple(map(type, numbers_of(pack.example)))
    places = tuple(place * distance for place in pack.places)
    known = {place * distance: value for place, value in constants.items()}

    def changing(value: Any) -> dict[int, Any]:
        return {place: number for place, number in zip(places, numbers_of(value), strict=True) if place not in known}

    def part_of(code: Any, buffer: Array, at: Any, place: int) -> Array:
        (stride,) = buffer.strides
        return Array(buffer.element, code.moved(code.moved(buffer.address, at, stride), place, stride), (), ())

    def load(buffer, at):
        numbers = (known[place] if place in known else buffer[at + place] for place in places)
        return filled(example, (kind(number) for kind, number in zip(kinds, numbers, strict=True)))

    def store(buffer, at, value):
        for place, number in changing(value).items():
            buffer[at + place] = number

    def emit_load(body, buffer, at):
        def number(place: int, kind: type) -> Any:
            if place in known:
                return kind(known[place])
            value = body.code.load(part_of(body.code, buffer, at, place))
            return body.code.compare("!=", value, 0.0, "f") if kind is bool else value

        return filled(example, map(number, places, kinds))

    def emit_store(body, buffer, at, value):
        for place, number in changing(value).items():
            body.code.store(part_of(body.code, buffer, at, place), number)

    vars(load)["emit"], vars(store)["emit"] = emit_load, emit_store
    return Access(load, store)


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
    example = system.example._replace(reward=default_weights(system.rewards))
    p, waypoints, around = as_tuple(example), (Pose(0.0, 0.0, 0.0),), system.surroundings
    scene = around.at(around.make([example]), 0)
    world = step_of(system).begin(system.lay_out(1, p, scene)[0], 1, waypoints, p, scene)
    world, outcome = step(system, world, STOP, 1, waypoints, p, scene)
    for term in system.terms:
        if not term.in_scene:
            term.example(world, p)
    return Layout(*map(packing, (p, world, outcome, observing(system.terms)(world, p))))
