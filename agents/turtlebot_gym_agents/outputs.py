"""Output files of a command, which are refused before the work starts if they exist and are not to be overwritten."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints


class OutputFile(NamedTuple):
    """Kind of file that a command writes; in the ``Annotated`` type of a field that names one."""

    endings: tuple[str, ...] = ()
    """Allowed suffixes; empty for any."""


JSON = OutputFile((".json",))
FIGURE = OutputFile((".png", ".pdf", ".svg"))


def require_outputs(
    outputs: Iterable[tuple[str, Path | str | None, OutputFile]], *, inputs: Iterable[object] = (), force: bool = False
) -> None:
    """Refuse files that cannot or should not be written; missing folders are created.

    Args:
        outputs: Option, path and kind of each; None is no output.
        inputs: Values of the other options: files among them, and in their folders, are not overwritten even with force.
        force: Whether files that exist are overwritten.

    Raises:
        ValueError: With one line that names the option, the path and the rule.
        OSError: If a folder cannot be created.
    """
    read = [
        Path(value).resolve() for value in inputs if isinstance(value, (str, Path)) and value != "" and Path(value).exists()
    ]
    for option, given, kind in outputs:
        if given is None:
            continue
        path = Path(given)
        if path.is_dir():
            raise ValueError(f"{option} {path}: it is a folder; a file is needed.")
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            continue  # a device or a pipe
        if kind.endings and path.suffix.lower() not in kind.endings:
            raise ValueError(f"{option} {path}: its name must end with {' or '.join(kind.endings)}.")
        if path.exists() and any(path.resolve() == one or one in path.resolve().parents for one in read):
            raise ValueError(f"{option} {path}: it is an input of the same command; choose another name.")
        if not force and path.exists() and path.stat().st_size > 0:
            raise ValueError(f"{option} {path}: it exists; choose another name, or overwrite it with --force (force=True).")


def outputs_of(command: Any) -> Iterator[tuple[str, Path | None, OutputFile]]:
    """Yield option, path and kind of each output of a command that is a dataclass.

    Its method ``paths(name)``, if it has one, returns the paths that an option stands for.
    """
    for name, hint in get_type_hints(type(command), include_extras=True).items():
        for kind in getattr(hint, "__metadata__", ()):
            if isinstance(kind, OutputFile) and (value := getattr(command, name)) is not None:
                paths = command.paths(name) if hasattr(command, "paths") else (value,)
                yield from ((f"--{name.replace('_', '-')}", path, kind) for path in paths)
