"""Where the numbers of terms stand in an observation, and the values that stand there, past ones too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.observations.term import ObservationTerm


def size_of(terms: Sequence[ObservationTerm]) -> int:
    """Return how many numbers an observation of some terms has."""
    return sum(term.size for term in terms)


def slices_of(terms: Sequence[ObservationTerm]) -> dict[str, slice]:
    """Return where the numbers of each term stand in an observation, by its name."""
    ends = np.cumsum([term.size for term in terms]).tolist()
    return {term.name: slice(end - term.size, end) for term, end in zip(terms, ends, strict=True)}


def columns_of(wanted: Sequence[ObservationTerm], terms: Sequence[ObservationTerm]) -> NDArray[np.intp]:
    """Return the columns in which some terms stand in an observation of others; a history holds each shorter one.

    A ``ValueError`` names one that is missing there.
    """
    places, there = slices_of(terms), {term.name: term for term in terms}
    columns: list[int] = []
    for term in wanted:
        other = there.get(term.name, term)
        differs = term.source and other.source and term.source != other.source
        if differs or (other.bounds, other.unit) != (term.bounds, term.unit):
            raise ValueError(f"it reads {term.spelled!r} with other bounds or another unit than {other.spelled!r} has")
        is_shorter = other.length < term.length or (term.length > 1 and other.every != term.every)
        if term.name not in there or is_shorter:
            shown = ",".join(each.spelled for each in terms)
            raise ValueError(f"it reads {term.spelled!r}, which is not in the observation {shown}")
        start = places[term.name].start
        columns.extend(range(start, start + term.size))
    return np.array(columns, np.intp)


def bounds_of(terms: Sequence[ObservationTerm]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the lower and upper bounds of an observation."""
    low, high = zip(*([bound * term.length for bound in term.bounds] for term in terms), strict=True)
    return tuple(number for part in low for number in part), tuple(number for part in high for number in part)


class PresentValues(NamedTuple):
    """The values of all terms of an observation that are in no scene."""

    values: tuple[Any, ...]


@cache
def observing(terms: tuple[ObservationTerm, ...]) -> Callable[..., PresentValues]:
    """Return the kernel ``observe(world, p)`` of an observation's terms."""
    kernels = tuple(term.of for term in terms if not term.in_scene)
    return kernel(lambda world, p: PresentValues(tuple(of(world, p) for of in kernels)))


def present_columns(terms: Sequence[ObservationTerm]) -> list[int]:
    """Return the column of each number that `observing` returns; others are in a scene, or the past of a history."""
    places = slices_of(terms)
    return [places[term.name].start + k for term in terms if not term.in_scene for k in range(term.width)]


def row_of(terms: Sequence[ObservationTerm], values: Any) -> tuple[float, ...]:
    """Return an observation from the present value of each term; the past of a history is the present."""
    rows = (value if isinstance(value, tuple) else (value,) for value in values)
    return tuple(number for term, row in zip(terms, rows, strict=True) for number in row * term.length)


class History:
    """The past values of an observation's terms that show more than the present one, of ``rows`` environments."""

    def __init__(self, terms: Sequence[ObservationTerm], rows: int) -> None:
        places, self._at = slices_of(terms), 0
        self._parts: list[tuple[int, int, int, int, NDArray[np.float32]]] = []
        for term in terms:
            if term.length > 1:
                past = np.zeros(((term.length - 1) * term.every + 1, rows, term.width), np.float32)
                self._parts.append((places[term.name].start, term.width, term.length, term.every, past))

    def __bool__(self) -> bool:
        return bool(self._parts)

    def begin(self, observations: NDArray[Any], mask: NDArray[np.bool_]) -> None:
        """Begin episodes of some environments, whose present numbers stand in ``observations``, shape (N, k)."""
        for start, width, _, _, past in self._parts:
            past[:, mask] = observations[mask, start : start + width]
        self.show(observations)

    def advance(self, observations: NDArray[Any]) -> None:
        """Take a step: remember the present numbers of all environments, and write the past ones beside them."""
        self._at += 1
        for start, width, _, _, past in self._parts:
            past[self._at % len(past)] = observations[:, start : start + width]
        self.show(observations)

    def show(self, observations: NDArray[Any]) -> None:
        """Write the past numbers."""
        for start, width, length, every, past in self._parts:
            for k in range(1, length):
                to = start + k * width
                observations[:, to : to + width] = past[(self._at - k * every) % len(past)]
