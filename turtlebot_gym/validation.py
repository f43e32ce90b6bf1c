"""Checks of what users pass, each with one error that names the argument, the rule and the value."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, field, fields, is_dataclass
from functools import cache
from numbers import Real
from reprlib import Repr
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

LARGEST, LEAST, TINIEST = 1e9, 1e-15, 1e-100
"""Magnitudes between which a parameter's numbers lie, besides 0 and, where a rule says so, infinity: those that must be
positive from `LEAST` on, since something may be divided by them, others from `TINIEST` on. In SI units all that a robot is
and does lies well between them, and squares, products and ratios of a few such numbers are finite."""

T = TypeVar("T")

_SHORT = Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 6, 200, 200, 100
_SHORT.maxtuple = _SHORT.maxlist = _SHORT.maxset = _SHORT.maxfrozenset = _SHORT.maxdict = _SHORT.maxarray = 30


def shown(value: Any) -> str:
    """Return a value as error messages have it: on one line, however long it is."""
    try:
        return " ".join(_SHORT.repr(value).split())
    except Exception:  # of an object of somebody's own, or a whole number of thousands of digits
        return f"a {type(value).__name__}"


def number(name: str, value: Any) -> float:
    """Return a real number, of Python or NumPy, as a float; truth values are none.

    Raises:
        ValueError: If it is something else.
    """
    if type(value) is float:
        return value
    value = _item(value)
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name} must be a number, got {shown(value)}.")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} must be at most {LARGEST:g} in size, got a whole number beyond all floats.") from None


def whole(name: str, value: Any, least: int = 0, most: float = math.inf) -> int:
    """Return a whole number in a range, of Python or NumPy, as an int.

    Raises:
        ValueError: If it is something else.
    """
    found = _item(value)
    if isinstance(found, bool) or not isinstance(found, int) or not least <= found <= most:
        bounds = f" from {least} to {most}" if most < math.inf else f" of at least {least}"
        raise ValueError(f"{name} must be a whole number{bounds}, got {shown(value)}.")
    return found


def flag(name: str, value: Any) -> bool:
    """Return a truth value, of Python or NumPy.

    Raises:
        ValueError: If it is something else.
    """
    found = _item(value)
    if not isinstance(found, bool):
        raise ValueError(f"{name} must be True or False, got {shown(value)}.")
    return found


def numbers(name: str, value: Any) -> tuple[float, ...]:
    """Return a list, a tuple or an array of one dimension as a tuple of floats.

    Raises:
        ValueError: If it is something else.
    """
    rows = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(rows, (list, tuple)):
        raise ValueError(f"{name} must be a sequence of numbers, got {shown(value)}.")
    return tuple(number(f"{name}[{at}]", item) for at, item in enumerate(rows))


def _item(value: Any) -> Any:
    """Return a NumPy scalar, or an array without dimensions, as Python's own; others as they are."""
    return value.item() if hasattr(value, "item") and getattr(value, "shape", None) == () else value


def variances(name: str, value: Any, size: int) -> tuple[float, ...]:
    """Return the diagonal of a covariance that was given as its diagonal or as a diagonal matrix.

    Args:
        name: What the error messages call it.
        value: Shape (size,) or (size, size).
        size: Number of components.

    Raises:
        ValueError: If the shape is wrong, a variance is negative or not finite, or a matrix is not symmetric and diagonal.
    """
    rows = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(rows, (list, tuple)) or len(rows) != size:
        raise ValueError(f"{name} must hold {size} variances or be a {size} x {size} matrix, got {shown(value)}.")
    if any(isinstance(row, (list, tuple)) for row in rows):
        if any(not isinstance(row, (list, tuple)) or len(row) != size for row in rows):
            raise ValueError(f"{name} must be a {size} x {size} matrix, got {shown(value)}.")
        if any(rows[i][j] != rows[j][i] for i in range(size) for j in range(i)):
            raise ValueError(f"{name} must be symmetric, got {shown(value)}.")
        if any(rows[i][j] != 0.0 for i in range(size) for j in range(i)):
            raise ValueError(f"{name} must be diagonal (the components' noises are independent), got {shown(value)}.")
        rows = [rows[i][i] for i in range(size)]
    diagonal = numbers(name, rows)
    if not all(0.0 <= variance < math.inf for variance in diagonal):  # also rejects NaN
        raise ValueError(f"{name} must hold finite variances >= 0, got {shown(value)}.")
    _require_size(name, diagonal, value)
    return diagonal


def choose(what: str, name: Any, known: Mapping[Any, T]) -> T:
    """Return a named choice.

    Raises:
        ValueError: If there is none of that name; the message lists those that there are.
    """
    try:
        return known[name]
    except (KeyError, TypeError):  # TypeError: of what has no hash, a list in a tuple among it
        raise ValueError(f"{what} must be one of {', '.join(map(repr, known))}, got {shown(name)}.") from None


def ranged(default: float, low: float, high: float, unit: str = "", *, above: bool = False, below: bool = False) -> Any:
    """Return a dataclass field for a number in a range: `check_fields` refuses other numbers, and ROS shows the range.

    Args:
        default: Default value; an int makes a whole number.
        low: Least value.
        high: Greatest value.
        unit: Unit after the range, with a space before it.
        above: Whether ``low`` itself is excluded.
        below: Whether ``high`` itself is excluded.
    """
    ends = (str(end) if isinstance(end, int) else f"{end:g}" for end in (low, high))
    rule = f"in {'(' if above else '['}{', '.join(ends)}{')' if below else ']'}{unit}"

    def holds(value: float) -> bool:
        return low <= value <= high and not (above and value == low) and not (below and value == high)  # NaN is refused

    return field(default=default, metadata={"rule": rule, "holds": holds, "range": (low, high)})


