"""Result files: written as a whole or not at all, each with configuration, seed, commit and versions."""

from __future__ import annotations

import json
import math
import platform
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import turtlebot_gym
from turtlebot_gym.files import write_text

LIBRARIES = ("numpy", "scipy", "gymnasium", "llvmlite", "stable-baselines3", "torch", "onnxruntime")
"""Libraries whose versions are recorded if they are installed."""


def provenance() -> dict[str, Any]:
    """Return the origin of a result: this package's version and commit, and the libraries' versions."""
    libraries = {"python": platform.python_version()}
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            libraries[name] = version(name)
    return {"version": turtlebot_gym.__version__, "commit": _commit(), "libraries": libraries}


def write_json(path: Path, result: Mapping[str, Any], *, config: Mapping[str, Any]) -> None:
    """Write a result with its configuration, the seed among it, and its provenance; the file is replaced atomically.

    NaN and infinity are written as null, which is valid JSON.
    """
    text = json.dumps(plain({"config": config, **provenance(), **result}), indent=1, allow_nan=False)
    write_text(path, text + "\n")


def plain(value: Any) -> Any:
    """Return a value as JSON types.

    Named tuples become objects, numbers of arrays keep 7 digits, and terms and filters of one's own are named.
    """
    if isinstance(value, Mapping):
        return {getattr(key, "spelled", None) or str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "sourced"):  # a term of an observation, whose module is slow to import
        return value.sourced().spelled
    if hasattr(value, "_asdict"):  # a named tuple
        return plain(value._asdict())
    if isinstance(value, np.ndarray):
        exact = value.dtype.kind != "f"
        return plain([item if exact else float(f"{item:.7g}") for item in value.tolist()] if value.ndim == 1 else list(value))
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, Path) or is_dataclass(value):
        return str(value)  # a preset that is given as an object says all its numbers
    kind = value if hasattr(value, "__qualname__") else type(value)  # a filter of one's own: its text may hold an address
    return f"{kind.__module__}:{kind.__qualname__}"


def _commit() -> str | None:
    """Return the commit of this package's checkout, marked if files differ; None without one."""
    git = ["git", "--no-optional-locks", "-C", str(Path(turtlebot_gym.__file__).parent)]
    options: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 10, "check": True}
    try:
        # HEAD:./ fails if the package merely lies inside another repository, as in a virtual environment
        commit = subprocess.run([*git, "rev-parse", "HEAD", "HEAD:./"], **options).stdout.split()[0]
        changes = subprocess.run([*git, "status", "--porcelain", "--untracked-files=no"], **options).stdout
    except (OSError, subprocess.SubprocessError):
        return None
    return f"{commit}-dirty" if changes else commit
