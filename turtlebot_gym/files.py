"""Read and write noise models, robots and fixes as files, so that a custom robot needs no edit of the source.

A file is YAML with the fields of `turtlebot_gym.Noise`, `Robot` or `FixNoise`; omitted fields keep their defaults::

    process: {alpha1: 0.01, alpha4: 0.02}
    odometry: {R: [0.0009, 0.0009, 0.0025], dropout_probability: 0.1}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from turtlebot_gym.parameters import FixNoise, Noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.validation import made

SUFFIXES = (".yaml", ".yml")
"""File name endings."""

KINDS = {Robot: "robot", Noise: "noise", FixNoise: "fix"}
"""Names of the possible contents in messages."""

T = TypeVar("T", Noise, Robot, FixNoise)


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
    said = _with_numbers(_read(Path(path), KINDS[kind]))
    try:
        return made(kind, said, KINDS[kind])
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


def load_yaml(path: Path) -> Any:
    """Return the contents of a YAML file.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file is not YAML; the message gives the reason on one line.
        ImportError: If PyYAML is not installed.
    """
    try:
        import yaml  # needed for files only
    except ImportError as error:
        raise ImportError(f"{path} needs PyYAML: pip install pyyaml") from error

    text = path.read_bytes()
    try:
        return yaml.safe_load(text.decode("utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
    except UnicodeDecodeError as error:
        raise ValueError(f"it is no text: {error.reason} at byte {error.start}") from error
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:  # a tag on what it is not for
        raise ValueError(f"a value cannot be read: {type(error).__name__} {' '.join(str(error).split())}") from error


def _read(path: Path, what: str) -> Any:
    try:
        return load_yaml(path)
    except OSError as error:
        raise ValueError(f"There is no {what} file {str(path)!r}, or it cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise ValueError(f"{path} is not YAML: {error}.") from error


def _with_numbers(said: Any) -> Any:
    """Return a file's contents with numeric text converted to numbers: YAML reads 1e-3 as text."""
    if isinstance(said, Mapping):
        return {name: _with_numbers(value) for name, value in said.items()}
    if isinstance(said, list):
        return [_with_numbers(value) for value in said]
    try:
        return float(said) if isinstance(said, str) else said
    except ValueError:
        return said
