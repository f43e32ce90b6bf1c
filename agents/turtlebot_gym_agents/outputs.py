"""Output files of a command, which are refused before the work starts if they exist and are not to be overwritten."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

JSON, FIGURE, HTML = (".json",), (".png", ".pdf", ".svg"), (".html", ".htm")
"""Suffixes that files of a kind may have."""


def require_outputs(
    outputs: Iterable[tuple[str, Path | str | None, tuple[str, ...]]], *, inputs: Iterable[object] = (), force: bool = False
) -> None:
    """Refuse files that cannot or should not be written, each given as option, path or None, and suffixes; make folders.

    Files among ``inputs``, the values of other options, and in their folders, are never overwritten; others that exist only
    with ``force``. A refusal is one line that names the option, the path and the rule.
    """
    read = [
        Path(value).resolve() for value in inputs if isinstance(value, (str, Path)) and value != "" and Path(value).exists()
    ]
    for option, given, endings in outputs:
        if given is None:
            continue
        path = Path(given)
        if path.is_dir():
            raise ValueError(f"{option} {path}: it is a folder; a file is needed.")
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            continue  # a device or a pipe
        if path.suffix.lower() not in endings:
            raise ValueError(f"{option} {path}: its name must end with {' or '.join(endings)}.")
        if path.exists() and any(path.resolve() == one or one in path.resolve().parents for one in read):
            raise ValueError(f"{option} {path}: it is an input of the same command; choose another name.")
        if not force and path.exists() and path.stat().st_size > 0:
            raise ValueError(f"{option} {path}: it exists; choose another name, or overwrite it with --force (force=True).")
