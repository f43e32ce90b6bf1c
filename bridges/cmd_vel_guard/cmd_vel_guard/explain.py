"""The text of a node's ``--help``: its docstring and its parameters. Does not depend on ROS."""

from __future__ import annotations

import ast
import inspect
from dataclasses import MISSING, fields
from itertools import pairwise
from textwrap import dedent, fill


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


def explain(program: str, docstring: str | None, *kinds: type) -> str:
    """Return the help of a node: how it is started, what it does, and its parameters, by their dataclasses."""
    texts = {name: text for kind in kinds for name, text in descriptions(kind).items()}
    defaults = {item.name: item.default for kind in kinds for item in fields(kind) if item.default is not MISSING}
    lines = [f"usage: {program} [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...]", "", inspect.cleandoc(docstring or "")]
    lines += ["", "parameters, with their defaults:"]
    for name, default in defaults.items():
        shown = str(default).lower() if isinstance(default, bool) else default if default != "" else '""'
        lines += [f"  {name}:={shown}", fill(texts.get(name, ""), 120, initial_indent=" " * 6, subsequent_indent=" " * 6)]
    return "\n".join(lines)
