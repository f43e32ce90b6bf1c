"""Files: what is read has an end and a limit, what is written is there as a whole or not at all.

Any JSON or YAML; noise models, robots, fixes, filters and LiDARs, written and read without code. A file of parameters is YAML
with the fields of `turtlebot_gym.Noise`, `Robot`, `FixNoise`, `FilterTuning` or `Lidar`; others keep their defaults::

    process: {alpha1: 0.01, alpha4: 0.02}
    odometry: {R: [0.0009, 0.0009, 0.0025], dropout_probability: 0.1}
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache, partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, TypeVar

from turtlebot_gym.bounded import bounded
from turtlebot_gym.parameters import KINDS, FilterTuning, FixNoise, Noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.validation import build, choose

if TYPE_CHECKING:
    from numpy.typing import NDArray

SUFFIXES = (".yaml", ".yml")
"""File name endings."""

MAX_DEPTH, MAX_VALUES = 100, 100_000
"""How deep the contents of a file may be nested, and how many values a YAML file may have."""
LARGEST, LARGEST_LOG, SMALL = 2**26, 2**29, 2**18
"""Largest file that is read as a whole, largest log of text, and largest file that no parser can take long for, bytes."""

T = TypeVar("T")
F = TypeVar("F", bound="Callable[..., Any]")

_TOO_DEEP = f"it is nested deeper than {MAX_DEPTH} levels"
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
_WITH_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+")


def kind_of(kind: type) -> str:
    """Return what messages call a class of parameters: "robot", "noise", "fix" for `FixNoise`."""
    return kind.__name__.removesuffix("Noise").removesuffix("Tuning").lower() or "noise"


def is_file(name: object) -> TypeGuard[str | Path]:
    """Return whether a name is that of a file."""
    return isinstance(name, Path) or (isinstance(name, str) and name.endswith(SUFFIXES))


def read_parameters(kind: type[T], path: str | Path) -> T:
    """Read a noise model, a robot, a fix or a filter.

    Args:
        kind: `turtlebot_gym.Noise`, `turtlebot_gym.Robot`, `turtlebot_gym.FixNoise` or `turtlebot_gym.FilterTuning`.
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
        if kind is FilterTuning and isinstance(content, Mapping) and "P0" in content and not content.get("from_origin"):
            raise ValueError("filter: P0 is read with from_origin: true only: add that, or leave out P0.")
        return build(kind, content, kind_of(kind))
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error


def write_parameters(value: Noise | Robot | FixNoise | FilterTuning, path: Path, *, comment: str = "") -> None:
    """Write a noise model, a robot, a fix or a filter below a comment; `read_parameters` reads the same value back.

    Raises:
        ValueError: If the filter is code, such as a class of one's own.
    """
    import yaml

    lines = [f"# {line}".rstrip() + "\n" for line in comment.splitlines()]
    content = asdict(value)
    if isinstance(value, FilterTuning):
        name = choose("FilterTuning.kind", type(value.kind).__name__, {known: known for known in KINDS})
        content["kind"] = {"name": name, **content["kind"]}
        if not value.from_origin:
            del content["P0"]
    text = yaml.safe_dump(_plain(content), sort_keys=False, default_flow_style=None)
    write_text(path, "".join(lines) + text)


