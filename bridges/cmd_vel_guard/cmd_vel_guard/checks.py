"""Rules for parameters: a value that breaks one is refused as "NAME must be RULE, got VALUE." Does not depend on ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, get_type_hints


@dataclass(frozen=True)
class Range:
    """Numbers between two ends, both included unless open; no booleans and no NaN."""

    low: float
    high: float
    open_low: bool = False
    unit: str = ""

    def check(self, name: str, value: Any) -> float:
        """Return a number as a float, or raise `ValueError`."""
        number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan
        inside = self.low < number <= self.high if self.open_low else self.low <= number <= self.high
        if not inside:
            raise ValueError(f"{name} must be {self}, got {value!r}.")
        return number

    def __str__(self) -> str:
        text = f"above {self.low:g} and at most {self.high:g}" if self.open_low else f"from {self.low:g} to {self.high:g}"
        return f"a number {text}" + (f" {self.unit}" if self.unit else "")


@dataclass(frozen=True)
class Names:
    """Some words."""

    names: tuple[str, ...]

    def check(self, name: str, value: Any) -> str:
        """Return one of the words, or raise `ValueError`."""
        if value not in self.names:
            raise ValueError(f"{name} must be {self}, got {value!r}.")
        return value

    def __str__(self) -> str:
        return f"one of {', '.join(self.names)}"


def rules(kind: type) -> dict[str, Any]:
    """Return the rules that are declared beside the fields of a class of parameters, ``Annotated[float, Range(...)]``.

    Anything with a ``check`` is a rule, so that a node may have a class with rules of its own.
    """
    hints = get_type_hints(kind, include_extras=True)
    declared = {item.name: getattr(hints[item.name], "__metadata__", ()) for item in fields(kind)}
    return {name: beside[0] for name, beside in declared.items() if beside and hasattr(beside[0], "check")}


def check(owner: Any) -> None:
    """Check the fields of a frozen dataclass, in its ``__post_init__``, and make numbers floats.

    A field of another type, or that breaks its rule, raises `ValueError` with its name.
    """
    hints, declared = get_type_hints(type(owner)), rules(type(owner))
    for item in fields(owner):
        value = getattr(owner, item.name)
        if item.name in declared:
            object.__setattr__(owner, item.name, declared[item.name].check(item.name, value))
        elif hints[item.name] is bool and not isinstance(value, bool):
            raise ValueError(f"{item.name} must be True or False, got {value!r}.")
