"""Parameters: frozen dataclasses that check themselves, and what a user may give in their place.

A field states its rule beside its type, ``radius: Annotated[float, POSITIVE] = 0.1``, and `check_fields` refuses what breaks it
in one line: "Robot.radius must be a positive number from 1e-15 to 1e+09, got -1.0." `given` makes parameters of a name, a file,
a mapping of fields, or a mapping that changes some fields of these: ``{"base": "rough", "process": {"slip": 0.3}}``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, MISSING, dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_type_hints

from turtlebot_gym.files import is_file, load

LARGEST, LEAST = 1e9, 1e-15
"""Magnitudes between which a parameter's numbers lie, besides 0 and infinity: products and ratios of a few are finite."""
BASE = "base"
"""Key of a mapping whose other keys change some fields of what this one names."""

T = TypeVar("T")


def refusal(name: str, rule: object, value: Any) -> ValueError:
    """Return the error for a value that breaks its rule."""
    return ValueError(f"{name} must be {rule}, got {short_repr(value)}.")


def short_repr(value: Any) -> str:
    """Return a value as messages show it: on one line and shortened."""
    try:
        return " ".join(f"{value!r:.200}".split())
    except Exception:  # an object of somebody else's, or a whole number of thousands of digits
        return f"a {type(value).__name__}"


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers between two ends, both included unless open; no booleans and no NaN."""

    low: float = -LARGEST
    high: float = LARGEST
    _: KW_ONLY
    open_low: bool = False
    open_high: bool = False
    whole: bool = False
    infinite: bool = False
    """Whether infinity is allowed besides."""
    kind: str = "number"
    unit: str = ""

    def check(self, name: str, value: Any) -> Any:
        """Return a number of Python or NumPy as a float, or as an int if it must be whole."""
        number = _item(value)
        if isinstance(number, bool) or not isinstance(number, int if self.whole else (int, float)) or number not in self:
            raise refusal(name, self, value)
        return number if self.whole else float(number)

    def of(self, unit: str) -> Range:
        """Return the same numbers with a unit."""
        return replace(self, unit=unit)

    def __contains__(self, number: float) -> bool:
        above = number > self.low if self.open_low else number >= self.low
        below = number < self.high if self.open_high else number <= self.high
        return (above and below) or (self.infinite and number == math.inf)

    def __str__(self) -> str:
        """Return the rule in words, such as "a number above 0 and at most 0.5 s"."""
        low, high = (f"{end}" if isinstance(end, int) else f"{end:g}" for end in (self.low, self.high))
        text = f"above {low}" if self.open_low else f"of at least {low}"
        if self.high < math.inf and not (self.open_low or self.open_high):
            text = f"from {low} to {high}"
        elif self.high < math.inf:
            text += f" and {'below' if self.open_high else 'at most'} {high}"
        return f"a {'whole ' * self.whole}{self.kind} {text}{' ' * bool(self.unit)}{self.unit}{', or infinite' * self.infinite}"


POSITIVE = Range(LEAST, kind="positive number")
POSITIVE_OR_INFINITE = Range(LEAST, kind="positive number", infinite=True)
NON_NEGATIVE = Range(0.0)
FINITE = Range()
PROBABILITY = Range(0.0, 1.0, kind="probability")
ONE_OR_MORE = Range(1, 10**9, whole=True)


@dataclass(frozen=True, slots=True)
class Numbers:
    """A sequence of numbers, any and of any length if None."""

    each: Range | None = None
    size: int | None = None

    def check(self, name: str, value: Any) -> tuple[float, ...]:
        """Return a list, a tuple or an array as a tuple of floats."""
        rows = value.tolist() if hasattr(value, "tolist") else value
        if not isinstance(rows, (list, tuple)) or self.size not in (None, len(rows)):
            raise refusal(name, self, value)
        check = self.each.check if self.each else as_number
        return tuple(check(f"{name}[{at}]", item) for at, item in enumerate(rows))

    def __str__(self) -> str:
        return "a sequence of numbers" if self.size is None else f"{self.size} numbers"


@dataclass(frozen=True, slots=True)
class Names:
    """Some names."""

    names: tuple[str, ...]

    def check(self, name: str, value: Any) -> str:
        return choose(name, value, dict(zip(self.names, self.names, strict=True)))

    def __str__(self) -> str:
        return f"one of {', '.join(map(repr, self.names))}"


def _item(value: Any) -> Any:
    """Return a NumPy scalar, or an array without dimensions, as Python's own; others as they are."""
    return value.item() if hasattr(value, "item") and getattr(value, "shape", None) == () else value


def as_number(name: str, value: Any) -> float:
    """Return a number, even an infinite one or NaN, as a float, or raise the `refusal` of anything else."""
    number = _item(value)
    if isinstance(number, bool) or not isinstance(number, (int, float)):
        raise refusal(name, "a number", value)
    return float(number)


def as_int(name: str, value: Any, least: int = 0, most: float = math.inf) -> int:
    """Return a whole number in a range as an int, or raise the `refusal` of anything else."""
    return Range(least, most, whole=True).check(name, value)


def _as_bool(name: str, value: Any) -> bool:
    truth = _item(value)
    if not isinstance(truth, bool):
        raise refusal(name, "True or False", value)
    return truth


