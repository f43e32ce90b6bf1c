"""Files that are either the old one or the new one, and whole, whenever the process is killed."""

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
    """Yield the path of a file beside this one; it takes this one's place when the block ends without an error.

    Processes on several machines may do so at once: each has a file of its own, and the last one wins.
    """
    beside = path.with_name(f".{path.name}.{platform.node()}-{os.getpid()}.new")
    try:
        yield beside
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def replace_json(path: Path, content: Any) -> None:
    """Write what consists of JSON's own types."""
    with replacing(path) as beside:
        beside.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
