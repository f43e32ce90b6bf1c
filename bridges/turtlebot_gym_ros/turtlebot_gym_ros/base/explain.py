"""The text of a node's ``--help``: what it does, and its parameters. Does not depend on ROS."""

from __future__ import annotations

import ast
import inspect
import re
import shutil
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, fields
from itertools import pairwise
from textwrap import dedent
from typing import Any, NamedTuple

WIDTH = 120
"""Width of a text that goes to no terminal, characters."""


class Setting(NamedTuple):
    """A parameter of a node."""

    name: str
    default: str
    text: str
    """Its meaning, with its unit."""


def descriptions(kind: type) -> dict[str, str]:
    """Return the docstring under each field of a class, on one line; empty if the source is not available."""
    try:
        (made,) = ast.parse(dedent(inspect.getsource(kind))).body
    except (OSError, TypeError, SyntaxError):  # TypeError: of a module without a file
        return {}
    assert isinstance(made, ast.ClassDef)
    return {
        item.target.id: " ".join(text.value.value.split())
        for item, text in pairwise(made.body)
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def plain(text: str) -> str:
    """Return a docstring without its markup, on one line."""
    return " ".join(re.sub(r"`+([^`]*)`+", r"\1", text).split())


def brief(text: str) -> str:
    """Return the first sentence of a docstring, without markup and full stop: the comment of a parameter in a YAML file."""
    return re.split(r"\.(?=\s+[A-Z\"]|$)", plain(text), maxsplit=1)[0]


def parameters_of(*classes: type) -> list[Setting]:
    """Return the parameters that dataclasses declare; of two with the same name the later one counts."""
    found = {}
    for owner in classes:
        texts = descriptions(owner)
        for item in fields(owner):
            default: Any = item.default if item.default_factory is MISSING else item.default_factory()
            found[item.name] = Setting(item.name, _shown(default), brief(texts.get(item.name, "")))
    return list(found.values())


def _shown(value: Any) -> str:
    """Return a value as ROS's command line takes it."""
    return str(value).lower() if isinstance(value, bool) else '""' if value == "" else str(value)


def explain(program: str, docstring: str | None, parameters: Sequence[Setting]) -> str:
    """Return the help of a node.

    Args:
        program: How it is started: "python -m turtlebot_gym_ros kalman_filter".
        docstring: What it does, in its first paragraph, and in the one that begins with "Inputs" its topics.
        parameters: Its parameters.
    """
    width = shutil.get_terminal_size((WIDTH, 24)).columns
    first, *others = inspect.cleandoc(docstring or "").split("\n\n")
    lines = [f"usage: {program} [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...]", "", *textwrap.wrap(plain(first), width)]
    for topics in (text for text in others if text.startswith("Inputs")):
        lines += ["", *textwrap.wrap(plain(topics.partition("Parameters:")[0]), width)]
    named = [(f"{setting.name}:={setting.default}", f"{setting.text}.") for setting in parameters]
    return "\n".join([*lines, "", "parameters, with their defaults:", *_table(named, width)])


def _table(rows: Sequence[Iterable[str]], width: int) -> list[str]:
    """Return rows as lines in columns, of which the last is wrapped."""
    cells = [tuple(row) for row in rows]
    sizes = [max(map(len, column)) for column in zip(*cells, strict=True)][:-1]
    lines = []
    for *heads, text in cells:
        head = "  " + "".join(f"{cell:<{size}}  " for cell, size in zip(heads, sizes, strict=True))
        rest = max(width - len(head), 30)
        first, *more = textwrap.wrap(text, rest, break_long_words=False, break_on_hyphens=False) or [""]
        lines += [(head + first).rstrip(), *(" " * len(head) + line for line in more)]
    return lines
