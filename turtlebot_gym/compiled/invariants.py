"""Which numbers of a world never change, and which always equal another one: derived from the graphs of start and step.

All numbers with the same first value are assumed to stay equal, and to stay what they are if that is a constant. A step under
this assumption shows which of them do not; without those the assumption is tried again, until it proves itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from turtlebot_gym.compiled.graph import Graph, Node, key_of, kind_of, load, rebuilt

Classes = dict[str, Any]
"""For each number of a world a constant, or the name of the number that it equals, which may be itself."""


def assumed(classes: Mapping[str, Any], kinds: Mapping[str, str]) -> dict[str, Any]:
    """Return what stands for each number of a world: a constant, or the load of the number that it equals."""
    return {name: load(what, kinds[name]) if isinstance(what, str) else what for name, what in classes.items()}


def _divided(keys: Mapping[str, Any], constants: Mapping[str, Any]) -> Classes:
    """Return the classes of numbers with equal keys; those of ``constants`` are constants."""
    first: dict[Any, str] = {}
    return {name: constants[name] if name in constants else first.setdefault(key, name) for name, key in keys.items()}


def invariants(
    first: Mapping[str, Any], stepped: Mapping[str, Any], kinds: Mapping[str, str], before: Classes | None = None
) -> Classes:
    """Return the classes of the numbers of a world.

    Args:
        first: The value of each number at the start of an episode.
        stepped: Its value after a step, in terms of loads of the numbers.
        kinds: Its kind.
        before: Classes that hold at present, if episodes go on; None if all begin.
    """
    keys = {name: (kinds[name], key_of(value)) for name, value in first.items()}
    constants = {name: value for name, value in first.items() if not isinstance(value, Node)}
    if before is not None:
        keys = {
            name: (key, str(before[name]) if isinstance(before[name], str) else key_of(before[name]))
            for name, key in keys.items()
        }
        constants = {name: value for name, value in constants.items() if key_of(before[name]) == key_of(value)}
    classes = _divided(keys, constants)
    while True:
        Graph.now = Graph()
        values = rebuilt(stepped, assumed(classes, kinds))
        constants = {
            name: value
            for name, value in constants.items()
            if not isinstance(values[name], Node) and key_of(values[name]) == key_of(value) and kind_of(value) == kinds[name]
        }
        keys = {
            name: (
                name in constants,
                classes[name] if isinstance(classes[name], str) else key_of(classes[name]),
                key_of(values[name]),
            )
            for name in classes
        }
        refined = _divided(keys, constants)
        if refined == classes:
            return classes
        classes = refined
