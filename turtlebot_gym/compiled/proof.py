"""Which numbers of a world never change, and which always equal another one: LLVM proves it.

All numbers with the same first value are assumed to stay equal, and to stay what they are if that is a constant. A step under
this assumption, as LLVM simplifies it, shows which of them do not; without those the assumption is tried again, until it holds.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.files import kept
from turtlebot_gym.compiled.packing import Packing, layout_of, packing
from turtlebot_gym.compiled.program import text_of
from turtlebot_gym.compiled.values import Number, filled, form_of, kind_of, numbers_of
from turtlebot_gym.heart import step_of
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.systems import System
from turtlebot_gym.values import Pose


class Case(NamedTuple):
    """What the loops of open ground are made for, beside the system."""

    known: tuple[float | None, ...]
    """The value of each parameter that all environments share and that is part of the code; None for others."""
    waypoints: int
    """Number of waypoints."""
    whole: bool = False
    """Whether all numbers of a world are kept, since its episode began with other parameters."""


def _returned(function: Callable[..., Any], forms: tuple[Any, ...]) -> list[Any]:
    """Return the numbers that a kernel returns as LLVM knows them: floats, or names, equal ones for equal numbers.

    Args:
        function: The kernel.
        forms: Its arguments: nested tuples of constants and of numbers, equal ones with the same name.
    """
    text, result = text_of(function, forms)
    functions, define, entry = text.rpartition("define void @entry")
    volatile = entry.replace("store double", "store volatile double")
    simple = str(native.optimized(f"{functions}{define}{volatile}", 1, native.machine_here()))
    names = iter(re.findall(r"store volatile double (\S+),", simple))
    return [_number(next(names)) if isinstance(number, Number) else number for number in numbers_of(result)]


def _number(text: str) -> float | str:
    if text.startswith("0x"):
        return struct.unpack(">d", bytes.fromhex(text[2:]))[0]
    return text if text.startswith("%") else float(text)


def _divided(keys: Sequence[Any], values: Sequence[Any]) -> list[float | int]:
    """Return for each number its value if that is a float, otherwise the first one with an equal key."""
    first: dict[Any, int] = {}
    pairs = enumerate(zip(keys, values, strict=True))
    return [value if isinstance(value, float) else first.setdefault(key, at) for at, (key, value) in pairs]


def _classes(begin: Callable[..., Any], step: Callable[..., Any], world: Any, others: tuple[Any, ...]) -> list[float | int]:
    """Return for each number of a world a constant, or the index of the first number that it equals, which may be itself.

    Args:
        begin: ``begin(*others)`` returns the numbers of the first world.
        step: ``step(world, *others)`` returns those after a step.
        world: The forms of a world's numbers.
        others: Those of the other arguments.
    """
    numbers, first = numbers_of(world), _returned(begin, others)
    classes = _divided(first, first)
    while True:
        pairs = zip(numbers, classes, strict=True)
        known = [
            numbers[other] if isinstance(other, int) else bool(other) if number.kind == "b" else other
            for number, other in pairs
        ]
        after = _returned(step, (filled(world, known), *others))
        stays = [old if repr(old) == repr(new) else "" for old, new in zip(classes, after, strict=True)]
        refined = _divided([*zip(map(repr, classes), map(repr, after), strict=True)], stays)
        if refined == classes:
            return classes
        classes = refined


@cache
def reduced(system: System, case: Case) -> Packing:
    """Return the layout of a world in which equal numbers share a place, and constants are known."""
    layout, count = layout_of(system), case.waypoints
    if case.whole:
        return layout.world
    begin, _, act, conclude, retarget = step_of(system)

    @kernel
    def first_world(pose, command, key, waypoints, p):
        return [float(number) for number in numbers_of(begin(pose, key, waypoints, p, ()))]

    @kernel
    def next_world(world, pose, command, key, waypoints, p):
        after, outcome = conclude(world, act(world, command_of(command[0], command[1], p.robot), key, p), key, count, p, ())
        if outcome.reached:
            after, outcome = retarget(after, outcome, key, waypoints, p, ())
        return [float(number) for number in numbers_of(after)]

    def named(value: Any, name: str) -> list[Number]:
        return [Number(kind_of(number), f"{name}{at}") for at, number in enumerate(numbers_of(value))]

    example = layout.parameters.example
    given = zip(named(example, "p"), numbers_of(example), case.known, strict=True)
    p = filled(example, [number if value is None else type(old)(value) for number, old, value in given])
    world, pose = filled(layout.world.example, named(layout.world.example, "w")), form_of(Pose(0.0, 0.0, 0.0))
    others = pose, (Number("f"), Number("f")), Number("i"), (pose,) * count, p
    made_of = f"{text_of(first_world, others)[0]} {text_of(next_world, (world, *others))[0]}"
    found = kept(
        "numbers of open ground", made_of, lambda: json.dumps(_classes(first_world, next_world, world, others)).encode()
    )
    classes = json.loads(found)
    own = [at for at, other in enumerate(classes) if other == at and isinstance(other, int)]
    constants = [*{repr(other): other for other in classes if isinstance(other, float)}]
    places = [own.index(other) if isinstance(other, int) else len(own) + constants.index(repr(other)) for other in classes]
    return packing(layout.world.example, places, [other if isinstance(other, float) else None for other in classes])
