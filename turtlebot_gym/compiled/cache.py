"""Compile a function once for all processes, checkouts and virtual environments of a user.

The cache holds a file for each compiled function, named by a hash of all that its machine code is made of: the function, what
it calls, the numbers it uses, the compilers and the processor. numba's own cache neither looks at helpers in other files nor at
compiler flags, and forgets a function whenever its file changes.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import IO, Any

import numpy as np

from turtlebot_gym import kernel
from turtlebot_gym.kernel import HAS_NUMBA

_LLVM_OPTIONS = ("-memory-check-merge-threshold=4000",)
"""LLVM proves with one check per group of addresses that a tile does not overlap the parameters, but stops grouping
after 100 comparisons, and a step has more numbers than that. It then counts too many checks and gives up vectorizing,
and a step takes four times as long."""
MOST_BYTES = 200_000_000
"""Size of the cache above which the files that nobody used for the longest time are removed: about 300 functions."""
LONGEST_WAIT = 300.0
"""Longest time to wait for another process that compiles the same function, s: several times what a robot's computer needs."""

if HAS_NUMBA:
    import llvmlite
    import numba
    from llvmlite import binding as llvm
    from numba import config, njit
    from numba.core.compiler import CompileResult
    from numba.core.serialize import dumps
    from numba.misc.appdirs import user_cache_dir

    from turtlebot_gym import intrinsics

    for option in _LLVM_OPTIONS:
        llvm.set_option("", option)
    _COMPILERS = (
        *_LLVM_OPTIONS, numba.__version__, llvmlite.__version__, sys.implementation.cache_tag,
        config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE, config.BOUNDSCHECK,
        *(Path(module.__file__).read_text("utf-8") for module in (kernel, intrinsics)),  # no call leads to intrinsics
    )  # fmt: skip
else:  # the functions run as plain Python
    njit: Any = lambda function, **options: function  # noqa: E731
    _COMPILERS = ()

try:
    import fcntl
except ImportError:  # Windows: processes that start together compile the same, each for itself
    fcntl = None


def fingerprint(*functions: Callable[..., Any]) -> str:
    """Return a hash of functions, of everything they call, and of the numbers they use; comments and paths do not count."""
    digest, seen = hashlib.sha256(), set()
    for function in functions:
        for part in _parts(function, seen):
            digest.update(part.encode())
    return digest.hexdigest()


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    """Yield a value's contributions to a fingerprint."""
    if isinstance(value, FunctionType):
        if id(value) in seen:
            return
        seen.add(id(value))
        yield from _parts(value.__code__, seen)
        for cell in value.__closure__ or ():
            yield from _parts(cell.cell_contents, seen)
        names = value.__code__.co_names
        scopes = [value.__globals__, *(vars(it) for name in names if isinstance(it := value.__globals__.get(name), ModuleType))]
        for name in names:
            for scope in scopes:
                yield from _parts(scope.get(name), seen)
    elif isinstance(value, CodeType):
        yield f"{value.co_code.hex()} {value.co_names} {value.co_varnames} {value.co_freevars}"
        for constant in value.co_consts:
            yield from _parts(constant, seen)
    elif isinstance(value, type) and issubclass(value, tuple):
        yield f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', ())}"
    elif isinstance(value, (bool, int, float, str, np.generic, type(None))):
        yield repr(value)
    elif isinstance(value, (tuple, frozenset)):
        yield f"{len(value)} of"
        for item in sorted(value, key=repr) if isinstance(value, frozenset) else value:
            yield from _parts(item, seen)


def folder() -> Path:
    """Return the folder of the cache: in NUMBA_CACHE_DIR if that is set, otherwise in the user's folder for caches."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    return Path(given, "turtlebot_gym") if given else Path(user_cache_dir("turtlebot_gym", appauthor=False))


class _Store:
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
        """The folder."""
        return str(folder())

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return a compile result from its file; None, and a notice, if numba has to compile."""
        target.refresh()
        path = self._path(signature, target.codegen())
        result = _load(path, target)
        if result is None:
            self._lock = self._lock or _lock(path.with_suffix(".lock"), self._name)
            result = _load(path, target)  # another process may have compiled it meanwhile
        if result is None:
            self._began = time.perf_counter()
            _say(f"turtlebot_gym: compiling {self._name} for this machine, once ... ")
        else:
            self._release()
        return result

    def save_overload(self, signature: Any, result: Any) -> None:
        """Write what numba has compiled, if the folder is writable."""
        _say(f"{time.perf_counter() - self._began:.1f} s\n")
        path = self._path(signature, result.codegen)
        assert not result.library.has_dynamic_globals, "addresses in the code are another process's"
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
                file.write(dumps(result._reduce()))
            os.replace(file.name, path)  # at once, so that nobody reads a part of it
            _tidy(path.parent)
        self._release()

    def _path(self, signature: Any, codegen: Any) -> Path:
        key = f"{self._identity} {signature} {codegen.magic_tuple()}"
        return folder() / f"{self._name.replace(' ', '-')}-{hashlib.sha256(key.encode()).hexdigest()[:32]}.bin"

    def _release(self) -> None:
        """Let others load the file."""
        if self._lock is not None:
            with suppress(OSError):
                os.unlink(self._lock.name)
            self._lock.close()
            self._lock = None


def _load(path: Path, target: Any) -> Any:
    """Return a compile result from a file, None if there is no such file or only a part of one."""
    try:
        result = CompileResult._rebuild(target, *pickle.loads(path.read_bytes()))
        os.utime(path)  # in use: `_tidy` keeps it
    except Exception:  # whatever is wrong with the file, compiling replaces it
        return None
    return result


def _lock(path: Path, name: str) -> IO[str] | None:
    """Return a file that this process has locked; None if that is impossible, or another one holds it for too long."""
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
                _say(f"turtlebot_gym: waiting for another process, which is compiling {name} ... ")
            waited = True
            time.sleep(0.05)
        except OSError:  # the file system has no locks
            break
        else:
            if waited:
                _say(f"{time.perf_counter() - began:.1f} s\n")
            return file
    file.close()
    return None


def _tidy(directory: Path) -> None:
    """Remove the files that were not used for the longest time, if all of them are larger than `MOST_BYTES`."""
    files = sorted(((status := path.stat()).st_mtime, status.st_size, path) for path in directory.glob("*.bin"))
    excess = sum(size for _, size, _ in files) - MOST_BYTES
    for _, size, path in files:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


def _say(text: str) -> None:
    """Write a notice, if somebody watches."""
    if sys.stderr.isatty():
        sys.stderr.write(text)
        sys.stderr.flush()


def compiled(function: Callable[..., Any], name: str, *, parallel: bool = False) -> Callable[..., Any]:
    """Compile a function at its first call, unless the cache holds it.

    Args:
        function: Its globals and its closure hold kernels and numbers, which become a part of it.
        name: What it does, for the notice on a terminal and the name of its file.
        parallel: Whether its ``prange`` runs on all threads.
    """
    dispatcher = njit(function, error_model="numpy", parallel=parallel)
    if HAS_NUMBA:
        identity = f"{fingerprint(function)} {parallel} {_COMPILERS}"
        dispatcher._cache = _Store(name, hashlib.sha256(identity.encode()).hexdigest())
    return dispatcher
