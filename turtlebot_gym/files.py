"""Files: JSON, YAML and objects of a module are read, what is written is there as a whole or not at all."""

from __future__ import annotations

import json
import os
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeGuard

SUFFIXES = (".yaml", ".yml")
"""File name endings of parameters."""


def is_file(name: object) -> TypeGuard[str | Path]:
    """Return whether a name is that of a file of parameters."""
    return isinstance(name, Path) or (isinstance(name, str) and name.endswith(SUFFIXES))


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, which replaces the file when the block ends without an error.

    The file's folder is created if missing. A device or a pipe is written to directly.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        yield path
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.stem[:99]}.{os.getpid()}.new{path.suffix}")
    try:
        yield beside
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a file of text as a whole or not at all."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


def load(path: str | Path) -> Any:
    """Return the contents of a file: JSON if it ends in .json, otherwise YAML; a ``ValueError`` of one line names the file."""
    kind, parse = ("JSON", json.loads) if Path(path).suffix == ".json" else ("YAML", parse_yaml)
    try:
        return parse(Path(path).read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: it is not {kind}: {' '.join(str(error).split())}") from error


def parse_yaml(text: str) -> Any:
    """Return the value that a text in YAML is; 1e-3, which YAML 1.1 takes for text, is a number, and 1e6 a whole one."""
    import yaml  # needed for files only

    try:
        return yaml.load(text, _yaml_loader())
    except Exception as error:  # PyYAML raises many kinds of errors for a tag on what it is not for
        raise ValueError(" ".join(str(error).split())) from error


@cache
def _yaml_loader() -> Any:
    import yaml

    def number(loader: Any, node: Any) -> float:
        value = loader.construct_yaml_float(node)
        return int(value) if "e" in node.value.lower() and value.is_integer() else value

    loader = type("Loader", (yaml.SafeLoader,), {})
    with_exponent = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+")
    loader.add_implicit_resolver("tag:yaml.org,2002:float", with_exponent, list("-+.0123456789"))
    loader.add_constructor("tag:yaml.org,2002:float", number)
    return loader


def read_arrays(path: str | Path) -> dict[str, Any]:
    """Return the arrays of an ``.npz`` file by their names; a ``ValueError`` of one line names a damaged file."""
    import numpy as np

    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except OSError:
        raise
    except Exception as error:  # each part of a zip file that is damaged raises another error
        raise ValueError(f"{path}: {' '.join(str(error).split())}.") from error


def write_parameters(value: Any, path: Path, *, comment: str = "") -> None:
    """Write a noise model, a robot, a fix or a filter below a comment; `turtlebot_gym.config.read_parameters` reads it back."""
    import yaml

    lines = [f"# {line}".rstrip() + "\n" for line in comment.splitlines()]
    content = asdict(value)
    if "kind" in content:  # of a filter, whose class chooses it
        content["kind"] = {"name": type(value.kind).__name__, **content["kind"]}
        if not value.from_origin:
            del content["P0"]
    write_text(path, "".join(lines) + yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def load_object(name: str) -> Any:
    """Import "module:name"; the module may lie in the working folder, where programs that pip or ROS installs do not look."""
    module, _, attribute = name.partition(":")
    if not (attribute and all(map(str.isidentifier, module.split("."))) and not module.endswith(".py")):
        raise ValueError(f"{name!r} must be 'module:name' of a Python module, without folders and .py, such as mine:drive.")
    if not {os.getcwd(), ""} & {*sys.path}:
        sys.path.append(os.getcwd())
    try:
        return getattr(import_module(module), attribute)
    except (ModuleNotFoundError, AttributeError) as error:
        raise ValueError(f"{name!r} cannot be loaded from {os.getcwd()}: {error}.") from error
    except (Exception, SystemExit) as error:
        raise failure(name, error) from error


def failure(name: str, error: BaseException) -> ValueError:
    """Return an error in a user's code, "module:name", as one line with its place."""
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [frame for frame in frames[1:] if "importlib" not in frame.filename and "site-packages" not in frame.filename]
    place, text = (theirs or frames)[-1], str(error)
    if isinstance(error, SyntaxError):
        place, text = error, error.msg
    return ValueError(f"{name}: {type(error).__name__}: {' '.join(text.split())} ({place.filename}, line {place.lineno}).")


def source_of(value: Any, *modules: str) -> str:
    """Return "module:name", by which `load_object` finds an object in one of some imported modules; empty if it is in none."""
    for module in modules:
        for name, other in [*vars(sys.modules[module]).items()] if module in sys.modules else ():
            if type(other) is type(value) and other == value:
                return f"{module}:{name}"
    return ""
