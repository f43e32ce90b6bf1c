"""Which numbers of a world never change, and which always equal another one: LLVM proves it.

All numbers with the same first value are assumed to stay equal, and to stay what they are if that is a constant. A step under
this assumption, as LLVM simplifies it, shows which of them do not; without those the assumption is tried again, until it holds.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.code import Code
from turtlebot_gym.compiled.files import fingerprint, kept
from turtlebot_gym.compiled.packing import Packing, filled, layout_of, numbers_of, packing
from turtlebot_gym.compiled.translate import Translator
from turtlebot_gym.compiled.values import LLVM, Number, constant, kind_of
from turtlebot_gym.heart import step_of
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.systems import System
from turtlebot_gym.values import Pose


class Case(NamedTuple):
    """What the loops of open ground are made for, beside the system."""

    fixed: tuple[tuple[str, float], ...]
    """Parameters that all environments share and that are part of the code, by dotted path."""
    waypoints: int
    """Number of waypoints."""
    whole: bool = False
    """Whether all numbers of a world are kept, since its episode began with other parameters."""


def _function_of(function: Callable[..., Any], *arguments: Any) -> tuple[str, dict[str, str]]:
    """Return a kernel as a simplified function of some numbers, as text, and the kinds of these numbers by name.

    Args:
        function: The kernel.
        arguments: Nested tuples of numbers, and of the names of others, each with its kind before it.
    """
    translator, inputs = Translator(), dict[str, str]()
    code = Code(translator.module)

    def argument(value: Any) -> Number:
        if isinstance(value, str):
            inputs[value] = value[0]
            return Number(value[0], f"%{value}")
        return Number(kind_of(value), constant(value, kind_of(value)))

    result = translator.call(code, function, [filled(value, map(argument, numbers_of(value))) for value in arguments])
    for at, leaf in enumerate(numbers_of(result)):
        place = code.put(f"getelementptr double, ptr %out, i64 {at}")
        code.do(f"store volatile double {code.as_kind(leaf, 'f')}, ptr {place}")
    given = ", ".join(f"{LLVM[kind]} %{name}" for name, kind in inputs.items())
    body = "\n".join(["entry:", *code.entry, *code.lines, "  ret void"])
    translator.module.functions.append(f"define void @whole(ptr %out, {given}) alwaysinline {{\n{body}\n}}")
    return native.simplified(translator.module.text()), inputs


def _returned(function: tuple[str, dict[str, str]], known: Mapping[str, Any] = MappingProxyType({})) -> list[Any]:
    """Return the numbers that a function returns as LLVM knows them: floats, or names, equal ones for equal numbers.

    Args:
        function: See `_function_of`.
        known: Constants, and names of others that are equal, in place of some of its numbers.
    """
    text, inputs = function
    values = [known.get(name, name) for name in inputs]
    names = [f"%{value}" if isinstance(value, str) else constant(value, kind_of(value)) for value in values]
    given = ", ".join(f"{LLVM[kind]} {name}" for kind, name in zip(inputs.values(), names, strict=True))
    taken = ", ".join(f"{LLVM[kind]} %{name}" for name, kind in inputs.items())
    probe = f"define void @probe(ptr %out, {taken}) {{\n  call void @whole(ptr %out, {given})\n  ret void\n}}"
    _, _, body = native.simplified(f"{text}\n{probe}").partition("@probe(")
    return [_number(name) for name in re.findall(r"store volatile double (\S+), ptr", body)]


def _number(text: str) -> float | str:
    if text.startswith("0x"):
        return struct.unpack(">d", bytes.fromhex(text[2:]))[0]
    return text if text.startswith("%") else float(text)


def _divided(keys: Sequence[Any], values: Sequence[Any]) -> list[float | int]:
    """Return for each number its value if that is a float, otherwise the first one with an equal key."""
    first: dict[Any, int] = {}
    pairs = enumerate(zip(keys, values, strict=True))
    return [value if isinstance(value, float) else first.setdefault(key, at) for at, (key, value) in pairs]


def _classes(system: System, case: Case) -> list[float | int]:
    """Return for each number of a world a constant, or the index of the first number that it equals, which may be itself."""
    layout, fixed = layout_of(system), dict(case.fixed)
    pose: Any = Pose
    begin, _, act, conclude, retarget = step_of(system)
    count = case.waypoints

    def whole(world, command, key, waypoints, p):
        after, outcome = conclude(world, act(world, command_of(command[0], command[1], p.robot), key, p), key, count, p, ())
        if outcome.reached:
            after, outcome = retarget(after, outcome, key, waypoints, p, ())
        return after

    def start(pose, key, waypoints, p):
        return begin(pose, key, waypoints, p, ())

    parameters, world = layout.parameters.example, layout.world.example
    like = enumerate(zip(layout.parameters.names, numbers_of(parameters), strict=True))
    given = (type(old)(fixed[path]) if path in fixed else f"{_kind(old)}p{at}" for at, (path, old) in like)
    p, goals = filled(parameters, given), tuple(pose(*(f"fgoal{at}{axis}" for axis in "xyt")) for at in range(count))
    inputs = [f"{_kind(old)}w{at}" for at, old in enumerate(numbers_of(world))]
    first = _returned(_function_of(start, pose("fx", "fy", "ft"), "ikey", goals, p))
    step = _function_of(whole, filled(world, iter(inputs)), ("fforward", "fturn"), "ikey", goals, p)
    classes = _divided(first, first)
    while True:
        known = {
            name: inputs[what] if isinstance(what, int) else bool(what) if name[0] == "b" else what
            for name, what in zip(inputs, classes, strict=True)
        }
        after = _returned(step, known)
        kept = [what if repr(what) == repr(now) else "" for what, now in zip(classes, after, strict=True)]
        refined = _divided([*zip(map(repr, classes), map(repr, after), strict=True)], kept)
        if refined == classes:
            return classes
        classes = refined


def _kind(value: Any) -> str:
    return "b" if isinstance(value, bool) else "f"


@cache
def reduced(system: System, case: Case) -> tuple[Packing, Mapping[int, float]]:
    """Return the layout of a world in which equal numbers share a place, and what stands at the places of constants."""
    world = layout_of(system).world
    if case.whole:
        return world, {}
    identity = f"{fingerprint(command_of, *step_of(system))} {case} {world.names}"
    classes = kept("numbers of open ground", identity, lambda: _classes(system, case))
    own = [at for at, what in enumerate(classes) if what == at and isinstance(what, int)]
    constants: dict[float, int] = {}
    places = [
        own.index(what) if isinstance(what, int) else constants.setdefault(what, len(own) + len(constants)) for what in classes
    ]
    return packing(world.example, places), {place: value for value, place in constants.items()}


def case_of(system: System, numbers: Any, waypoints: int, *, small: bool, old: Case | None) -> Case:
    """Return the case of parameters, shape (1, K) or (N, K): what differs between environments is loaded.

    Args:
        system: The system.
        numbers: The parameters of all environments, or of one that stands for all, in the order of the layout.
        waypoints: Number of waypoints.
        small: Whether numbers that are not whole are loaded, too: code of their own would never pay for itself.
        old: The case of episodes that go on, if any do.
    """
    names, same, known = layout_of(system).parameters.names, (numbers == numbers[0]).all(axis=0), dict(old.fixed) if old else {}
    fixed = tuple(
        (name, value)
        for name, value, is_same in zip(names, numbers[0].tolist(), same, strict=True)
        if is_same and (value.is_integer() or not small) and (old is None or known.get(name) == value)
    )
    return old if old and fixed == old.fixed else Case(fixed, waypoints, whole=old is not None)


def own_of(system: System, case: Case) -> Sequence[str]:
    """Return the parameters that each environment has for itself."""
    fixed = dict(case.fixed)
    return [name for name in layout_of(system).parameters.names if name not in fixed]
