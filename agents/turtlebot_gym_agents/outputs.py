"""Output files and folders of a command: checked for writability before the work starts, and never an input.

One rule for all commands. An output is refused before anything starts if it cannot be written, if it is a folder where a file
is needed (or the other way round), if its suffix is wrong, or if it is an input or another output of the same command, even
through a link. A file that exists and is not empty is overwritten only with ``--force``. A file's missing folder is created; a
missing output folder is left to the command. Devices and pipes, such as ``/dev/stdout``, are always accepted.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from itertools import chain, combinations
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints


class OutputFile(NamedTuple):
    """Kind of file or folder that a command writes; in the ``Annotated`` type of the field that names it."""

    endings: tuple[str, ...] = ()
    """Allowed suffixes; empty for any."""
    folder: bool = False
    """Whether it is a folder, which may exist: its command says what may be in it."""
    resumed: bool = False
    """Whether its command resumes what an existing file holds, or refuses it."""


JSON = OutputFile((".json",))
FIGURE = OutputFile((".png", ".pdf", ".svg"))
FOLDER = OutputFile(folder=True)


def require_outputs(
    outputs: Iterable[tuple[str, Path, OutputFile]], *, inputs: Iterable[object] = (), force: bool = False
) -> None:
    """Refuse outputs that cannot or should not be written; missing folders of files are created.

    Args:
        outputs: Option, path and kind of each.
        inputs: Values of the other options: paths, text that may be a path, and sequences of them.
        force: Whether files that exist are overwritten.

    Raises:
        ValueError: With one line that names the option, the path and the rule.
    """
    outputs = list(outputs)
    read = list(chain.from_iterable(map(_paths_in, inputs)))
    for (option, path, _), (other, other_path, _) in combinations(outputs, 2):
        if _same(path, other_path):
            raise ValueError(f"{other} {other_path}: it is the output of {option}, too; choose another name.")
    for option, path, kind in outputs:
        try:
            _require(f"{option} {path}", path, kind, read, force=force)
        except OSError as error:
            raise ValueError(f"{option} {path}: it cannot be written: {error.strerror or error}.") from error


def outputs_of(command: Any) -> Iterator[tuple[str, Path, OutputFile]]:
    """Yield option, path and kind of each output of a command.

    Args:
        command: A dataclass. Its method ``paths(name)``, if it has one, returns the paths that an option stands for.
    """
    for name, kind in _kinds_of(type(command)).items():
        value = getattr(command, name)
        if value is not None:
            paths = command.paths(name) if hasattr(command, "paths") else (value,)
            yield from ((f"--{name.replace('_', '-')}", path, kind) for path in paths)


def inputs_of(command: Any) -> Iterator[object]:
    """Yield the values of a command's other options."""
    written = _kinds_of(type(command))
    yield from (getattr(command, item.name) for item in fields(command) if item.name not in written)


def _kinds_of(command: type) -> Mapping[str, OutputFile]:
    """Return the fields of a command that name outputs, each with its kind."""
    marks = {name: getattr(hint, "__metadata__", ()) for name, hint in get_type_hints(command, include_extras=True).items()}
    return {name: mark for name, metadata in marks.items() for mark in metadata if isinstance(mark, OutputFile)}


def require_file(path: Path) -> None:
    """Check that a file can be written, and create its folder if it is missing.

    Raises:
        OSError: If it cannot be written; ``IsADirectoryError`` for a folder.
    """
    target = Path(os.path.realpath(path))  # the target of a link
    target.parent.mkdir(parents=True, exist_ok=True)
    existed = target.exists()
    with target.open("ab"):
        pass
    if not existed:
        target.unlink()


def _require(where: str, path: Path, kind: OutputFile, inputs: list[Path], *, force: bool) -> None:
    if kind.folder:
        if path.exists() and not path.is_dir():
            raise ValueError(f"{where}: it is a file; a folder is needed.")
        missing = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
        for folder in missing:  # the command creates it again when it has a result
            folder.rmdir()
        return
    if path.exists() and not path.is_file() and not path.is_dir():
        return  # a device or a pipe
    if path.is_dir():
        raise ValueError(f"{where}: it is a folder; a file is needed.")
    if kind.endings and path.suffix.lower() not in kind.endings:
        raise ValueError(f"{where}: its name must end with {' or '.join(kind.endings)}.")
    resolved = path.resolve() if path.exists() else None
    if any(_same(path, read) or (resolved and read.is_dir() and resolved.is_relative_to(read.resolve())) for read in inputs):
        raise ValueError(f"{where}: it is an input of the same command; choose another name.")
    if not force and not kind.resumed and path.exists() and path.stat().st_size > 0:
        raise ValueError(f"{where}: it exists; choose another name, or overwrite it with --force.")
    require_file(path)


def _paths_in(value: object) -> Iterator[Path]:
    """Yield the possible input paths in an option's value."""
    if isinstance(value, (str, Path)):
        text = str(value).removesuffix("+safety")  # which follows the name of a policy
        if text and "\0" not in text:
            yield Path(text)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from _paths_in(part)


def _same(path: Path, other: Path) -> bool:
    """Return whether two paths are the same file, possibly through links."""
    try:
        return os.path.samefile(path, other)
    except OSError:
        return os.path.realpath(path) == os.path.realpath(other)
