"""Checks of what users pass, each with one error that names the argument, the rule and the value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

T = TypeVar("T")


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
    if not isinstance(rows, Sequence) or len(rows) != size:
        raise ValueError(f"{name} must hold {size} variances or be a {size} x {size} matrix, got {value!r}.")
    if any(isinstance(row, Sequence) for row in rows):
        if any(len(row) != size for row in rows):
            raise ValueError(f"{name} must be a {size} x {size} matrix, got {value!r}.")
        if any(rows[i][j] != rows[j][i] for i in range(size) for j in range(i)):
            raise ValueError(f"{name} must be symmetric, got {value!r}.")
        if any(rows[i][j] != 0.0 for i in range(size) for j in range(i)):
            raise ValueError(f"{name} must be diagonal (the components' noises are independent), got {value!r}.")
        rows = [rows[i][i] for i in range(size)]
    diagonal = tuple(float(variance) for variance in rows)
    if not all(0.0 <= variance < math.inf for variance in diagonal):  # also rejects NaN
        raise ValueError(f"{name} must hold finite variances >= 0, got {value!r}.")
    return diagonal


def choose(what: str, name: Any, known: Mapping[Any, T]) -> T:
    """Return a named choice.

    Raises:
        ValueError: If there is none of that name; the message lists those that there are.
    """
    if name not in known:
        raise ValueError(f"{what} must be one of {', '.join(map(repr, known))}, got {name!r}.")
    return known[name]


def require(owner: Any, rule: str, *names: str) -> None:
    """Check fields of a parameter class, which may be numbers or tuples of them, against a rule.

    Args:
        owner: The parameters.
        rule: "positive", "non-negative", "finite" or "a probability"; "positive" admits infinity.
        *names: The fields.

    Raises:
        ValueError: If a field breaks the rule; the message names it.
    """
    holds = {
        "positive": lambda number: number > 0.0,
        "non-negative": lambda number: 0.0 <= number < math.inf,
        "finite": math.isfinite,
        "a probability": lambda number: 0.0 <= number <= 1.0,
    }[rule]
    for name in names:
        value = getattr(owner, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(isinstance(number, (int, float)) and holds(number) for number in numbers):
            raise ValueError(f"{type(owner).__name__}.{name} must be {rule}, got {value!r}.")
