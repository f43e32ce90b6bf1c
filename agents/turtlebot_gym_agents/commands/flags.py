"""Flags of commands, made from the options of environments: one declaration of name, default and text for both.

The declaration is read as text: importing it takes numba, which ``--help`` need not wait for.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Sequence
from dataclasses import field, make_dataclass
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, NamedTuple, TypeVar, Union

import tyro

import turtlebot_gym
from turtlebot_gym import parameters

T = TypeVar("T")


def own_first(cls: type[T]) -> type[T]:
    """Put a dataclass's own fields before those that it inherits, for its --help."""
    made: Any = cls
    known = made.__dataclass_fields__
    made.__dataclass_fields__ = {name: known[name] for name in dict.fromkeys([*inspect.get_annotations(cls), *known])}
    return cls


def flags(*names: str, several: Sequence[str] = (), **defaults: Any) -> Any:
    """Return a base class for commands whose fields are options of environments.

    Args:
        *names: The options.
        several: Options for which the command takes several values.
        **defaults: Further options, with another default than the environment's.
    """
    made = []
    for name in (*several, *names, *defaults):
        kinds, usual, text = OPTIONS[name]
        default: Any = defaults.get(name, usual)
        kind: Any = tuple[kinds[0], ...] if name in several else Union[(*kinds, *([NoneType] if default is None else []))]
        default = (default,) if name in several else default
        made.append((name, Annotated[kind, tyro.conf.arg(help=text)], field(default=default)))
    return make_dataclass("Flags", made, frozen=True, kw_only=True)


class _Declared(NamedTuple):
    kinds: tuple[type, ...]
    """Types that a command line can give."""
    default: Any
    text: str
    """The text under it, up to what can be given in Python alone."""


def _declared() -> dict[str, _Declared]:
    source = Path(turtlebot_gym.__file__).parent / "systems" / "options.py"
    (body,) = (
        node.body
        for node in ast.parse(source.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and node.name == "Options"
    )
    declared = {}
    # A field is followed by its text.
    for line, below in pairwise(body):
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and isinstance(below, ast.Expr):
            names = ast.unparse(line.annotation).split(" | ")
            kinds = tuple(kind for kind in (str, int, float) if kind.__name__ in names)
            text = " ".join(inspect.cleandoc(ast.literal_eval(below.value)).split())
            usual: Any = line.value
            default = getattr(parameters, usual.id) if isinstance(usual, ast.Name) else ast.literal_eval(usual)
            declared[line.target.id] = _Declared(kinds, default, text.partition("; in Python")[0].rstrip(".") + ".")
    return declared


OPTIONS = _declared()
"""The options of environments."""