def choose(what: str, name: Any, known: Mapping[Any, T]) -> T:
    """Return a named choice; a ``ValueError`` for an unknown name lists the known ones, and asks if a similar one was meant."""
    try:
        return known[name]
    except (KeyError, TypeError):  # TypeError: it has no hash, such as a list
        error = refusal(what, f"one of {', '.join(map(repr, known))}", name)
        raise ValueError(f"{error}{did_you_mean(name, known)}") from None


def did_you_mean(name: Any, known: Iterable[Any]) -> str:
    """Return " Did you mean ...?" for a similar name, or nothing."""
    known_as = {text.lower(): text for text in known if isinstance(text, str)}
    wanted = name.lower() if isinstance(name, str) else ""
    similar = get_close_matches(wanted, known_as, 1) or [text for text in known_as if len(wanted) > 2 and wanted in text]
    return f" Did you mean {known_as[similar[0]]!r}?" if similar else ""


def check_fields(owner: Any, prefix: str | None = None) -> None:
    """Check the fields of a parameter class, and give each its declared type; ``prefix`` precedes their names in messages."""
    kind = type(owner)
    for name, check in _checks(kind):
        path = f"{kind.__name__ + '.' if prefix is None else prefix}{name}"
        object.__setattr__(owner, name, check(path, getattr(owner, name)))


@cache
def _checks(kind: type) -> list[tuple[str, Callable[[str, Any], Any]]]:
    """Return the fields of a parameter class that are checked, and how."""
    hints, declared = get_type_hints(kind), rules(kind)
    checks = {each.name: _check(hints[each.name], declared.get(each.name)) for each in fields(kind)}
    return [(name, check) for name, check in checks.items() if check is not None]


def _check(hint: Any, rule: Any) -> Callable[[str, Any], Any] | None:
    if rule is not None:
        return lambda name, value: None if value is None and NoneType in get_args(hint) else rule.check(name, value)
    if isinstance(hint, type) and is_dataclass(hint):
        return lambda name, value: build(hint, value, name)
    return {float: as_number, int: as_int, bool: _as_bool, tuple[float, ...]: Numbers().check}.get(hint)


@cache
def rules(kind: type) -> dict[str, Any]:
    """Return the rules that are declared beside the fields of a parameter class, by the fields' names."""
    hints = get_type_hints(kind, include_extras=True)
    marks = {each.name: getattr(hints[each.name], "__metadata__", ()) for each in fields(kind)}
    return {name: mark for name, beside in marks.items() for mark in beside[::-1] if hasattr(mark, "check")}


def build(kind: type[T], value: Any, name: str) -> T:
    """Return parameters of a class that are given as such, or as a mapping of its fields."""
    if isinstance(value, kind):
        return value
    known = {each.name: each for each in fields(kind) if each.init}  # pyright: ignore[reportArgumentType]
    if not isinstance(value, Mapping):
        raise refusal(name, f"a {kind.__name__} or a mapping of its fields ({', '.join(known)})", value)
    _require_known(name, kind, value, known)
    needed = {key for key, each in known.items() if each.default is MISSING and each.default_factory is MISSING}
    if missing := [key for key in known if key in needed - value.keys()]:
        raise ValueError(f"{name}: {kind.__name__} needs {', '.join(missing)}.")
    return kind(**value)


def _require_known(name: str, kind: type, keys: Iterable[Any], known: Iterable[str]) -> None:
    """Refuse keys that are no fields of a class."""
    if unknown := [" ".join(str(key).split()) for key in keys if key not in known]:
        meant = did_you_mean(unknown[0], known)
        raise ValueError(f"{name}: {kind.__name__} has no {', '.join(unknown)}; it has {', '.join(known)}.{meant}")


def given(kind: type[T], value: Any, known: Mapping[str, T], name: str) -> T:
    """Return parameters that are given as such, by a name in ``known``, as a mapping of fields, by a file, or as a variant."""
    base, changes = split(value)
    if base is not value:
        return vary(given(kind, base, known, name), changes, name)
    if isinstance(value, (kind, Mapping)):
        return build(kind, value, name)
    return read_parameters(kind, value, name) if is_file(value) else choose(name, value, known)


def split(value: Any) -> tuple[Any, Mapping[str, Any]]:
    """Return what an option is based on, and the fields that differ; none if it is no mapping with a base."""
    if isinstance(value, Mapping) and BASE in value:
        return value[BASE], {key: change for key, change in value.items() if key != BASE}
    return value, {}


def vary(value: T, changes: Mapping[str, Any], name: str) -> T:
    """Return parameters with other values of some fields; those of a part may be a mapping of some of its fields."""
    if not changes:
        return value
    if not is_dataclass(value):
        raise ValueError(f"{name}: what it is based on has no fields, so {', '.join(map(str, changes))} must be left out.")
    made: Any = value
    _require_known(name, type(made), changes, [each.name for each in fields(made) if each.init])
    varied = {}
    for key, change in changes.items():
        part = getattr(made, key)
        inside = is_dataclass(part) and isinstance(change, Mapping) and "name" not in change  # a name chooses another class
        varied[key] = vary(part, change, f"{name}.{key}") if inside else change
    return replace(made, **varied)


def flattened(changes: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield keys with dots, and values, of nested mappings."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and value:
            yield from flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_parameters(kind: type[T], path: str | Path, name: str = "") -> T:
    """Read parameters from a YAML file with some of their fields; a ``ValueError`` of one line names the file and the field."""
    try:
        return build(kind, load(path), name or kind.__name__)
    except OSError as error:
        raise ValueError(f"There is no {name} file {str(path)!r}, or it cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
