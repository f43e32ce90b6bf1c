"""Values in a flat buffer: functions, made from a value's structure, that load it from an array and store it there.

The buffer is divided into tiles of `TILE` environments; in a tile each number of a value has a run of `TILE` places,
one per environment. So the compiled loop reads and writes whole vector registers at offsets that the compiler knows,
and needs no proof that two arrays do not overlap.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import namedtuple
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.heart import begin, step
from turtlebot_gym.kernel import Leaf, access, kernel
from turtlebot_gym.observations import observing
from turtlebot_gym.systems import System
from turtlebot_gym.systems.special import Special
from turtlebot_gym.values import STOP, Pose

TILE = 32
"""Environments per tile."""
LINE = 8
"""Numbers in a cache line, and in the widest vector register."""


def aligned(count: int) -> NDArray[np.float64]:
    """Return so many zeros, at the start of a cache line.

    numpy starts large arrays 16 bytes after one; each load and store of a widest vector would then touch two lines.
    """
    room = np.zeros(count + LINE)
    start = -room.ctypes.data // room.itemsize % LINE
    return room[start : start + count]


@cache
def _numbers_of(dataclass_type: type) -> tuple[str, ...]:
    """Return the names of fields that hold numbers; no kernel may read the others."""
    return tuple(item.name for item in dataclasses.fields(dataclass_type) if item.metadata.get("number", True))


@cache
def _tuple_type(dataclass_type: type) -> type:
    """Return a NamedTuple with a dataclass's fields, since compiled code does not support dataclasses.

    It has a name in this module, by which pickled machine code finds it. A copy of it would be another type to numba, which
    would then load the code anew at each call.
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


def _in_floats(value: Any) -> Any:
    """Return a nested tuple with integers converted to floats, as a buffer holds them."""
    if isinstance(value, tuple):
        items = [_in_floats(item) for item in value]
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value if isinstance(value, bool) else float(value)


