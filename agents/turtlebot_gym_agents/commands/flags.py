"""Flags of commands, made from the options of environments: one declaration of name, default and text for both."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Sequence
from dataclasses import field, fields, make_dataclass
from functools import cache
from itertools import pairwise
from types import NoneType
from typing import Annotated, Any, TypeVar, Union, get_args, get_type_hints

import tyro

from turtlebot_gym.systems.options import Options

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
        several: Options of which a command takes several values.
        **defaults: Further options, with another default than the environment's.
    """
    hints, texts = get_type_hints(Options), _texts()
    usual = {item.name: item.default for item in fields(Options)}
    made = []
    for name in (*several, *names, *defaults):
        default: Any = defaults.get(name, usual[name])
        kinds = [kind for kind in get_args(hints[name]) or (hints[name],) if kind in (str, int, float)]
        kind: Any = tuple[kinds[0], ...] if name in several else Union[(*kinds, *([NoneType] if default is None else []))]
        default = (default,) if name in several else default
        made.append((name, Annotated[kind, tyro.conf.arg(help=texts[name])], field(default=default)))
    return make_dataclass("Flags", made, frozen=True, kw_only=True)


@cache
def _texts() -> dict[str, str]:
    """Return the text under each option, up to what can be given in Python alone."""
    body = ast.parse(inspect.getsource(Options)).body[0].body  # pyright: ignore[reportAttributeAccessIssue]
    texts = {}
    for line, below in pairwise(body):
        if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name) and isinstance(below, ast.Expr):
            text = " ".join(inspect.cleandoc(ast.literal_eval(below.value)).split())
            texts[line.target.id] = text.partition("; in Python")[0].rstrip(".") + "."
    return texts
