"""Files of machine code, which all processes, checkouts and virtual environments of a user share.

The name of a file holds a hash of all that its machine code is made of.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # Windows: processes that start together compile the same, each for itself
    fcntl = None

MOST_BYTES = 200_000_000
"""Size of the cache above which the least recent files are removed: about 500 functions."""
LONGEST_WAIT = 300.0
"""Longest time to wait for another process that compiles the same function, s."""


def folder() -> Path:
    """Return the folder of the cache: in TURTLEBOT_GYM_CACHE_DIR if that is set, otherwise in the user's folder for caches."""
    if parent := os.environ.get("TURTLEBOT_GYM_CACHE_DIR"):
        return Path(parent, "turtlebot_gym")
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local", "turtlebot_gym", "Cache")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "turtlebot_gym"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "turtlebot_gym")


def path_of(name: str, identity: str) -> Path:
    """Return the file of what has a name and a hash of everything that it is made of."""
    return folder() / f"{name.replace(' ', '-')}-{identity[:32]}.bin"


def kept(name: str, identity: str, load: Callable[[bytes], Any], make: Callable[[], bytes]) -> Any:
    """Return what ``load`` makes of a file, whose content ``make`` returns if there is none, or if it is damaged.

    Args:
        name: What the file holds, for people.
        identity: Hash of everything that it is made of.
        load: Takes the content; an error means that it is damaged.
        make: Takes long: other processes wait for it, and a terminal shows a notice.
    """
    path = path_of(name, identity)
    content = read(path, load)
    if content is not None:
        return content
    lock = lock_of(path.with_suffix(".lock"), name)
    try:
        content = read(path, load)  # another process may have made it meanwhile
        if content is not None:
            return content
        began = time.perf_counter()
        say(f"turtlebot_gym: compiling {name} for this machine, once ... ")
        data = make()
        say(f"{time.perf_counter() - began:.1f} s\n")
        write(path, data)
        return load(data)
    finally:
        release(lock)


def read(path: Path, load: Callable[[bytes], Any]) -> Any:
    """Return what a file holds, None without a whole one."""
    try:
        content = load(path.read_bytes())
        os.utime(path)  # in use: `_tidy` keeps it
    except Exception:  # whatever is wrong with the file, it is made again
        return None
    return content


def write(path: Path, data: bytes) -> None:
    """Write a file of the cache, if the folder is writable."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
            file.write(data)
        os.replace(file.name, path)  # at once, so that nobody reads a part of it
        _tidy(path.parent)


def release(lock: IO[str] | None) -> None:
    """Let other processes go on."""
    if lock is not None:
        with suppress(OSError):
            os.unlink(lock.name)
        lock.close()


def lock_of(path: Path, name: str) -> IO[str] | None:
    """Return a locked file; None if that is impossible in time."""
    if fcntl is None:
        return None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w")
    except OSError:  # the folder is not writable
        return None
    began = time.perf_counter()
    waited = False
    while time.perf_counter() - began < LONGEST_WAIT:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if not waited:
                say(f"turtlebot_gym: waiting for another process, which is compiling {name} ... ")
            waited = True
            time.sleep(0.05)
        except OSError:  # the file system has no locks
            break
        else:
            if waited:
                say(f"{time.perf_counter() - began:.1f} s\n")
            return file
    file.close()
    return None


def _tidy(directory: Path) -> None:
    """Remove the files that were used least recently, if all are larger than `MOST_BYTES`."""
    files = sorted(((status := path.stat()).st_mtime, status.st_size, path) for path in directory.glob("*.bin"))
    excess = sum(size for _, size, _ in files) - MOST_BYTES
    for _, size, path in files:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


def say(text: str) -> None:
    """Write a notice, if somebody watches."""
    if sys.stderr.isatty():
        sys.stderr.write(text)
        sys.stderr.flush()
