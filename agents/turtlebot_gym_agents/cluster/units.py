"""Units of work: the task and everything it depends on, independent of where it runs; and a folder of their results.

A unit can be pickled, and `run` is a pure function of it: results are bit-identical on all machines with the same libraries and
kind of processor. Stored results are reused, and missing ones are computed and stored as they arrive. Units of other code or
other libraries are other units.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

import turtlebot_gym
import turtlebot_gym_agents
from turtlebot_gym.files import read_arrays, replacing
from turtlebot_gym_agents.policies.named import pretrained_folder
from turtlebot_gym_agents.provenance import libraries
from turtlebot_gym_agents.training.hyperparameters import configs_folder


class Result(NamedTuple):
    """Result of a unit."""

    facts: dict[str, Any]
    """Values of JSON types; NaN and infinity are allowed."""
    arrays: dict[str, NDArray[Any]]
    """Arrays, stored bit-exactly."""
    files: dict[str, bytes]
    """Files that the unit made, by name."""
    times: dict[str, Any]
    """Values that depend on machine and time: seconds, process, host."""


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
"""Runs units, taken as needed, and yields their results in any order, with their keys."""
Runner = Callable[[Sequence[Unit], Callable[[int], None]], list[Result]]
"""`complete`, with workers and a store."""


class Store:
    """A folder with one file for the result of each unit, named by the unit's key and written atomically.

    A file is a zip archive of NumPy arrays, ``*.npz``; reading it runs no code. Several processes and machines may share it.

    Args:
        folder: Folder of the results; created if missing.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder

    def __contains__(self, key: str) -> bool:
        return self._path(key).is_file()

    def put(self, key: str, result: Result) -> None:
        """Store a result, unless there is one already."""
        if key in self:
            return
        # As bytes: without pickle, NumPy reads only arrays.
        values = json.dumps({"facts": result.facts, "times": result.times}).encode()
        content = {
            "told": np.frombuffer(values, np.uint8),
            **{f"array/{name}": array for name, array in result.arrays.items()},
            **{f"file/{name}": np.frombuffer(content, np.uint8) for name, content in result.files.items()},
        }
        with replacing(self._path(key)) as beside, beside.open("wb") as file:
            np.savez(file, **content)  # pyright: ignore[reportArgumentType]

    def get(self, key: str) -> Result:
        """Return a result.

        Raises:
            ValueError: If its file is damaged.
        """
        try:
            content = read_arrays(self._path(key))
            values = json.loads(content["told"].tobytes())
            arrays = {name.removeprefix("array/"): content[name] for name in content if name.startswith("array/")}
            files = {name.removeprefix("file/"): content[name].tobytes() for name in content if name.startswith("file/")}
        except (ValueError, KeyError) as error:
            raise ValueError(f"{self._path(key)} is damaged: remove it to repeat its unit.") from error
        return Result(values["facts"], arrays, files, values["times"])

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.npz"


@cache
def origin() -> dict[str, Any]:
    """Return the version, a hash of this package's code and data, and the libraries' versions."""
    digest = hashlib.sha256()
    for package in (turtlebot_gym, turtlebot_gym_agents):
        digest.update(_content(Path(str(package.__file__)).parent, ".py"))
    digest.update(_content(pretrained_folder(), ".onnx"))
    digest.update(_content(configs_folder(), ".yaml"))
    return {"version": turtlebot_gym.__version__, "code": digest.hexdigest(), "libraries": libraries()}


def difference(here: dict[str, Any], there: dict[str, Any]) -> str:
    """Describe how another origin differs from the local one; empty if it does not."""
    if there["version"] != here["version"]:
        return f"turtlebot_gym {there['version']}, here it is {here['version']}"
    for name, version in here["libraries"].items():
        other = there["libraries"].get(name)
        if other != version:
            return f"{name} {other}, here it is {version}" if other else f"no {name}, here it is {version}"
    return "" if there["code"] == here["code"] else "turtlebot_gym with other code than here"


def _content(folder: Path, suffix: str) -> bytes:
    """Return a hash of the names and contents of files with a suffix below a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob(f"*{suffix}")):
        digest.update(f"{path.relative_to(folder).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.digest()


def key(unit: Unit) -> str:
    """Return a hash of everything that a unit depends on, code and libraries included."""
    # Sorted, since the order of settings does not matter.
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
    progress: Callable[[int], None] = lambda done: None,
    *,
    workers: Workers = in_turn,
    store: Store | None = None,
) -> list[Result]:
    """Return the results of units, in their order.

    Args:
        units: The units; equal ones run once.
        progress: Called with the total size of the units that have a result.
        workers: Function that runs them; results do not depend on it.
        store: Store of the results. A unit whose result is there is not run.

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
