"""Compile a function once per machine: numba's cache, keyed on everything the function consists of.

numba keys its cache on a function's own code and closure, but not on the helpers it calls or its compiler flags. So
each function compiled here closes over a string that identifies those.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from turtlebot_gym import kernel
from turtlebot_gym.kernel import HAS_NUMBA

_LLVM_OPTIONS = ("-memory-check-merge-threshold=4000",)
"""LLVM proves with one check per group of addresses that a tile does not overlap the parameters, but stops grouping
after 100 comparisons, and a step has more numbers than that. It then counts too many checks and gives up vectorizing,
and a step takes four times as long."""

if HAS_NUMBA:
    from llvmlite import binding as llvm
    from numba import njit
    from numba.core import event

    for option in _LLVM_OPTIONS:
        llvm.set_option("", option)

    class _Announcer(event.Listener):
        """Says on a terminal, once, that a function of this package is being compiled."""

        said = False

        def on_start(self, event: Any) -> None:
            ours = str(event.data["dispatcher"].py_func.__module__).startswith("turtlebot_gym.")
            if ours and not self.said and sys.stderr.isatty():
                self.said = True
                print("turtlebot_gym: compiling for this machine, once; this takes about ten seconds.", file=sys.stderr)

        def on_end(self, event: Any) -> None:
            """Say nothing."""

    event.register("numba:compile", _Announcer())
else:  # the functions run as plain Python
    njit: Any = lambda function, **options: function  # noqa: E731


def fingerprint(*functions: Callable[..., Any]) -> str:
    """Return a hash of functions, of everything they call, and of the numbers they use; comments do not count."""
    digest = hashlib.sha256(Path(kernel.__file__).read_bytes())  # intrinsics are not reached by following calls
    digest.update(" ".join(_LLVM_OPTIONS).encode())
    seen: set[int] = set()
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
        yield f"{value.__qualname__} {getattr(value, '_fields', ())}"
    elif isinstance(value, (bool, int, float, str, np.generic, type(None))):
        yield repr(value)
    elif isinstance(value, (tuple, frozenset)):
        yield f"{len(value)} of"
        for item in sorted(value, key=repr) if isinstance(value, frozenset) else value:
            yield from _parts(item, seen)


def bind(function: Callable[..., Any], **names: Any) -> Callable[..., Any]:
    """Return a function with some of its globals replaced.

    numba compiles globals as constants. Unlike a closure they are not part of its cache key, where functions would
    count by their memory address.
    """
    assert isinstance(function, FunctionType)
    scope = {**function.__globals__, **names}
    bound = FunctionType(function.__code__, scope, function.__name__, function.__defaults__, function.__closure__)
    bound.__qualname__, bound.__module__ = function.__qualname__, function.__module__
    return bound


def compiled(function: Callable[..., Any], *, parallel: bool) -> Callable[..., Any]:
    """Compile a function at its first call, with numba's cache if its folder is writable.

    Args:
        function: A function that closes over a string that identifies it: its `fingerprint` and ``parallel``.
        parallel: Whether its ``prange`` runs on all threads.
    """
    try:
        return njit(function, error_model="numpy", parallel=parallel, cache=True)
    except RuntimeError:  # there is no folder for the cache
        return njit(function, error_model="numpy", parallel=parallel)
