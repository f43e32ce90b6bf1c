"""The fields of a dataclass as keyword arguments of a function, which are flags of its command, too.

`tyro` makes a command of any function with types. Environments take twenty options, which `turtlebot_gym.Options` names and
explains once: `takes` gives a function all of them, and its command a flag for each. A value is YAML, as in
``--noise "{base: rough, odometry: {spike: 0.1}}"``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar

import tyro
from typing_extensions import TypedDict, Unpack
from tyro.constructors import PrimitiveConstructorSpec

from turtlebot_gym import Options
from turtlebot_gym.docstrings import texts_of
from turtlebot_gym.files import parse_yaml

F = TypeVar("F", bound=Callable[..., Any])


def _read(words: list[str]) -> Any:
    values = [parse_yaml(word) for word in words]
    return values[0] if len(values) == 1 else values or True


def _kind(metavar: str, nargs: Any, read: Callable[[list[str]], Any]) -> Any:
    """Return the type of an argument that has any value in Python, and on the command line what a function reads."""
    return PrimitiveConstructorSpec(
        nargs=nargs,
        metavar=metavar,
        instance_from_str=read,
        is_instance=lambda value: True,
        str_from_instance=lambda value: [str(value)],
    )


Value = Annotated[Any, _kind("VALUE", "*", _read)]
"""Type of an argument that is a name, a number, or another value in YAML; several of them are a list, and none is true."""
Text = Annotated[Any, _kind("NAME", 1, lambda words: words[0])]
"""Type of an argument that is a name on the command line, and in Python also an object, such as a policy."""


def keywords(kind: type, *left_out: str, last: Collection[str] = ()) -> Any:
    """Return the fields of a dataclass as keyword arguments, none of which must be given; with some last."""
    texts, types = texts_of(kind), dict[str, Any]()
    for item in sorted(fields(kind), key=lambda item: item.name in last):
        if item.init and item.name not in left_out:
            usual = "" if item.default in (None, MISSING) else f" (default {item.default})"
            types[item.name] = Annotated[Value, tyro.conf.arg(help=f"{texts[item.name]}{usual}")]
    return TypedDict(f"{kind.__name__}Fields", types, total=False)  # pyright: ignore


def takes(kind: type, *left_out: str, last: Collection[str] = ()) -> Callable[[F], F]:
    """Return a decorator that gives the keyword arguments ``options`` of a function the fields of a dataclass, but for some."""

    def typed(function: F) -> F:
        function.__annotations__["options"] = Unpack[keywords(kind, *left_out, last=last)]
        return tyro.conf.configure(tyro.conf.OmitArgPrefixes)(function)

    return typed


if TYPE_CHECKING:
    EnvironmentOptions: TypeAlias = dict[str, Any]
else:
    EnvironmentOptions = keywords(Options, "task")  # the task is that of the environment
