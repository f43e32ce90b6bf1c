"""Which page of the reference describes which module, read from the packages' files."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from pkgutil import walk_packages
from typing import NamedTuple

PACKAGES = {
    "turtlebot_gym": "The core: models, filters, tasks, the step as a system, the compiled loop and the environments.",
    "turtlebot_gym_agents": "Policies, evaluation, training and the command line.",
    "turtlebot_gym_ros": "The blocks of the loop, and the shell that turns them into ROS 2 nodes.",
    "turtlebot_gym_lab": "Recordings: readers, calibration and localization; filters compared.",
    "turtlebot_gym_view": "The viewer: episodes and recordings in a browser.",
}
FIRST = (
    "turtlebot_gym.envs",
    "turtlebot_gym.presets",
    "turtlebot_gym.parameters",
    "turtlebot_gym.tasks",
    "turtlebot_gym_agents.policies",
    "turtlebot_gym_agents.evaluation",
    "turtlebot_gym_agents.training",
    "turtlebot_gym_ros.blocks",
)
"""What a reader looks for first; the rest follows by name."""
LINES = 900
"""A package with more lines of source has a page for each module: longer pages are hard to read and to search."""


class Page(NamedTuple):
    """A page of the reference."""

    name: str
    """Full name of the package or module it is about."""
    modules: tuple[str, ...]
    """Modules on the page, beside the package itself; empty for a module's own page."""
    under: tuple[Page, ...]
    """Pages of the modules that have their own."""

    @property
    def path(self) -> str:
        """Where it lies in the documentation."""
        return f"reference/{self.name}.md"


def source(name: str) -> Path:
    """Return the file of a module."""
    spec = find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin)


def headline(name: str) -> str:
    """Return the first sentence of a module's docstring."""
    docstring = ast.get_docstring(ast.parse(source(name).read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n\n")[0].replace("\n", " ")


def pages(package: str) -> tuple[Page, ...]:
    """Return the pages of a package, in the order of the navigation."""
    return tuple(sorted(_pages(package), key=lambda page: (page.name not in FIRST, *_place(page.name), page.name)))


def _pages(package: str) -> Iterator[Page]:
    for module in walk_packages([str(source(package).parent)], f"{package}."):
        if module.name.count(".") != 1 or module.name.endswith("__main__"):
            continue
        if not module.ispkg:
            yield Page(module.name, (), ())
            continue
        inside = [inner.name for inner in walk_packages([str(source(module.name).parent)], f"{module.name}.")]
        if sum(len(source(name).read_text(encoding="utf-8").splitlines()) for name in inside) > LINES:
            yield Page(module.name, (), tuple(Page(name, (), ()) for name in inside))
        else:
            yield Page(module.name, tuple(inside), ())


def _place(name: str) -> tuple[int, ...]:
    return (FIRST.index(name),) if name in FIRST else ()
