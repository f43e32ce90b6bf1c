"""Which numbers of a world never change, and which always equal another one: LLVM proves it.

All numbers with the same first value are assumed to stay equal, and to stay what they are if that is a constant. A step under
this assumption, as LLVM simplifies it, shows which of them do not; without those the assumption is tried again, until it holds.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.code import Code
from turtlebot_gym.compiled.files import fingerprint, kept
from turtlebot_gym.compiled.packing import Packing, layout_of, mapped, packing
from turtlebot_gym.compiled.translate import Translator
from turtlebot_gym.compiled.values import LLVM, Number, constant, kind_of
from turtlebot_gym.heart import step_of
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.systems import System
from turtlebot_gym.values import Pose

Classes = dict[str, Any]
"""For each number a constant, or the name of the first number that it equals, which may be itself."""


class Case(NamedTuple):
    """What the loops of open ground are made for, beside the system."""

    fixed: tuple[tuple[str, float], ...]
    """Parameters that all environments share and that are part of the code, by dotted path."""
    waypoints: int
    """Number of waypoints."""
    whole: bool = False
    """Whether all numbers of a world are kept, since its episode began with other parameters."""


def function_of(function: Callable[..., Any], *arguments: Any) -> tuple[str, dict[str, str]]:
    """Return a kernel as a simplified function of some numbers, as text, and the kinds of these numbers by name.

    Args:
        function: The kernel.
        arguments: Nested tuples of numbers, and of the names of others, each with its kind before it.
    """
    translator, inputs = Translator(), dict[str, str]()
    code = Code(translator.module)

    def argument(path: str, value: Any) -> Number:
        if isinstance(value, str):
            inputs[value] = value[0]
            return Number(value[0], f"%{value}")
        return Number(kind_of(value), constant(value, kind_of(value)))

    result = translator.call(code, function, [mapped(value, argument) for value in arguments])
    for at, leaf in enumerate(_leaves(result)):
        place = code.put(f"getelementptr double, ptr %out, i64 {at}")
        code.do(f"store volatile double {code.as_kind(leaf, 'f')}, ptr {place}")
    given = ", ".join(f"{LLVM[kind]} %{name}" for name, kind in inputs.items())
    body = "\n".join(["entry:", *code.entry, *code.lines, "  ret void"])
    translator.module.functions.append(f"define void @whole(ptr %out, {given}) alwaysinline {{\n{body}\n}}")
    return native.simplified(translator.module.text()), inputs


def returned(function: tuple[str, dict[str, str]], known: Mapping[str, Any] = MappingProxyType({})) -> list[Any]:
    """Return the numbers that a function returns as LLVM knows them: floats, or names, equal ones for equal numbers.

    Args:
        function: See `function_of`.
        known: Constants, and names of others that are equal, in place of some of its numbers.
    """
    text, inputs = function
    values = [known.get(name, name) for name in inputs]
    names = [f"%{value}" if isinstance(value, str) else constant(value, kind_of(value)) for value in values]
    given = ", ".join(f"{LLVM[kind]} {name}" for kind, name in zip(inputs.values(), names, strict=True))
    taken = ", ".join(f"{LLVM[kind]} %{name}" for name, kind in inputs.items())
    probe = f"define void @probe(ptr %out, {taken}) {{\n  call void @whole(ptr %out, {given})\n  ret void\n}}"
    _, _, body = native.simplified(f"{text}\n{probe}").partition("@probe(")
    found = re.findall(r"store volatile double (\S+), ptr", body)
    return [name if name.startswith("%") else _number(name) for name in found]


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple) and not isinstance(value, Number):
        for item in value:
            yield from _leaves(item)
    else:
        yield value


def _number(text: str) -> float:
    return struct.unpack(">d", bytes.fromhex(text[2:]))[0] if text.startswith("0x") else float(text)


def _divided(keys: Mapping[str, Any], values: Mapping[str, Any]) -> Classes:
    """Return the classes of numbers with equal keys; those whose value is a float are constants."""
    first: dict[Any, str] = {}
    return {
        name: value if isinstance(value := values[name], float) else first.setdefault(key, name) for name, key in keys.items()
    }


def _classes(system: System, case: Case) -> Classes:
    layout, fixed = layout_of(system), dict(case.fixed)
    begin, _, act, conclude, retarget = step_of(system)
    count, names = case.waypoints, layout.world.names

    def whole(world, command, key, waypoints, p):
        after, outcome = conclude(world, act(world, command_of(command[0], command[1], p.robot), key, p), key, count, p, ())
        if outcome.reached:
            after, outcome = retarget(after, outcome, key, waypoints, p, ())
        return after

    def start(pose, key, waypoints, p):
        return begin(pose, key, waypoints, p, ())

    def number(path: str, like: Any) -> Any:
        return type(like)(fixed[path]) if path in fixed else f"{'b' if isinstance(like, bool) else 'f'}p{path}"

    p = mapped(layout.parameters.example, number)
    p = mapped(p, lambda path, value: re.sub(r"\W", "_", value) if isinstance(value, str) else value)
    pose: Any = Pose
    goals = tuple(pose(*(f"fgoal{at}{axis}" for axis in "xyt")) for at in range(count))
    kinds = dict(zip(names, ("b" if x else "f" for x in _truths(layout.world.example)), strict=True))
    inputs = [f"{kinds[name]}w{at}" for at, name in enumerate(names)]
    rest = iter(inputs)
    world = mapped(layout.world.example, lambda path, like: next(rest))
    first = dict(zip(names, returned(function_of(start, pose("fx", "fy", "ft"), "ikey", goals, p)), strict=True))
    step = function_of(whole, world, ("fforward", "fturn"), "ikey", goals, p)
    classes = _divided(first, first)
    while True:
        known = {
            own: inputs[names.index(what)] if isinstance(what, str) else bool(what) if own[0] == "b" else what
            for own, what in zip(inputs, classes.values(), strict=True)
        }
        after = dict(zip(names, returned(step, known), strict=True))
        kept = {
            name: what if isinstance(what, float) and after[name] == what and _same_sign(after[name], what) else ""
            for name, what in classes.items()
        }
        refined = _divided({name: (str(classes[name]), str(after[name])) for name in names}, kept)
        if refined == classes:
            return classes
        classes = refined


def _same_sign(a: float, b: float) -> bool:
    return struct.pack("d", a) == struct.pack("d", b)


def _truths(example: Any) -> list[bool]:
    found: list[bool] = []
    mapped(example, lambda path, value: found.append(isinstance(value, bool)))
    return found


@cache
def reduced(system: System, case: Case) -> tuple[Packing, Mapping[int, float]]:
    """Return the layout of a world in which equal numbers share a place, and what stands at the places of constants."""
    world = layout_of(system).world
    if case.whole:
        return world, {}
    identity = f"{fingerprint(command_of, *step_of(system))} {case} {world.names}"
    classes: Classes = kept("numbers of open ground", identity, lambda: _classes(system, case))
    own = {name: at for at, name in enumerate(name for name, what in classes.items() if what == name)}
    constants: dict[float, int] = {}
    places = [
        own[what] if isinstance(what, str) else constants.setdefault(what, len(own) + len(constants))
        for what in classes.values()
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
