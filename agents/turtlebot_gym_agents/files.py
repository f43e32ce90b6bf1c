"""Atomic file replacement: whenever the process is killed, a file holds its old or its new content, completely."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


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
