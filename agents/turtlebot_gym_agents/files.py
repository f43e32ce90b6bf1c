"""Atomic file replacement: whenever the process is killed, a file holds its old or its new content, completely."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def require_writable(path: Path, endings: tuple[str, ...] = ()) -> None:
    """Make the folder of a file that is to be written, and try whether it can be, before the work that fills it.

    Args:
        path: The file; one that is there keeps its content.
        endings: With which its name may end; none for any.

    Raises:
        ValueError: If its name ends otherwise, or it is a folder.
        OSError: If it cannot be written.
    """
    if endings and path.suffix.lower() not in endings:
        raise ValueError(f"{path}: its name must end with {' or '.join(endings)}.")
    if path.is_dir():
        raise ValueError(f"{path} is a folder; a file is needed.")
    path.parent.mkdir(parents=True, exist_ok=True)
    there = path.exists()
    with path.open("ab"):
        pass
    if not there:
        path.unlink()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, which replaces the file when the block ends without an error.

    Processes on several machines may do so at once: each has its own temporary file, and the last one wins.
    """
    beside = path.with_name(f".{path.name}.{platform.node()}-{os.getpid()}.new")
    try:
        yield beside
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def replace_json(path: Path, content: Any) -> None:
    """Write a value of JSON types."""
    with replacing(path) as beside:
        beside.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
