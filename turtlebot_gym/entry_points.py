"""Commands of the satellites: entry points of a group, dataclasses with ``run()``, which are found without an import."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import Any


@cache  # a look at the metadata of all installed packages takes 40 ms
def _installed(group: str) -> EntryPoints:
    return entry_points(group=group)


def loadable(group: str) -> dict[str, Any]:
    """Return what installed packages offer in a group, by name; what cannot be loaded is left out."""
    found = {}
    for name in sorted(_installed(group).names):
        with suppress(ImportError):
            found[name] = load_entry_point(group, name)
    return found


def load_entry_point(group: str, name: str, *, extra: str = "all") -> Any:
    """Return what an installed package offers in a group; an ``ImportError`` of one line says which extra to install."""
    try:
        return _installed(group)[name].load()
    except (KeyError, ImportError, AttributeError) as error:
        raise ImportError(f"{name} needs the extra [{extra}]: pip install 'turtlebot-gym[{extra}]' ({error}).") from error
