"""The one rule for what users pass: a value that breaks its rule is refused as "NAME must be RULE, got VALUE."

A rule is declared beside the field that it holds for, ``radius: Annotated[float, POSITIVE] = 0.1``, and `check_fields` checks
all fields of a parameter class by such declarations; anything else calls ``POSITIVE.check("radius", value)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import KW_ONLY, MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from numbers import Real
from reprlib import Repr
from types import NoneType
from typing import Any, Protocol, TypeVar, get_args, get_type_hints

LARGEST, LEAST, TINIEST = 1e9, 1e-15, 1e-100
"""Magnitudes between which a parameter's numbers lie, besides 0 and, where a rule says so, infinity: those that must be
positive from `LEAST` on, since something may be divided by them, others from `TINIEST` on. In SI units all that a robot is
and does lies well between them, and squares, products and ratios of a few such numbers are finite."""

T = TypeVar("T")

_SHORT = Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 6, 200, 200, 100
_SHORT.maxtuple = _SHORT.maxlist = _SHORT.maxset = _SHORT.maxfrozenset = _SHORT.maxdict = _SHORT.maxarray = 30


class Rule(Protocol):
    """What a value may be; its text completes "must be"."""

    def check(self, name: str, value: Any) -> Any:
        """Return the value in the type that it stands for, or raise the `refusal` of one that breaks the rule."""
        ...


def short_repr(value: Any) -> str:
    """Return a value as error messages show it: on one line and shortened."""
    try:
        return " ".join(_SHORT.repr(value).split())
    except Exception:  # an object of somebody else's, or a whole number of thousands of digits
        return f"a {type(value).__name__}"


def refusal(name: str, rule: object, value: Any) -> ValueError:
    """Return the error for a value that breaks its rule."""
    return ValueError(f"{name} must be {rule}, got {short_repr(value)}.")


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers between two ends, both included unless open; no booleans, no NaN, and nothing between 0 and `TINIEST`."""

    low: float = -LARGEST
    high: float = LARGEST
    _: KW_ONLY
    open_low: bool = False
    open_high: bool = False
    whole: bool = False
    """Whether they are whole numbers, of type int."""
    infinite: bool = False
    """Whether infinity is allowed besides."""
    log: bool = False
    """Whether values to try are drawn uniformly on a logarithmic scale."""
    kind: str = "number"
    unit: str = ""

    def check(self, name: str, value: Any) -> Any:
        """Return a number of Python or NumPy as a float, or as an int if it must be whole."""
        number = _real(value, whole=self.whole)
        if number is None or not self._holds(number):
            raise refusal(name, self, value)
        if not self.whole and 0.0 < abs(number) < TINIEST:
            raise refusal(name, f"0 or at least {TINIEST:g} in size", value)
        return number

    def of(self, unit: str) -> Range:
        """Return the same numbers with a unit."""
        return replace(self, unit=unit)

    def _holds(self, number: float) -> bool:
        if number in (self.low, self.high):
            return not (self.open_low if number == self.low else self.open_high)
        return self.low < number < self.high or (self.infinite and number == math.inf)

    def __str__(self) -> str:
        """Return the rule in words, such as "a number above 0 and at most 0.5 s"."""
        low, high = (f"{end}" if isinstance(end, int) else f"{end:g}" for end in (self.low, self.high))
        text = f"above {low}" if self.open_low else f"of at least {low}"
        if self.high < math.inf and not (self.open_low or self.open_high):
            text = f"from {low} to {high}"
        elif self.high < math.inf:
            text += f" and {'below' if self.open_high else 'at most'} {high}"
        text = f"a {'whole ' if self.whole else ''}{self.kind} {text}"
        return text + (f" {self.unit}" if self.unit else "") + (", or infinite" if self.infinite else "")


