"""Files of machine code, which all processes, checkouts and virtual environments of a user share.

A file holds one compiled function, and its name a hash of all that its machine code is made of. numba's own cache keeps files
beside the sources, for each checkout its own, and forgets a function whenever its file changes.

numba offers neither such a cache nor the address of a function to others: this module and `turtlebot_gym.inlining` use names of
numba that are not public. With a numba that lacks them each process compiles for itself, and loops run on one thread.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from numba import typeof
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.misc.appdirs import user_cache_dir

try:
    import fcntl
except ImportError:  # Windows: processes that start together compile the same, each for itself
    fcntl = None

MOST_BYTES = 200_000_000
"""Size of the cache above which the least recent files are removed: about 500 functions."""
LONGEST_WAIT = 300.0
"""Longest time to wait for another process that compiles the same function, s."""


def folder() -> Path:
    """Return the folder of the cache: in NUMBA_CACHE_DIR if that is set, otherwise in the user's folder for caches."""
    parent = os.environ.get("NUMBA_CACHE_DIR")
    return Path(parent, "turtlebot_gym") if parent else Path(user_cache_dir("turtlebot_gym", appauthor=False))


def keep(dispatcher: Any, name: str, identity: str) -> None:
    """Let a function of numba load its machine code from the cache, and write there what it compiles.

    Args:
        dispatcher: The function.
        name: What it does, for people.
        identity: Hash of everything that its machine code is made of, except for types and processor.

    Raises:
        AttributeError: If this numba has no such function.
    """
    if not hasattr(dispatcher, "_cache"):
        raise AttributeError("This numba keeps its cache elsewhere.")
    store, compile_now = Store(name, identity), dispatcher.compile
    dispatcher._cache, dispatcher.compile = store, store.released(compile_now)


def address_of(function: Any, *arguments: Any) -> int:
    """Return the address of a compiled function's machine code for the types of some arguments."""
    kinds = tuple(map(typeof, arguments))
    function.compile(kinds)
    result = function.overloads[kinds]
    return result.library.get_pointer_to_function(result.fndesc.llvm_func_name)


class Store:
    """Cache of a function's machine code, a file for each type of its arguments. It has the methods of numba's own caches.

    Args:
        name: What the function does, for people.
        identity: Hash of everything the machine code is made of, except for types and processor.
    """

    def __init__(self, name: str, identity: str) -> None:
        self._name, self._identity = name, identity
        self._lock: IO[str] | None = None
        self._began = 0.0

    @property
    def cache_path(self) -> str:
        return str(folder())

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return a compile result from its file; None, and a notice, if numba has to compile."""
        rtsys.initialize(target)  # machine code from a file needs no more; numba refreshes its context where it compiles
        path = self._path(signature, target.codegen())
        result = _load(path, target)
        if result is None:
            self._lock = _lock(path.with_suffix(".lock"), self._name)
            result = _load(path, target)  # another process may have compiled it meanwhile
        if result is None:
            self._began = time.perf_counter()
            say(f"turtlebot_gym: compiling {self._name} for this machine, once ... ")
        return result

    def save_overload(self, signature: Any, result: Any) -> None:
        """Write what numba has compiled, if the folder is writable."""
        say(f"{time.perf_counter() - self._began:.1f} s\n")
        path = self._path(signature, result.codegen)
        assert not result.library.has_dynamic_globals, "addresses in the code are another process's"
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
                file.write(dumps(result._reduce()))
            os.replace(file.name, path)  # at once, so that nobody reads a part of it
            _tidy(path.parent)

    def released(self, compile_: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Return numba's method that loads or compiles, after which, even after an error, no other process waits."""

        def run(signature: Any) -> Any:
            try:
                return compile_(signature)
            finally:
                self._release()

        return run

    def _path(self, signature: Any, codegen: Any) -> Path:
        key = f"{self._identity} {signature} {codegen.magic_tuple()}"
        return folder() / f"{self._name.replace(' ', '-')}-{hashlib.sha256(key.encode()).hexdigest()[:32]}.bin"

    def _release(self) -> None:
        if self._lock is not None:
            with suppress(OSError):
                os.unlink(self._lock.name)
            self._lock.close()
            self._lock = None


def _load(path: Path, target: Any) -> Any:
    """Return a compile result from a file, None without a whole one."""
    try:
        result = CompileResult._rebuild(target, *pickle.loads(path.read_bytes()))
        os.utime(path)  # in use: `_tidy` keeps it
    except Exception:  # whatever is wrong with the file, compiling replaces it
        return None
    return result


def _lock(path: Path, name: str) -> IO[str] | None:
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
