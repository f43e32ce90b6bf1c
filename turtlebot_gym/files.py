"""Noise models, robots and fixes in files, so that a robot of one's own needs no edit of the source, on the robot either.

A file is YAML, with the fields of `turtlebot_gym.Noise`, `Robot` or `FixNoise`; what is left out is at its default::

    process: {alpha1: 0.01, alpha4: 0.02}
    odometry: {R: [0.0009, 0.0009, 0.0025], dropout_probability: 0.1}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from turtlebot_gym.parameters import FixNoise, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.robots import Robot

SUFFIXES = (".yaml", ".yml")
"""What a file's name ends with."""
_PARTS = {"process": ProcessNoise, "odometry": OdometryNoise}

KINDS = {Robot: "robot", Noise: "noise", FixNoise: "fix"}
"""What may be in a file, as messages call it."""

T = TypeVar("T", Noise, Robot, FixNoise)


def is_file(name: object) -> TypeGuard[str | Path]:
    """Return whether a name is one of a file."""
    return isinstance(name, Path) or (isinstance(name, str) and name.endswith(SUFFIXES))


def read_parameters(kind: type[T], path: str | Path) -> T:
    """Read a noise model, a robot or a fix.

    Args:
        kind: `turtlebot_gym.Noise`, `turtlebot_gym.Robot` or `turtlebot_gym.FixNoise`.
        path: The file.

    Raises:
        ValueError: If there is no such file, it is no YAML, it has other fields, or a value breaks a rule; the message names
            file and field.
        ImportError: If PyYAML is not installed.
    """
    return _made(kind, _read(Path(path), KINDS[kind]), str(path))


def write_parameters(value: Noise | Robot | FixNoise, path: Path, *, comment: str = "") -> None:
    """Write a noise model, a robot or a fix, with a comment above; `read_parameters` returns the same again."""
    import yaml

    lines = [f"# {line}".rstrip() + "\n" for line in comment.splitlines()]
    text = yaml.safe_dump(_plain(asdict(value)), sort_keys=False, default_flow_style=None)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(lines) + text, encoding="utf-8")


def _plain(value: Any) -> Any:
    """Return a value with lists for tuples, which YAML knows."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def load_yaml(path: Path) -> Any:
    """Return what a YAML file says.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no YAML; the message says on one line why not.
        ImportError: If PyYAML is not installed.
    """
    try:
        import yaml  # only files need it
    except ImportError as error:
        raise ImportError(f"{path} needs PyYAML: pip install pyyaml") from error

    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(" ".join(str(error).split())) from error


def _read(path: Path, what: str) -> Any:
    try:
        return load_yaml(path)
    except OSError as error:
        raise ValueError(f"There is no {what} file {str(path)!r}, or it cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise ValueError(f"{path} is no YAML: {error}.") from error


def _made(kind: type[Any], said: Any, where: str) -> Any:
    """Return parameters from what a file says of them."""
    known = {item.name: item for item in fields(kind)}
    if not isinstance(said, Mapping):
        raise ValueError(f"{where} must hold fields of {kind.__name__}, {', '.join(known)}, got {said!r}.")
    unknown = [str(name) for name in said if name not in known]
    if unknown:
        raise ValueError(f"{where}: {kind.__name__} has no {', '.join(unknown)}; it has {', '.join(known)}.")
    values = {}
    for name, value in said.items():
        if kind is Noise:
            values[name] = _made(_PARTS[name], value, f"{where}, {name}")
        else:
            values[name] = _value(value, str(known[name].type), f"{where}: {kind.__name__}.{name}")
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error


def _value(value: Any, type_name: str, where: str) -> Any:
    """Return a field's value; text that is a number counts, because YAML takes 1e-3 for text."""
    if type_name == "bool":
        if not isinstance(value, bool):
            raise ValueError(f"{where} must be true or false, got {value!r}.")
        return value
    many = isinstance(value, list)
    if many != type_name.startswith("tuple"):
        raise ValueError(f"{where} must be {'one number' if many else 'a list of numbers'}, got {value!r}.")
    numbers = []
    for item in value if many else [value]:
        try:
            numbers.append(float("nan" if isinstance(item, bool) else item))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{where} must hold numbers, got {item!r}.") from error
    return tuple(numbers) if many else numbers[0]
