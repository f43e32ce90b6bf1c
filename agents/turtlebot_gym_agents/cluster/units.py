"""Units of work: the task and everything it depends on, independent of where it runs.

A unit can be pickled, and `run` is a pure function of it: results are bit-identical on all machines with the same libraries and
kind of processor. Stored results are reused, and missing ones are computed and stored as they arrive.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

from turtlebot_gym_agents.cluster.origin import origin
from turtlebot_gym_agents.cluster.store import Result, Store


class Unit(Protocol):
    """A piece of work."""

    memory: int
    """Memory that a process needs for it, bytes."""

    @property
    def size(self) -> int:
        """Size as counted by progress."""
        ...

    def about(self) -> dict[str, Any]:
        """Return everything that the result depends on, as JSON types."""
        ...

    def run(self) -> Result:
        """Run the unit."""
        ...


Workers = Callable[[Iterable[tuple[str, Unit]]], Iterator[tuple[str, Result]]]
"""Function that runs units, taken as needed, and yields their results in any order, both with their keys."""


def key(unit: Unit) -> str:
    """Return the name of a unit's result: a hash of everything it depends on, code and libraries included."""
    text = json.dumps({"about": unit.about(), "origin": origin()}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def run(unit: Unit) -> Result:
    """Run a unit, and record where it ran and how long it took."""
    begun, cpu = time.perf_counter(), time.process_time()
    result = unit.run()
    times = {
        "seconds": time.perf_counter() - begun,
        "cpu_seconds": time.process_time() - cpu,
        "host": platform.node(),
        "process": os.getpid(),
    }
    return result._replace(times={**times, **result.times})


def in_turn(units: Iterable[tuple[str, Unit]]) -> Iterator[tuple[str, Result]]:
    """Run units in this process, one after another."""
    for name, unit in units:
        yield name, run(unit)


def complete(
    units: Sequence[Unit],
    *,
    workers: Workers = in_turn,
    store: Store | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Result]:
    """Return the results of units, in their order.

    Args:
        units: The units; equal ones run once.
        workers: Function that runs them; results do not depend on it.
        store: Store of the results. A unit whose result is there is not run.
        progress: Called with the total size of the units that have a result.

    Raises:
        ValueError, OSError, ImportError: Raised by a unit.
    """
    keys = [key(unit) for unit in units]
    sizes: dict[str, int] = {}
    for name, unit in zip(keys, units, strict=True):
        sizes[name] = sizes.get(name, 0) + unit.size
    results = {name: store.get(name) for name in sizes if name in store} if store else {}
    done = sum(sizes[name] for name in results)
    progress(done)
    missing = {name: unit for name, unit in zip(keys, units, strict=True) if name not in results}
    for name, result in workers(missing.items()) if missing else ():
        if store:
            store.put(name, result)
        results[name] = result
        done += sizes[name]
        progress(done)
    return [results[name] for name in keys]