POSITIVE = Range(LEAST, kind="positive number")
POSITIVE_OR_INFINITE = Range(LEAST, kind="positive number", infinite=True)
NON_NEGATIVE = Range(0.0)
FINITE = Range()
PROBABILITY = Range(0.0, 1.0, kind="probability")
ONE_OR_MORE = Range(1, 10**9, whole=True)


@dataclass(frozen=True, slots=True)
class Numbers:
    """A sequence of numbers."""

    each: Range | None = None
    """What each of them may be; any number if None."""
    size: int | None = None
    """How many they are; any number of them if None."""
    diagonal: bool = False
    """Whether a diagonal matrix may stand for its diagonal."""

    def check(self, name: str, value: Any) -> tuple[float, ...]:
        """Return a list, a tuple or an array as a tuple of floats."""
        rows = value.tolist() if hasattr(value, "tolist") else value
        if self.diagonal and _is_diagonal(rows):
            rows = [row[at] for at, row in enumerate(rows)]
        if not _is_row(rows) or self.size not in (None, len(rows)) or (self.diagonal and any(map(_is_row, rows))):
            raise refusal(name, self, value)
        check = _number if self.each is None else self.each.check
        return tuple(check(f"{name}[{at}]", item) for at, item in enumerate(rows))

    def __str__(self) -> str:
        text = "a sequence of numbers" if self.size is None else f"{self.size} numbers"
        return text + (f" or a diagonal {self.size} x {self.size} matrix of them" if self.diagonal else "")


@dataclass(frozen=True, slots=True)
class Names:
    """Some names, and other text if a function accepts it."""

    names: Collection[str]
    """The names; a mapping may get further ones."""
    or_else: Callable[[str], bool] = lambda name: False
    other: str = ""
    """The other text in words."""

    def check(self, name: str, value: Any) -> str:
        if isinstance(value, str) and (value in self.names or self.or_else(value)):
            return value
        raise ValueError(f"{refusal(name, self, value)}{did_you_mean(value, self.names)}")

    def __str__(self) -> str:
        return f"one of {', '.join(self.names)}{self.other}"


def variances(size: int) -> Numbers:
    """Return the rule of a covariance that is given as its diagonal or as a diagonal matrix."""
    return Numbers(NON_NEGATIVE, size, diagonal=True)


def _is_row(value: Any) -> bool:
    return isinstance(value, (list, tuple))


def _is_diagonal(rows: Any) -> bool:
    square = _is_row(rows) and all(_is_row(row) and len(row) == len(rows) for row in rows)
    return square and all(item == 0.0 for i, row in enumerate(rows) for j, item in enumerate(row) if i != j)


def _item(value: Any) -> Any:
    """Return a NumPy scalar, or an array without dimensions, as Python's own; others as they are."""
    return value.item() if hasattr(value, "item") and getattr(value, "shape", None) == () else value


def _real(value: Any, *, whole: bool = False) -> Any:
    """Return a real number as a float or an int; None for anything else."""
    value = _item(value)
    if isinstance(value, bool) or not isinstance(value, int if whole else Real):
        return None
    try:
        return value if whole else float(value)
    except OverflowError:
        return None


def _number(name: str, value: Any) -> float:
    """Return any real number, even an infinite one or NaN."""
    number = _real(value)
    if number is None:
        raise refusal(name, "a number", value)
    return number


def as_int(name: str, value: Any, least: int = 0, most: float = math.inf) -> int:
    """Return a whole number in a range as an int, or raise the `refusal` of anything else."""
    return Range(least, most, whole=True).check(name, value)


def as_bool(name: str, value: Any) -> bool:
    """Return a boolean, of Python or NumPy, as Python's, or raise the `refusal` of anything else."""
    truth = _item(value)
    if not isinstance(truth, bool):
        raise refusal(name, "True or False", value)
    return truth


def choose(what: str, name: Any, known: Mapping[Any, T]) -> T:
    """Return a named choice.

    Raises:
        ValueError: If the name is unknown; the message lists the known ones, and asks whether a similar one was meant.
    """
    try:
        return known[name]
    except (KeyError, TypeError):  # TypeError: it has no hash, such as a list
        error = refusal(what, f"one of {', '.join(map(repr, known))}", name)
        raise ValueError(f"{error}{did_you_mean(name, known)}") from None


