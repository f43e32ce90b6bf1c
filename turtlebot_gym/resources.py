"""Files that worlds name by a URI: ``model://``, ``package://``, ``file://``, or a relative path."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote, urlsplit

VARIABLES = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH", "SDF_PATH")
"""Environment variables with folders of models, of new and of classic Gazebo."""
PACKAGES = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
"""Environment variables of ROS 2 (whose packages lie in ``share``) and ROS 1."""
_LEVELS = 3
"""Folders above a file in which models are searched for."""


def find_resource(uri: str, files: Sequence[Path]) -> Path | None:
    """Return the file or folder that a URI names; None if there is none.

    Args:
        uri: The URI.
        files: The file that states it, and those that include that one: models are searched for beside them, in ``models``
            there, and in both of the folders above.
    """
    parts = urlsplit(uri.strip())
    if parts.scheme in ("http", "https"):
        candidates = _downloaded(parts.netloc, unquote(parts.path))
    else:
        name = unquote(f"{parts.netloc}{parts.path}") if parts.scheme else uri.strip()
        candidates = (folder / (name if parts.scheme == "file" else name.lstrip("/")) for folder in _folders(files))
        if not parts.scheme:
            candidates = (file.parent / name for file in files)
    return next((path for path in candidates if path.exists()), None)


def searched() -> str:
    """Return where `find_resource` searches for models, for messages."""
    return f"{', '.join(VARIABLES[:3])}, beside the world, and in models there and above"


def _folders(files: Sequence[Path]) -> Iterator[Path]:
    for variable in VARIABLES:
        yield from (Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder)
    for file in files:
        for folder in list(file.resolve().parents)[: _LEVELS + 1]:
            yield folder
            yield folder / "models"
    for variable in PACKAGES:
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield from (Path(folder) / "share", Path(folder))


def _downloaded(host: str, path: str) -> Iterator[Path]:
    """Yield where Gazebo keeps a model from its model library; the newest version first."""
    found = re.fullmatch(r"/(?:[\d.]+/)?([^/]+)/models/([^/]+)(?:/[^/]+)?/?", path)
    if not found:
        return
    caches = [os.environ.get(name) for name in ("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH")]
    for cache in filter(None, (*caches, Path.home() / ".gz" / "fuel", Path.home() / ".ignition" / "fuel")):
        folder = Path(cache) / host / found[1].lower() / "models" / found[2].lower()
        versions = [part for part in folder.iterdir() if part.name.isdecimal()] if folder.is_dir() else []
        yield from sorted(versions, key=lambda part: -int(part.name))