class Packing(NamedTuple):
    """Layout of a type of value in a buffer."""

    size: int
    """Numbers in a value that have a run in each tile."""
    load: Callable[[Any, int], Any]
    """``load(buffer, at)`` returns the value whose first number is at ``buffer[at]``."""
    store: Callable[[Any, int, Any], None]
    """``store(buffer, at, value)`` writes it."""
    names: tuple[str, ...]
    """The dotted path of each number."""
    slices: dict[str, slice]
    """Range of numbers of each tuple in the value, by its dotted path."""
    places: tuple[int, ...]
    """Place from which each number is read: its own, or that of a number equal to it."""
    shared: tuple[int, ...] = ()
    """Index of each number that stands once, at the start of the buffer, for all environments."""
    stored: int = 0
    """Number of runs that are loaded and stored; those of constants, one for all that are equal, follow them."""

    @property
    def ahead(self) -> int:
        """Places before the first tile, whole cache lines."""
        return -(-len(self.shared) // LINE) * LINE


def _paths(value: Any, path: str = "") -> Iterator[str]:
    """Yield the dotted path of each number in a value."""
    if not isinstance(value, tuple):
        yield path.removeprefix(".")
        return
    fields = getattr(value, "_fields", None)
    for at, item in enumerate(value):
        yield from _paths(item, f"{path}.{fields[at]}" if fields else f"{path}[{at}]")


def _placed(names: list[str], known: Mapping[str, float], same: Mapping[str, str]) -> dict[str, int]:
    """Return the place of each number: what is stored lies close together, and equal constants share a place after it."""
    alone = [name for name in names if name not in same]
    order: dict[Any, int] = {}
    for key in (*(name for name in alone if name not in known), *(known[name] for name in alone if name in known)):
        order.setdefault(key, len(order))
    places = {name: order[known.get(name, name)] for name in alone}
    for name in names:
        if name in same:
            places[name] = places[same[name]]
    return places


def packing(
    example: Any,
    *,
    known: Mapping[str, float] | None = None,
    same: Mapping[str, str] | None = None,
    own: Collection[str] | None = None,
) -> Packing:
    """Generate the load and store functions of a value's type.

    Args:
        example: A (nested) NamedTuple of numbers with the structure and the types (float, bool) of all such values.
        known: Constants by dotted path: they are neither loaded nor stored.
        same: Numbers that equal an earlier one, by dotted path: they are read from that one's place and not stored.
        own: Numbers that each environment has for itself, by dotted path; the others stand once for all and are not stored.
            None for all.
    """
    known, same = known or {}, same or {}
    types: dict[str, type] = {}
    placed = _placed(list(_paths(example)), known, same)
    names: list[str] = []
    places: list[int] = []
    shared: list[int] = []
    free = itertools.count()
    leaves: list[Leaf] = []
    writes: list[str] = []
    slices: dict[str, slice] = {}

    def read(value: Any, path: str) -> str:
        """Return the expression that reads a value, and record how to write it."""
        if not isinstance(value, tuple):
            name = path.partition(".")[2]
            is_own = own is None or name in own
            places.append(placed[name] if own is None else next(free) if is_own else -1)
            names.append(name)
            if name in known:
                leaves.append(bool(known[name]) if isinstance(value, bool) else float(known[name]))
                return repr(leaves[-1])
            if not is_own:
                leaves.append((len(shared),))
                shared.append(len(names) - 1)
                return f"(buffer[{len(shared) - 1}] != 0.0)" if isinstance(value, bool) else f"buffer[{len(shared) - 1}]"
            offset = places[-1] * TILE
            leaves.append(~offset if name in same else offset)  # inverted, even 0 says that it is read there, but not stored
            place = f"buffer[at + {offset}]"
            if name not in same:
                writes.append(f"    {place} = {path}")
            return f"({place} != 0.0)" if isinstance(value, bool) else place
        start = len(names)
        fields = getattr(value, "_fields", None)
        if fields is None:
            expression = "(" + "".join(f"{read(item, f'{path}[{at}]')}, " for at, item in enumerate(value)) + ")"
        else:
            kind = f"T{len(types)}"
            types[kind] = type(value)
            expression = f"{kind}({', '.join(read(getattr(value, name), f'{path}.{name}') for name in fields)})"
        slices[path.partition(".")[2]] = slice(start, len(names))
        return expression

    source = "\n".join(
        [
            "def load(buffer, at):",
            f"    return {read(example, 'value')}",
            "def store(buffer, at, value):",
            *writes,
            "    return",
        ]
    )
    scope: dict[str, Any] = {**types, "inf": math.inf}
    exec(source, scope)  # made of field names only
    load, store = access(scope["load"], scope["store"], _in_floats(example), leaves)
    size = max(places) + 1 if own is None else next(free)
    return Packing(size, load, store, tuple(names), slices, tuple(places), tuple(shared), len(writes))


class Layout(NamedTuple):
    """Layout of a system's values in a tile, and in a thread's scratch: observation, outcome and action in sequence."""

    parameters: Packing
    """In a buffer of their own: what is shared, and then the tiles of what each environment has for itself."""
    world: Packing
    """The tile: the only state that is kept between steps."""
    outcome: Packing
    observation: Packing
    at_outcome: int
    """Offset of the outcome in the scratch."""
    at_action: int
    scratch: int
    """Numbers in the scratch."""


@cache
def layout_of(system: System, special: Special) -> Layout:
    """Return the layout of a system's values in a tile, from an example of each."""
    p, waypoints, around = as_tuple(system.example), (Pose(0.0, 0.0, 0.0),), system.surroundings
    scene = around.at(around.make([system.example]), 0) if around else ()
    world = begin(system, system.lay_out(1, p, scene)[0], 1, waypoints, p, scene)
    world, outcome = step(system, world, STOP, 1, waypoints, p, scene)
    parameters = packing(p, known=dict(special.parameters), own=special.own)
    a_world = packing(world, known=dict(special.world), same=dict(special.same))
    for term in system.terms:
        if not term.in_scene:
            term.example(world, p)
    an_outcome, observation = packing(outcome), packing(observing(system.terms)(world, p))
    at_outcome = observation.size * TILE
    at_action = at_outcome + an_outcome.size * TILE
    return Layout(parameters, a_world, an_outcome, observation, at_outcome, at_action, at_action + 2 * TILE)


def access_of(system: System, special: Special) -> tuple[Callable[..., Any], ...]:
    """Return the kernels that load parameters, load and store a world and an outcome, and write an observation to a scratch."""
    layout, observe = layout_of(system, special), observing(system.terms)
    store_observation = layout.observation.store

    @kernel
    def show(scratch, lane, world, p):
        store_observation(scratch, lane, observe(world, p))

    return layout.parameters.load, layout.world.load, layout.world.store, layout.outcome.load, layout.outcome.store, show
