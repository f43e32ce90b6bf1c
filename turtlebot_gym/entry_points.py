"""Commands that satellites and other packages bring, found by group and name.

They are entry points of the group ``turtlebot_gym.commands``, declared in the ``pyproject.toml`` of the package that brings
them: dataclasses with ``run()``, subcommands of ``turtlebot-gym``.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import Any

OWN = "turtlebot_gym_"
"""Prefix of the satellites' packages; what follows is the extra that brings what they need."""


@cache  # a look at the metadata of all installed packages takes 40 ms
def _installed(group: str) -> EntryPoints:
    return entry_points(group=group)


def names_in(group: str) -> tuple[str, ...]:
    """Return the names that installed packages offer in a group, in order; some may fail to load."""
    return tuple(sorted(_installed(group).names))


def loadable(group: str) -> dict[str, Any]:
    """Return what installed packages offer in a group, by name; what cannot be loaded is left out."""
    found = {}
    for name in names_in(group):
        with suppress(ImportError):
            found[name] = load_entry_point(group, name)
    return found


def load_entry_point(group: str, name: str, *, extra: str = "all") -> Any:
    """Return what an installed package offers in a group under a name.

    Args:
        group: Group of entry points.
        name: Name in the group.
        extra: The extra to install if no package offers the name.

    Raises:
        ImportError: If no package offers the name, or its module cannot be imported; the message is one line with the remedy.
    """
    cause = "no installed package offers it"
    for point in _installed(group).select(name=name):
        try:
            return point.load()
        except (ImportError, AttributeError) as error:
            cause, package = str(error), point.module.partition(".")[0]
            if not package.startswith(OWN):
                raise ImportError(f"{name}: {package} cannot be imported ({cause}): install it anew, or remove it.") from error
            extra = package.removeprefix(OWN)
    raise ImportError(f"{name} needs the extra [{extra}]: pip install 'turtlebot-gym[{extra}]' ({cause}).")
