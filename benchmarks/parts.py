"""Shared by benchmarks of the live graph: results with limits, and the parts of a sitting with the machine's load."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple


class Figure(NamedTuple):
    """A result."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    """Limit that it must stay below; None if it is only reported."""


def measured(parts: Mapping[str, Callable[[], dict[str, Any]]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each part's results, with the load of the machine before and after it (1 min average)."""
    for name, part in parts.items():
        before = os.getloadavg()[0]
        yield name, part() | {"load": [before, os.getloadavg()[0]]}
