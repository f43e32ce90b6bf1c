"""A folder with one file for the result of each unit, named by the unit's key and written atomically.

A file is a zip archive of NumPy arrays, ``*.npz``; reading it runs no code. Several processes and machines may share a folder.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym_agents.files import replacing


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


class Store:
    """Results by key.

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
            with self._path(key).open("rb") as file, np.load(file, allow_pickle=False) as content:
                values = json.loads(content["told"].tobytes())
                arrays = {name.removeprefix("array/"): content[name] for name in content if name.startswith("array/")}
                files = {name.removeprefix("file/"): content[name].tobytes() for name in content if name.startswith("file/")}
        except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{self._path(key)} is damaged: remove it to repeat its unit.") from error
        return Result(values["facts"], arrays, files, values["times"])

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.npz"
