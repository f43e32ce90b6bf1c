"""Compiling a function once per machine: numba's cache, keyed on all that the function is made of.

numba keys its cache on a function's own code and what it closes over, but neither on the helpers that it calls nor on the flags
that it is compiled with. So a function that is compiled here closes over a string that stands for those.
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
"""LLVM proves that a tile does not overlap the parameters by one check for each group of addresses, but stops grouping after
100 comparisons, fewer than a step has numbers. It then counts too many checks and gives up vectorizing, and a step takes four
times as long."""

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
    """Return a hash of functions, of all that they call, and of the numbers that they use; comments do not count."""
    digest = hashlib.sha256(Path(kernel.__file__).read_bytes())  # intrinsics are reached by no call
    digest.update(" ".join(_LLVM_OPTIONS).encode())
    seen: set[int] = set()
    for function in functions:
        for part in _parts(function, seen):
            digest.update(part.encode())
    return digest.hexdigest()


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    """Yield what a value contributes to a fingerprint."""
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
    """Return a function that finds other values under some of its global names.

    numba compiles globals as constants, and unlike what a function closes over they are not part of its cache's key, into which
    functions would enter by their address in memory.
    """
    assert isinstance(function, FunctionType)
    scope = {**function.__globals__, **names}
    bound = FunctionType(function.__code__, scope, function.__name__, function.__defaults__, function.__closure__)
    bound.__qualname__, bound.__module__ = function.__qualname__, function.__module__
    return bound


def compiled(function: Callable[..., Any], *, parallel: bool) -> Callable[..., Any]:
    """Compile a function at its first call, with numba's cache where a folder for it is writable.

    Args:
        function: Closes over a string that tells it from all others: its `fingerprint`, and ``parallel``.
        parallel: Whether its ``prange`` runs on all threads.
    """
    try:
        return njit(function, error_model="numpy", parallel=parallel, cache=True)
    except RuntimeError:  # there is no folder for the cache
        return njit(function, error_model="numpy", parallel=parallel)
