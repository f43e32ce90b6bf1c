"""Files of users: any JSON or YAML, read within bounds; noise models, robots and fixes, written and read without code.

A file of parameters is YAML with the fields of `turtlebot_gym.Noise`, `Robot` or `FixNoise`; others keep their defaults::

    process: {alpha1: 0.01, alpha4: 0.02}
    odometry: {R: [0.0009, 0.0009, 0.0025], dropout_probability: 0.1}
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from turtlebot_gym.parameters import FixNoise, Noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.validation import made

SUFFIXES = (".yaml", ".yml")
"""File name endings."""

MAX_DEPTH, MAX_VALUES = 100, 100_000
"""How deep the contents of a file may be nested, and how many values a YAML file may have."""

T = TypeVar("T")

_TOO_DEEP = f"it is nested deeper than {MAX_DEPTH} levels"
_WITH_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+")


def kind_of(kind: type) -> str:
    """Return what messages call a class of parameters: "robot", "noise", "fix" for `FixNoise`."""
    return kind.__name__.removesuffix("Noise").removesuffix("Tuning").lower() or "noise"


def is_file(name: object) -> TypeGuard[str | Path]:
    """Return whether a name is that of a file."""
    return isinstance(name, Path) or (isinstance(name, str) and name.endswith(SUFFIXES))


def read_parameters(kind: type[T], path: str | Path) -> T:
    """Read a noise model, a robot or a fix.

    Args:
        kind: `turtlebot_gym.Noise`, `turtlebot_gym.Robot` or `turtlebot_gym.FixNoise`.
        path: The file.

    Raises:
        ValueError: If the file does not exist or is not YAML, has unknown fields, or a value breaks a rule; the message names
            file and field.
        ImportError: If PyYAML is not installed.
    """
    try:
        content = load(path)
    except OSError as error:
        raise ValueError(f"There is no {kind_of(kind)} file {str(path)!r}, or it cannot be read: {error.strerror}.") from error
    try:
        return made(kind, content, kind_of(kind))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_parameters(value: Noise | Robot | FixNoise, path: Path, *, comment: str = "") -> None:
    """Write a noise model, a robot or a fix below a comment; `read_parameters` reads the same value back."""
    import yaml

    lines = [f"# {line}".rstrip() + "\n" for line in comment.splitlines()]
    text = yaml.safe_dump(_plain(asdict(value)), sort_keys=False, default_flow_style=None)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(lines) + text, encoding="utf-8")


def _plain(value: Any) -> Any:
    """Return a value with tuples replaced by lists, for YAML."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def load(path: str | Path) -> Any:
    """Return the contents of a file: JSON if it ends in .json, otherwise YAML.

    Numbers such as 1e-3 and 1e6, which YAML 1.1 takes for text, are numbers; 1e6 is a whole one.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is something else, nested too deep or too large; the message is one line and names the file.
        ImportError: If it is YAML and PyYAML is not installed.
    """
    path = Path(path)
    kind, read = ("JSON", _from_json) if path.suffix == ".json" else ("YAML", _from_yaml)
    content = path.read_bytes()
    try:
        return read(content.decode("utf-8"))
    except ImportError as error:
        raise ImportError(f"{path} needs PyYAML: pip install pyyaml") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not {kind}: it is no text: {error.reason} at byte {error.start}.") from error
    except RecursionError as error:
        raise ValueError(f"{path} is not {kind}: {_TOO_DEEP}.") from error
    except Exception as error:  # PyYAML raises many kinds of errors for a tag on what it is not for
        raise ValueError(f"{path} is not {kind}: {' '.join(str(error).split())}.") from error


def _from_json(text: str) -> Any:
    content = json.loads(text)
    level = [content]
    for _ in range(MAX_DEPTH):
        parts = (part.values() if isinstance(part, dict) else part for part in level if isinstance(part, (dict, list)))
        level = [item for part in parts for item in part]
    if level:
        raise ValueError(_TOO_DEEP)
    return content


def _from_yaml(text: str) -> Any:
    import yaml

    return yaml.load(text, _yaml_loader())


@cache
def _yaml_loader() -> Any:
    """Return PyYAML's safe loader with bounds."""
    import yaml  # needed for files only

    class Loader(yaml.SafeLoader):
        """Refuses what is nested too deep, or grows too large by aliases."""

        def __init__(self, stream: Any) -> None:
            super().__init__(stream)
            self.depth, self.values, self.sizes = 0, 0, {}

        def compose_node(self, parent: Any, index: Any) -> Any:
            before, repeats = self.values, self.check_event(yaml.AliasEvent)
            self.depth, self.values = self.depth + 1, self.values + 1
            if self.depth > MAX_DEPTH:
                raise ValueError(_TOO_DEEP)
            node = super().compose_node(parent, index)
            if repeats:  # inside of what it repeats an alias would have no end: that has no size yet
                self.values += self.sizes.get(id(node), MAX_VALUES)
            else:
                self.sizes[id(node)] = self.values - before
            if self.values > MAX_VALUES:
                raise ValueError(f"it has more than {MAX_VALUES:,} values")
            self.depth -= 1
            return node

    def number(loader: Any, node: Any) -> float:
        value = loader.construct_yaml_float(node)
        return int(value) if "e" in node.value.lower() and value.is_integer() else value

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", _WITH_EXPONENT, list("-+.0123456789"))
    Loader.add_constructor("tag:yaml.org,2002:float", number)
    return Loader
