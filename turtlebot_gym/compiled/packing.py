"""Values in a flat buffer: where each number of a value stands, and functions that load it from there and store it.

The buffer is divided into tiles of `TILE` environments; in a tile each number of a value has a run of `TILE` places,
one per environment: a cache line.
"""

from __future__ import annotations

import dataclasses
from collections import namedtuple
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.values import filled, numbers_of, tuple_like
from turtlebot_gym.heart import step, step_of
from turtlebot_gym.kernel import kernel
from turtlebot_gym.observations.columns import observing
from turtlebot_gym.rewards import default_weights
from turtlebot_gym.systems import System
from turtlebot_gym.values import STOP, Pose

TILE = 8
"""Environments per tile: numbers in a cache line, and in the widest vector register."""


def aligned(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy of an array that begins at the start of a cache line.

    numpy starts large arrays 16 bytes after one; each load and store of a widest vector would then touch two lines.
    """
    room = np.empty(numbers.size + TILE)
    copy = room[-room.ctypes.data // room.itemsize % TILE :][: numbers.size].reshape(numbers.shape)
    copy[:] = numbers
    return copy


@cache
def _tuple_type(dataclass_type: type) -> Any:
    """Return a NamedTuple with the fields of a dataclass that hold numbers: compiled code does not know dataclasses."""
    names = [item.name for item in dataclasses.fields(dataclass_type) if item.metadata.get("number", True)]
    return namedtuple(dataclass_type.__name__, names)  # noqa: PYI024


def as_tuple(value: Any) -> Any:
    """Return a parameter dataclass, or a tuple of them, as NamedTuples with the same attributes."""
    if dataclasses.is_dataclass(value):
        kind = _tuple_type(type(value))
        return kind(*(as_tuple(getattr(value, name)) for name in kind._fields))
    if isinstance(value, tuple):
        return tuple_like(value, [as_tuple(item) for item in value])
    return value


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
    known: tuple[float | None, ...]
    """The value of each number that never changes, which is neither loaded nor stored; None for others."""

    @property
    def size(self) -> int:
        """Number of places."""
        return max(self.places, default=-1) + 1


def packing(example: Any, places: Sequence[int] | None = None, known: Sequence[float | None] | None = None) -> Packing:
    """Return the layout of a value's type.

    Args:
        example: A (nested) NamedTuple of numbers with the structure and the types (float, bool) of all such values.
        places: The place of each number; None for one after another.
        known: See `Packing`; None if all change.
    """
    names: list[str] = []
    slices: dict[str, slice] = {}
    _name(example, "", names, slices)
    floats = [number if isinstance(number, bool) else float(number) for number in numbers_of(example)]
    count, example = len(names), filled(example, floats)
    return Packing(example, tuple(names), slices, tuple(places or range(count)), tuple(known or [None] * count))


Access = tuple[Callable[[Any, Any], Any], Callable[[Any, Any, Any], None]]


def access(pack: Packing, distance: int = TILE) -> Access:
    """Return kernels that load and store values, with a distance from a place to the next one, in numbers.

    ``load(buffer, at)`` returns the value whose first number is at ``buffer[at]``; ``store(buffer, at, value)`` writes it.
    """
    example, places = pack.example, [place * distance for place in pack.places]
    columns = tuple(zip(places, map(type, numbers_of(example)), pack.known, strict=True))
    written = tuple({place: at for at, (place, _, known) in enumerate(columns) if known is None}.items())

    @kernel
    def load(buffer, at):
        return filled(example, [kind(buffer[at + place]) if known is None else kind(known) for place, kind, known in columns])

    @kernel
    def store(buffer, at, value):
        numbers = numbers_of(value)
        for place, number in written:
            buffer[at + place] = numbers[number]

    return load, store


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
