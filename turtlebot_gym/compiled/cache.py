"""Compile a function once for this machine, and find it again by a hash of everything that its machine code is made of.

That is the function, what it calls and the numbers it uses, the compiler and the processor.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from functools import cache, wraps
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import numpy as np

from turtlebot_gym.kernel import HAS_LLVM

F = TypeVar("F", bound=Callable[..., Any])


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
def sources_of(*modules: str) -> str:
    """Return a hash of the sources of some modules of this package."""
    sources = [Path(__file__).with_name(f"{module}.py").read_bytes() for module in modules]
    return hashlib.sha256(b"".join(sources)).hexdigest()


def in_machine_code(name: str) -> Callable[[F], F]:
    """Decorate a function that is `compiled` at its first call: llvmlite is not imported before."""

    def decorate(function: F) -> F:
        make = cache(lambda: compiled(function, name))
        return wraps(function)(lambda *arguments: make()(*arguments))  # type: ignore[return-value]

    return decorate


def compiled(function: Callable[..., Any], name: str, about: str = "", level: int = 3) -> Callable[..., Any]:
    """Return a function as machine code, which is made at its first call, unless the cache holds it.

    Args:
        function: Its globals and its closure hold kernels and numbers, which become a part of it.
        name: What it does, for the notice on a terminal and the name of its file.
        about: What its machine code depends on besides.
        level: How much LLVM has to optimize it, from 1 to 3.
    """
    if not HAS_LLVM:  # it runs as plain Python
        return function
    from turtlebot_gym.compiled.program import MAKERS, Program

    return Program(function, name, f"{name} {about} {level} {fingerprint(function)} {sources_of(*MAKERS)}", level)