def _plain(value: Any) -> Any:
    """Return a value with tuples replaced by lists, for YAML."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def regular(path: str | Path) -> Path:
    """Return the path of a file, also by a link; a ``ValueError`` refuses what may have no end, such as a pipe or a device."""
    path = Path(path)
    kind = stat.S_IFMT(path.stat().st_mode)
    if kind != stat.S_IFREG:
        raise ValueError(f"{path}: it is {_KINDS.get(kind, 'a device')}; save what it holds as a file, and give that.")
    return path


def in_bounds(read: F) -> F:
    """Return a reader, whose first argument is the path of a file or of a folder of files, that is `bounded`."""

    @wraps(read)
    def within(path: str | Path, *args: Any, **options: Any) -> Any:
        path = Path(path)
        parts = path.iterdir() if path.is_dir() else (path,)
        size = sum(regular(part).stat().st_size for part in parts if part.exists() and not part.is_dir())
        return bounded(partial(read, path, *args, **options), path, size=size)

    return within  # pyright: ignore[reportReturnType]


def read_bytes(path: str | Path, *, most: int = LARGEST) -> bytes:
    """Return what a file holds; a ``ValueError`` refuses what is no file, or holds more bytes."""
    size = regular(path).stat().st_size
    if size > most:
        raise ValueError(f"{path}: it has {size / 1e6:,.0f} MB; at most {most / 1e6:,.0f} MB are read.")
    with open(path, "rb") as file:
        return file.read(size)


def read_text(path: str | Path, *, most: int = LARGEST, errors: str = "strict") -> str:
    """Return what a file of text holds, without a byte order mark; see `read_bytes` and ``bytes.decode``."""
    return read_bytes(path, most=most).decode("utf-8-sig", errors)


def require_small(path: str | Path) -> None:
    """Refuse a zip file, with a ``ValueError``, that unpacks to more than 4 * `LARGEST` bytes."""
    with zipfile.ZipFile(regular(path)) as archive:
        unpacked, most = sum(part.file_size for part in archive.infolist()), 4 * LARGEST
    if unpacked > most:
        raise ValueError(f"unpacked it has {unpacked / 1e6:,.0f} MB; at most {most / 1e6:,.0f} MB are read")


def read_arrays(path: str | Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an ``.npz`` file by their names; nothing in it is run.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no file or damaged, or its arrays have more than 4 * `LARGEST` bytes; the message names the file.
    """
    import numpy as np

    try:
        require_small(path)
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, MemoryError):
        raise
    except Exception as error:  # each part of a zip file that is damaged raises another error
        raise ValueError(f"{path}: {' '.join(str(error).split())}.") from error


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, which replaces the file when the block ends without an error.

    The file's folder is created if missing. A link stays a link, and permissions stay as they are; a device or a pipe is
    written to directly. Processes on several machines may do so at once: each has its own temporary file, and the last wins.
    """
    path = Path(path)
    if path.exists() and (not path.is_file() or path.parent in (Path("/dev"), Path("/dev/fd"))):
        yield path
        return
    target = Path(os.path.realpath(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    # Of this process alone: others may write the same file.
    beside = target.with_name(f".{target.stem[:99]}.{platform.node()}-{os.getpid()}.new{target.suffix}")
    try:
        yield beside
        with beside.open("rb+") as file:
            os.fsync(file.fileno())
        if target.exists():
            shutil.copymode(target, beside)
        beside.replace(target)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Write a file of text as a whole or not at all; see `replacing`."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


def load(path: str | Path) -> Any:
    """Return the contents of a file: JSON if it ends in .json, otherwise YAML.

    Numbers such as 1e-3 and 1e6, which YAML 1.1 takes for text, are numbers; 1e6 is a whole one.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is something else, nested too deep or too large; the message is one line and names the file.
        ImportError: If it is YAML and PyYAML is not installed.
    """
    path = Path(path)
    return (_load if regular(path).stat().st_size <= SMALL else in_bounds(_load))(path)


def _load(path: Path) -> Any:
    kind, read = ("JSON", _from_json) if path.suffix == ".json" else ("YAML", _from_yaml)
    content = read_bytes(path)
    try:
        return read(content.decode("utf-8"))
    except ImportError as error:
        raise ImportError(f"{path} needs PyYAML: pip install pyyaml") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not {kind}: it is no text: {error.reason} at byte {error.start}.") from error
    except RecursionError as error:
        raise ValueError(f"{path} is not {kind}: {_TOO_DEEP}.") from error
    except MemoryError:
        raise
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


def parse_yaml(text: str) -> Any:
    """Return the value that a text in YAML is, as `load` reads a file.

    Raises:
        ValueError: If it is something else; the message is one line.
    """
    try:
        return _from_yaml(text)
    except ImportError:
        raise
    except Exception as error:  # PyYAML raises many kinds of errors
        raise ValueError(f"it is not YAML: {' '.join(str(error).split())}.") from error


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
