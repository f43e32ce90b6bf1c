"""Files of machine code, which all processes, checkouts and virtual environments of a user share.

The name of a file holds a hash of everything that its content is made of: LLVM's text, the compiler and the processor.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from turtlebot_gym.files import replacing

LONGEST = 60 * 86400.0
"""Time without use after which a file is removed, s."""


def folder() -> Path:
    """Return the folder of the cache: in TURTLEBOT_GYM_CACHE_DIR if that is set, otherwise in the user's folder for caches."""
    local = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME")
    return Path(os.environ.get("TURTLEBOT_GYM_CACHE_DIR") or local or Path.home() / ".cache", "turtlebot_gym")


def kept(name: str, made_of: str, make: Callable[[], bytes]) -> bytes:
    """Return the content of a file, or make it and write the file; two processes that start together both make it.

    Args:
        name: A name for people.
        made_of: Everything that the content is made of, except for this package's compiler, Python and the processor.
        make: Returns the content.
    """
    hashed = hashlib.sha256(f"{made_of} {_maker()}".encode()).hexdigest()
    path = folder() / f"{name.replace(' ', '-')}-{hashed[:32]}.bin"
    with suppress(OSError):
        checksum, content = (whole := path.read_bytes())[:32], whole[32:]
        if checksum == hashlib.sha256(content).digest():  # otherwise the disk has damaged the file
            os.utime(path)  # in use
            return content
    content = make()
    with suppress(OSError):  # the folder is not writable, or the disk is full
        with replacing(path) as beside:  # at once, so that nobody reads a part of it
            beside.write_bytes(hashlib.sha256(content).digest() + content)
        for other in path.parent.iterdir():
            if time.time() - other.stat().st_mtime > LONGEST:
                other.unlink(missing_ok=True)
    return content


@cache
def _maker() -> str:
    """Return the makers of machine code: this folder, the versions and the processor."""
    import llvmlite

    from turtlebot_gym.compiled.native import processor

    sources = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    return f"{hashlib.sha256(b''.join(sources)).hexdigest()} {sys.version} {llvmlite.__version__} {processor()}"