def named(default: str, *names: str, or_else: Callable[[str], bool] = lambda name: False, other: str = "") -> Any:
    """Return a dataclass field for one of some names; other texts are accepted if ``or_else`` does, and ``other`` says so."""
    rule = f"one of {', '.join(names)}{other}"
    return field(default=default, metadata={"rule": rule, "holds": lambda name: name in names or or_else(name)})


def check_fields(owner: Any) -> None:
    """Check the fields of a dataclass that were declared by `ranged` and `named`, in its ``__post_init__``.

    Raises:
        ValueError: If a field breaks its rule; the message names it.
    """
    for item in fields(owner):
        value = getattr(owner, item.name)
        if "holds" in item.metadata and not item.metadata["holds"](value):
            raise ValueError(f"{item.name} must be {item.metadata['rule']}, got {shown(value)}.")


_RULES: dict[str, Callable[[float], bool]] = {
    "positive": lambda number: 0.0 < number < math.inf,
    "positive or infinite": lambda number: number > 0.0,
    "non-negative": lambda number: 0.0 <= number < math.inf,
    "finite": math.isfinite,
    "a probability": lambda number: 0.0 <= number <= 1.0,
}


def require(owner: Any, rule: str, *names: str) -> None:
    """Check fields of a parameter class, which may be numbers or tuples of them, against a rule.

    Args:
        owner: The parameters.
        rule: "positive", "positive or infinite", "non-negative", "finite" or "a probability"; besides, what is finite and not
            0 has a magnitude from `LEAST` or `TINIEST` to `LARGEST`.
        *names: The fields.

    Raises:
        ValueError: If a field breaks the rule; the message names it.
    """
    holds = _RULES[rule]
    for name in names:
        value = getattr(owner, name)
        items = value if isinstance(value, tuple) else (value,)
        where = f"{type(owner).__name__}.{name}"
        if not all(isinstance(item, (int, float)) and not isinstance(item, bool) and holds(item) for item in items):
            raise ValueError(f"{where} must be {rule}, got {shown(value)}.")
        _require_size(where, items, value, positive=rule.startswith("positive"))


def _require_size(where: str, items: tuple[float, ...], value: Any, *, positive: bool = False) -> None:
    least = LEAST if positive else TINIEST
    if any(item != 0.0 and not least <= abs(item) <= LARGEST and not math.isinf(item) for item in items):
        zero = "" if positive else "0 or "
        raise ValueError(f"{where} must be {zero}from {least:g} to {LARGEST:g} in size, got {shown(value)}.")


def typed(owner: Any) -> None:
    """Give each field of a parameter class the type that it is declared with, where that loses nothing.

    NumPy's numbers become Python's, sequences and arrays become tuples, and a mapping becomes the parameter class that is
    asked for.

    Args:
        owner: An instance of a frozen dataclass, in its ``__post_init__``.

    Raises:
        ValueError: If a field is of another type; the message names it.
    """
    kind = type(owner)
    for name, read in _readers(kind):
        value = getattr(owner, name)
        found = read(f"{kind.__name__}.{name}", value)
        if found is not value:
            object.__setattr__(owner, name, found)


def made(kind: type[T], value: Any, name: str) -> T:
    """Return parameters of a class that are given as such, or as a mapping of its fields.

    Raises:
        ValueError: If they are given as something else, a field is unknown, missing or breaks its rule.
    """
    if isinstance(value, kind):
        return value
    assert is_dataclass(kind)
    known = {item.name: item for item in fields(kind)}
    if not isinstance(value, Mapping):
        names = ", ".join(known)
        raise ValueError(f"{name} must be a {kind.__name__} or a mapping of its fields ({names}), got {shown(value)}.")
    unknown = [" ".join(str(key).split()) for key in value if key not in known]
    if unknown:
        raise ValueError(f"{name}: {kind.__name__} has no {', '.join(unknown)}; it has {', '.join(known)}.")
    needed = [key for key, item in known.items() if item.default is MISSING and item.default_factory is MISSING]
    missing = [key for key in needed if key not in value]
    if missing:
        raise ValueError(f"{name}: {kind.__name__} needs {', '.join(missing)}.")
    return kind(**value)


@cache
def _readers(kind: type) -> tuple[tuple[str, Callable[[str, Any], Any]], ...]:
    """Return the name of each field of a parameter class, with the function that reads its value."""
    hints = get_type_hints(kind)
    readers: dict[Any, Callable[[str, Any], Any]] = {float: number, int: whole, bool: flag}
    found = []
    for item in fields(kind):
        hint = hints[item.name]
        if hint in readers:
            found.append((item.name, readers[hint]))
        elif isinstance(hint, type) and is_dataclass(hint):
            found.append((item.name, lambda name, value, hint=hint: made(hint, value, name)))
        elif get_origin(hint) is tuple and get_args(hint) == (float, ...):
            found.append((item.name, numbers))
    return tuple(found)
