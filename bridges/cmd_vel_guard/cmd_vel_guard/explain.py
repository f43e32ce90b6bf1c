"""The text of a node's ``--help``: its docstring and its parameters. Does not depend on ROS."""

from __future__ import annotations

import inspect
from dataclasses import MISSING, fields
from textwrap import fill

from turtlebot_gym.docstrings import texts_of


def explain(program: str, docstring: str | None, *kinds: type) -> str:
    """Return the help of a node: how it is started, what it does, and its parameters, by their dataclasses."""
    texts = {name: text for kind in kinds for name, text in texts_of(kind).items()}
    defaults = {item.name: item.default for kind in kinds for item in fields(kind) if item.default is not MISSING}
    lines = [f"usage: {program} [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...]", "", inspect.cleandoc(docstring or "")]
    lines += ["", "parameters, with their defaults:"]
    for name, default in defaults.items():
        shown = str(default).lower() if isinstance(default, bool) else default if default != "" else '""'
        lines += [f"  {name}:={shown}", fill(texts.get(name, ""), 120, initial_indent=" " * 6, subsequent_indent=" " * 6)]
    return "\n".join(lines)
