"""Shared by benchmarks of the live graph: the parts of a sitting with the machine's load, and busy neighbours."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

NEIGHBOUR = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: pass"
"""Program of a busy neighbour, which ends with its parent."""


class Figure(NamedTuple):
    """A result."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    """Limit that it must stay below; None if it is only reported."""


@contextmanager
def busy(number: int) -> Iterator[None]:
    """Keep the machine busy with a number of processes."""
    processes = [subprocess.Popen([sys.executable, "-c", NEIGHBOUR]) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def measured(parts: Mapping[str, Callable[[], dict[str, Any]]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each part's results, with the load of the machine before and after it (1 min average)."""
    for name, part in parts.items():
        before = os.getloadavg()[0]
        yield name, part() | {"load": [before, os.getloadavg()[0]]}


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
