"""Fields of a command as its flags: their words, types, defaults, texts and groups."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from textwrap import dedent
from types import NoneType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import tyro

from turtlebot_gym_agents.outputs import OutputFile

_HIDING = tyro.conf.Suppress[int].__metadata__  # pyright: ignore[reportAttributeAccessIssue]
_POSITIONAL = tyro.conf.Positional[int].__metadata__  # pyright: ignore[reportAttributeAccessIssue]
_METAVARS = {int: "INT", float: "NUMBER", str: "NAME", Path: "FILE"}


class Flag(NamedTuple):
    """A flag of a command, or an argument without one."""

    path: tuple[str, ...]
    """The field, and of one that holds others the field within."""
    word: str
    """What is typed, such as ``--from``; for an argument without a flag its name in capitals."""
    kind: Any
    """The field's type."""
    default: Any
    """The default; `dataclasses.MISSING` if it must be given."""
    text: str
    """The docstring under the field, on one line."""
    metavar: str
    """What stands for its value; empty for a flag without one."""
    group: str
    """The group in which the help shows it; empty for those of the command itself."""

    @property
    def key(self) -> str:
        """The key of an override."""
        return self.word.removeprefix("--").replace("-", "_")

    @property
    def is_positional(self) -> bool:
        return not self.word.startswith("--")


@cache
def flags_of(command: type) -> tuple[Flag, ...]:
    """Return the flags of a command, in the order of its fields."""
    return tuple(_flags(command, ()))


@cache
def texts_of(kind: type) -> dict[str, str]:
    """Return the docstring under each field of a dataclass, on one line, those of its bases included."""
    texts: dict[str, str] = {}
    for one in reversed(kind.__mro__[:-1]):
        try:
            (made,) = ast.parse(dedent(inspect.getsource(one))).body
        except (OSError, TypeError, SyntaxError):  # without its source
            continue
        texts |= {
            item.target.id: " ".join(text.value.value.split())
            for item, text in pairwise(getattr(made, "body", ()))
            if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
            if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
        }
    return texts


def _flags(command: type, path: tuple[str, ...]) -> Iterator[Flag]:
    hints, marked, texts = get_type_hints(command), get_type_hints(command, include_extras=True), texts_of(command)
    for item in fields(command):
        kind, marks = hints[item.name], _marks(marked[item.name])
        if any(mark in _HIDING for mark in marks):
            continue
        if isinstance(kind, type) and is_dataclass(kind):
            yield from _flags(kind, (*path, item.name))
            continue
        settings = [mark for mark in marks if hasattr(mark, "metavar")]
        named = next((one.name for one in settings if one.name), item.name).replace("_", "-")
        metavar = next((one.metavar for one in settings if one.metavar), None) or _metavar(kind)
        is_positional = any(mark in _POSITIONAL for mark in marks)
        word = (metavar if settings else item.name.upper()) if is_positional else f"--{'.'.join((*path, named))}"
        default = item.default if item.default_factory is MISSING else item.default_factory()
        group = "output" if any(isinstance(mark, OutputFile) for mark in marks) else _group(command, item.name)
        yield Flag((*path, item.name), word, kind, default, texts.get(item.name, ""), metavar, group)


def _marks(hint: Any) -> tuple[Any, ...]:
    """Return what stands beside a type in its annotation, at any depth."""
    inner = (mark for part in get_args(hint) for mark in _marks(part)) if get_origin(hint) in (Union, UnionType) else ()
    return (*getattr(hint, "__metadata__", ()), *inner)


def _metavar(kind: Any) -> str:
    """Return what stands for a value of a type."""
    if get_origin(kind) in (Union, UnionType):
        return "|".join(dict.fromkeys(_metavar(part) for part in get_args(kind) if part is not NoneType))
    if get_origin(kind) is Literal:
        return "|".join(map(str, get_args(kind)))
    if get_origin(kind) is tuple:
        first, *rest = get_args(kind)
        return f"{_metavar(first)} ..." if rest == [Ellipsis] else " ".join(map(_metavar, get_args(kind)))
    return "" if kind is bool else _METAVARS.get(kind, "VALUE")


def _group(command: type, name: str) -> str:
    """Return the group of the first class that declares a field, base classes first."""
    owners = (one for one in reversed(command.__mro__) if name in vars(one).get("__annotations__", {}))
    return next((vars(one)["GROUP"] for one in owners if "GROUP" in vars(one)), "")
