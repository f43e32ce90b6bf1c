"""Flags of commands, made from the options of environments and trainings: one declaration of name, default and text for both.

The declarations are read as text: importing them takes numba, which ``--help`` need not wait for.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Sequence
from dataclasses import field, make_dataclass
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, NamedTuple, TypeVar, Union

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

import turtlebot_gym
from turtlebot_gym import parameters

T = TypeVar("T")


def own_first(cls: type[T]) -> type[T]:
    """Put a dataclass's own fields and its `flags` before other inherited ones, for its --help."""
    made: Any = cls  # tyro takes the fields in the order in which the class has them
    every = made.__dataclass_fields__
    first = [
        name
        for part in (cls, *cls.__bases__)
        if part is cls or part.__name__ == "Flags"
        for name in inspect.get_annotations(part)
    ]
    made.__dataclass_fields__ = {name: every[name] for name in dict.fromkeys([*first, *every])}
    return cls


def flags(*names: str, several: Sequence[str] = (), **defaults: Any) -> Any:
    """Return a base class for commands whose fields are options of environments or trainings.

    Args:
        *names: The options.
        several: Options for which the command takes several values.
        **defaults: Further options, with another default than the declared one.
    """
    made = []
    for name in (*several, *names, *defaults):
        kinds, usual, text = (OPTIONS | TRAINING)[name]
        default: Any = defaults.get(name, usual)
        kind: Any = tuple[kinds[0], ...] if name in several else Union[(*kinds, *([NoneType] if default is None else []))]
        default = (default,) if name in several else default
        made.append((name, Annotated[kind, tyro.conf.arg(help=text, **_SHOWN.get(name, {}))], field(default=default)))
    return make_dataclass("Flags", made, frozen=True, kw_only=True)


class _Declared(NamedTuple):
    kinds: tuple[type, ...]
    """Types that a command line can give."""
    default: Any
    text: str
    """The text under it, up to the part about Python only."""


def _declared(source: Path, owner: str) -> dict[str, _Declared]:
    """Return the fields of a class in a file."""
    (body,) = (
        node.body
        for node in ast.parse(source.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and node.name == owner
    )
    declared = {}
    # A field is followed by its text; a computed one, with a call instead of a default, is not an option.
    for line, below in pairwise(body):
        if not isinstance(line, ast.AnnAssign) or isinstance(line.value, ast.Call):
            continue
        if isinstance(line.target, ast.Name) and isinstance(below, ast.Expr):
            names = re.sub(r"Annotated\[([^,]*),.*", r"\1", ast.unparse(line.annotation)).split(" | ")
            kinds = tuple(kind for kind in (str, int, float, bool) if kind.__name__ in names) or (Path,)
            text = " ".join(inspect.cleandoc(ast.literal_eval(below.value)).split())
            usual: Any = line.value
            default = getattr(parameters, usual.id) if isinstance(usual, ast.Name) else ast.literal_eval(usual)
            declared[line.target.id] = _Declared(kinds, default, text.partition("; in Python")[0].rstrip(".") + ".")
    return declared


OPTIONS = _declared(Path(turtlebot_gym.__file__).parent / "systems" / "options.py", "Options")
"""The options of environments."""
TRAINING = _declared(Path(__file__).parents[1] / "training" / "config.py", "TrainingConfig")
"""Those of trainings."""
_SHOWN: dict[str, Any] = {"from_policy": {"name": "from", "metavar": "POLICY"}, "config": {"metavar": "FILE"}}

REGISTRY = ConstructorRegistry()
"""How the command line reads whole numbers: 1000000, 1_000_000 or 1e6."""


@REGISTRY.primitive_rule
def _whole(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    if info.type is not int:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: read_whole(words[0]),
        is_instance=lambda value: isinstance(value, int) and not isinstance(value, bool),
        str_from_instance=lambda value: [str(value)],
    )


def read_whole(text: str) -> int:
    """Return a whole number, also one like 1e6 or 2.5e3.

    Raises:
        ValueError: If it is something else.
    """
    try:
        return int(text)
    except ValueError:
        number = float(text)
        if not number.is_integer() or abs(number) > 2**53:
            raise ValueError(f"{text} is not a whole number.") from None
        return int(number)
