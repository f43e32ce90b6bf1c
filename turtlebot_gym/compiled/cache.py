"""Compile a function once for this machine, and find it again by a hash of everything that its machine code is made of.

That is the function, what it calls and the numbers it uses, the compilers and the processor. numba's own cache looks neither at
helpers in other files nor at compiler flags.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import numpy as np

from turtlebot_gym import kernel
from turtlebot_gym.kernel import HAS_NUMBA, load_compiler

F = TypeVar("F", bound=Callable[..., Any])

_LLVM_OPTIONS = ("-memory-check-merge-threshold=4000",)
"""LLVM proves with one check per group of addresses that a tile does not overlap the parameters, but stops grouping
after 100 comparisons, and a step has more numbers than that. It then counts too many checks and gives up vectorizing,
and a step takes four times as long."""


def fingerprint(*functions: Callable[..., Any]) -> str:
    """Return a hash of functions, of what they call, and of the numbers they use."""
    digest, seen = hashlib.sha256(), set()
    for function in functions:
        for part in _parts(function, seen):
            digest.update(part.encode())
    return digest.hexdigest()


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
        names = code.co_names
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


@cache
def _compilers() -> str:
    """Set the options of the compilers, and return what machine code depends on besides the function and the processor."""
    import llvmlite
    import numba
    from llvmlite import binding as llvm
    from numba.core import config

    for option in _LLVM_OPTIONS:
        llvm.set_option("", option)
    options: Any = config
    below = Path(kernel.__file__ or "").parent  # nobody calls these
    sources = [(below / f"{name}.py").read_text("utf-8") for name in ("kernel", "intrinsics", "inlining")]
    parts = (*_LLVM_OPTIONS, options.OPT, options.LOOP_VECTORIZE, options.SLP_VECTORIZE, options.BOUNDSCHECK, *sources)
    return f"{numba.__version__} {llvmlite.__version__} {sys.implementation.cache_tag} {parts}"


@cache
def sources_of(*modules: str) -> str:
    """Return a hash of the sources of some modules of this package."""
    sources = [Path(__file__).with_name(f"{module}.py").read_bytes() for module in modules]
    return hashlib.sha256(b"".join(sources)).hexdigest()


def in_machine_code(name: str) -> Callable[[F], F]:
    """Decorate a function that is `compiled` at its first call: numba is not imported before."""

    def decorate(function: F) -> F:
        make = cache(lambda: compiled(function, name))
        return wraps(function)(lambda *arguments: make()(*arguments))  # type: ignore[return-value]

    return decorate


def compiled(function: Callable[..., Any], name: str, *, parallel: bool = False) -> Callable[..., Any]:
    """Compile a function at its first call, unless the cache holds it.

    Args:
        function: Its globals and its closure hold kernels and numbers, which become a part of it.
        name: What it does, for the notice on a terminal and the name of its file.
        parallel: Whether its ``prange`` runs on all threads.
    """
    if not HAS_NUMBA:  # it runs as plain Python
        return function
    load_compiler()
    from numba import njit

    identity = hashlib.sha256(f"{name} {fingerprint(function)} {parallel} {_compilers()}".encode()).hexdigest()
    # numba numbers functions in each process anew: two from different processes could share a symbol, and so an address
    function.__qualname__ = f"{function.__name__}_{identity}"
    dispatcher: Any = njit(function, error_model="numpy", parallel=parallel)
    with suppress(ImportError, AttributeError):  # a numba whose insides differ: each process compiles for itself
        from turtlebot_gym.compiled.numba_store import keep

        keep(dispatcher, name, identity)
    return dispatcher