def did_you_mean(name: Any, known: Iterable[Any]) -> str:
    """Return " Did you mean ...?" for a similar name, or nothing."""
    from difflib import get_close_matches  # needed in error messages only

    if not isinstance(name, str):
        return ""
    known_as = {text.lower(): text for text in known if isinstance(text, str)}
    wanted = name.lower()
    similar = get_close_matches(wanted, known_as, 1) or [text for text in known_as if len(wanted) > 2 and wanted in text]
    return f" Did you mean {known_as[similar[0]]!r}?" if similar else ""


def check_fields(owner: Any, prefix: str | None = None) -> None:
    """Check the fields of a parameter class, and give each the type that it is declared with, where that loses nothing.

    NumPy's numbers become Python's, sequences and arrays become tuples, and a mapping becomes the parameter class that is
    asked for.

    Args:
        owner: An instance of a frozen dataclass, in its ``__post_init__``.
        prefix: What precedes a field's name in messages; the class and a dot if None.

    Raises:
        ValueError: If a field is of another type or breaks its rule; the message names it.
    """
    kind = type(owner)
    prefix = f"{kind.__name__}." if prefix is None else prefix
    for name, check in _checks(kind):
        value = getattr(owner, name)
        kept = check(f"{prefix}{name}", value)
        if kept is not value:
            object.__setattr__(owner, name, kept)


def rules(kind: type) -> dict[str, Rule]:
    """Return the rules that are declared beside the fields of a parameter class, by the fields' names."""
    hints = get_type_hints(kind, include_extras=True)
    marks = {item.name: getattr(hints[item.name], "__metadata__", ()) for item in fields(kind)}
    declared = {name: [mark for mark in beside if hasattr(mark, "check")] for name, beside in marks.items()}
    return {name: beside[0] for name, beside in declared.items() if beside}


def build(kind: type[T], value: Any, name: str) -> T:
    """Return parameters of a class that are given as such, or as a mapping of its fields.

    Raises:
        ValueError: If they are given as something else, a field is unknown, missing or breaks its rule.
    """
    if isinstance(value, kind):
        return value
    assert is_dataclass(kind)
    known = {item.name: item for item in fields(kind) if item.init}
    if not isinstance(value, Mapping):
        raise refusal(name, f"a {kind.__name__} or a mapping of its fields ({', '.join(known)})", value)
    unknown = [" ".join(str(key).split()) for key in value if key not in known]
    if unknown:
        meant = did_you_mean(unknown[0], known)
        raise ValueError(f"{name}: {kind.__name__} has no {', '.join(unknown)}; it has {', '.join(known)}.{meant}")
    needed = (key for key, item in known.items() if item.default is MISSING and item.default_factory is MISSING)
    if missing := [key for key in needed if key not in value]:
        raise ValueError(f"{name}: {kind.__name__} needs {', '.join(missing)}.")
    return kind(**value)


@cache
def _checks(kind: type) -> tuple[tuple[str, Callable[[str, Any], Any]], ...]:
    """Return the fields of a parameter class that are checked, and how."""
    hints, declared = get_type_hints(kind), rules(kind)
    checks = {item.name: _check(hints[item.name], declared.get(item.name)) for item in fields(kind)}
    return tuple((name, check) for name, check in checks.items() if check is not None)


def _check(hint: Any, rule: Rule | None) -> Callable[[str, Any], Any] | None:
    if rule is not None:
        optional = NoneType in get_args(hint)
        return lambda name, value: None if optional and value is None else rule.check(name, value)
    if isinstance(hint, type) and is_dataclass(hint):
        return lambda name, value: build(hint, value, name)
    return {float: _number, int: as_int, bool: as_bool, tuple[float, ...]: Numbers().check}.get(hint)
