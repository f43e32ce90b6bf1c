"""Files of machine code, which all processes, checkouts and virtual environments of a user share.

The name of a file holds a hash of all that the machine code is made of: the function, what it calls, the numbers it uses, the
compiler and the processor.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

MOST_BYTES = 200_000_000
"""Size of the cache above which the least recent files are removed: about 500 functions."""


def folder() -> Path:
    """Return the folder of the cache: in TURTLEBOT_GYM_CACHE_DIR if that is set, otherwise in the user's folder for caches."""
    if parent := os.environ.get("TURTLEBOT_GYM_CACHE_DIR"):
        return Path(parent, "turtlebot_gym")
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local", "turtlebot_gym", "Cache")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "turtlebot_gym"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "turtlebot_gym")


def kept(name: str, identity: str, make: Callable[[], Any]) -> Any:
    """Return a value from its file, or make it and write the file; two processes that start together both make it.

    Args:
        name: What it is, for people.
        identity: Everything that it is made of, except for this package's compiler, Python and the processor.
        make: Returns the value, which can be pickled; a terminal shows a notice meanwhile.
    """
    hashed = hashlib.sha256(f"{identity} {_maker()}".encode()).hexdigest()
    path = folder() / f"{name.replace(' ', '-')}-{hashed[:32]}.bin"
    try:
        value = pickle.loads(path.read_bytes())
        os.utime(path)  # in use: `_tidy` keeps it
        return value
    except Exception:  # whatever is wrong with the file, it is made again
        pass
    began, is_watched = time.perf_counter(), sys.stderr.isatty()
    if is_watched:
        print(f"turtlebot_gym: compiling {name} for this machine, once ... ", end="", file=sys.stderr, flush=True)
    value = make()
    if is_watched:
        print(f"{time.perf_counter() - began:.1f} s", file=sys.stderr)
    with suppress(OSError):  # the folder is not writable, or the disk is full
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
            file.write(pickle.dumps(value))
        os.replace(file.name, path)  # at once, so that nobody reads a part of it
        _tidy(path.parent)
    return value


def _tidy(directory: Path) -> None:
    """Remove the files that were used least recently, if all are larger than `MOST_BYTES`."""
    files = sorted(((status := path.stat()).st_mtime, status.st_size, path) for path in directory.glob("*.bin"))
    excess = sum(size for _, size, _ in files) - MOST_BYTES
    for _, size, path in files:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


@cache
def _maker() -> str:
    """Return what makes machine code: this folder, the versions and the processor."""
    import llvmlite

    from turtlebot_gym.compiled.native import processor

    sources = [path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))]
    return f"{hashlib.sha256(b''.join(sources)).hexdigest()} {sys.version} {llvmlite.__version__} {processor()}"


def fingerprint(*functions: Callable[..., Any]) -> str:
    """Return a hash of functions, of what they call, and of the numbers they use."""
    digest, seen = hashlib.sha256(), set[int]()
    for part in _parts(functions, seen):
        digest.update(part.encode())
    return digest.hexdigest()


def _names(code: CodeType) -> Iterator[str]:
    """Yield the global names of a function and of its comprehensions, which have code of their own before Python 3.12."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    if isinstance(value, FunctionType):
        if id(value) in seen:
            return
        seen.add(id(value))
        code = value.__code__
        if code.co_consts[:1] == (value.__doc__,):  # machine code does not change with a docstring
            code = code.replace(co_consts=(None, *code.co_consts[1:]))
        yield from _parts(code, seen)
        yield from _parts(getattr(value, "in_loops", ()), seen)
        for cell in value.__closure__ or ():
            yield from _parts(cell.cell_contents, seen)
        names = [*_names(code)]
        scopes = [value.__globals__, *(vars(it) for name in names if isinstance(it := value.__globals__.get(name), ModuleType))]
        for name in names:
            for scope in scopes:
                yield from _parts(scope.get(name), seen)
    elif hasattr(value, "__wrapped__"):  # a function of `functools.cache`
        yield from _parts(value.__wrapped__, seen)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield from _parts(tuple(getattr(value, field.name) for field in dataclasses.fields(value)), seen)
    elif isinstance(value, CodeType):
        yield f"{value.co_code.hex()} {value.co_names} {value.co_varnames} {value.co_freevars}"
        for constant in value.co_consts:
            yield from _parts(constant, seen)
    elif isinstance(value, type) and issubclass(value, tuple):
        yield f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', ())}"
    elif isinstance(value, (bool, int, float, str, np.generic, type(None))):
        yield repr(value)
    elif isinstance(value, (tuple, frozenset, dict)):
        yield f"{len(value)} of"
        items = value.items() if isinstance(value, dict) else sorted(value, key=repr) if isinstance(value, frozenset) else value
        for item in items:
            yield from _parts(item, seen)
