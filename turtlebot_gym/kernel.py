"""The decorator for equations: one source that runs as plain Python and inside a compiled loop.

Decorated functions are pure: they take and return scalars and (nested) ``NamedTuple``s of scalars; noise draws are arguments;
there are no clocks and no generators. Without numba, or with numba's own ``NUMBA_DISABLE_JIT=1``, the decorator returns the
function unchanged: a robot needs neither numba nor a compiler, and a debugger can enter the loops.

numba is imported by `load_compiler`, before the first loop is compiled: a process that compiles none is smaller by 60 MB.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from threading import Lock
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable)


def _compiles_with(library: str) -> bool:
    """Return whether a compiler's library is installed, and nobody has asked for plain Python."""
    try:
        return find_spec(library) is not None and not int(os.environ.get("NUMBA_DISABLE_JIT") or 0)
    except ValueError:  # sys.modules holds None
        return False


HAS_NUMBA, HAS_LLVM = _compiles_with("numba"), _compiles_with("llvmlite")
"""Whether loops are compiled: those of rooms by numba, those of open ground by llvmlite."""
_registrations: list[Callable[[Any], object]] = []
"""What numba still has to know of kernels: functions of the module `intrinsics`."""
_registering = Lock()


def _register(registration: Callable[[Any], object]) -> None:
    if HAS_NUMBA:
        _registrations.append(registration)


def load_compiler() -> None:
    """Import numba and register all kernels; call this before a function that uses kernels is compiled."""
    from turtlebot_gym import intrinsics

    with _registering:
        while _registrations:
            _registrations.pop(0)(intrinsics)


def kernel(function: F) -> F:
    """Let a compiled loop inline this function; calling it from Python runs it as plain Python."""
    _register(lambda compiler: compiler.inline(function))
    return function


def algebra(function: F) -> F:
    """Make a `kernel` whose numbers are finite and in which the sign of a zero is irrelevant.

    The compiler can then omit products with a constant zero. No other result changes, not even in the last bit.
    """
    vars(function)["is_algebra"] = True
    _register(lambda compiler: compiler.inline(function, fastmath={"nnan", "nsz"}))
    return function


def sqrt(x: float) -> float:
    """Return the square root of ``x >= 0``, correctly rounded."""
    return math.sqrt(x)


def floor(x: float) -> float:
    """Return the greatest whole number up to x as a float: AVX2 cannot convert vectors of floats to 64-bit integers."""
    return 1.0 * math.floor(x)


def exactly(n: int) -> float:
    """Return a whole number from 0 to 2^52 - 1 as a float; AVX2 cannot convert vectors back, either."""
    return 1.0 * n


def times(a: int, b: int) -> int:
    """Return the product of two 64-bit integers, modulo 2^64."""
    return (a * b) & 0xFFFFFFFFFFFFFFFF


def plus(a: int, b: int) -> int:
    """Return the sum of two 64-bit integers, modulo 2^64."""
    return (a + b) & 0xFFFFFFFFFFFFFFFF


def split(x: float) -> tuple[float, float]:
    """Return the significand, in [0.5, 1), and the exponent of a normal number x > 0: ``x = significand * 2^exponent``."""
    significand, exponent = math.frexp(x)
    return significand, float(exponent)


def first_accepted(most: int, draw: Callable[[int], tuple[Any, ...]]) -> tuple[float, ...]:
    """Return the first of ``draw(0)``, ``draw(1)`` and so on whose last item is true, without that; else the last of ``most``.

    It is for plain Python and for open ground only.
    """
    drawn: tuple[Any, ...] = ()
    for attempt in range(most):
        drawn = draw(attempt)
        if drawn[-1]:
            break
    return drawn[:-1]


def is_plain() -> bool:
    """Return whether the caller runs as plain Python; compiled code knows the answer in advance."""
    return True


def fetch(array: Any, index: int) -> None:
    """Ask for the cache line of a number that will be read soon; in plain Python do nothing."""


def borrowed(array: Any) -> Any:
    """Return an array without reference counting in a compiled loop; its owner must outlive the loop.

    Each count is an atomic operation on a counter that all threads share for all views of an array.
    """
    return array


def prefer_wide() -> None:
    """Ask for the widest vectors in the loops of the compiled function that calls this, and of the kernels that it inlines.

    In a kernel and in plain Python it has no effect.
    """


def compiled_scratch(size: int) -> Any:
    """Return room for ``size`` numbers, a constant, until the calling compiled function ends; for compiled loops only."""
    raise NotImplementedError("compiled_scratch is for compiled loops: plain Python makes an array.")


def access(load: Callable, store: Callable, example: Any, places: Sequence[int]) -> None:
    """Let a compiled loop inline two functions that load and store a value.

    To compile them from their Python would take numba longer than a whole step.

    Args:
        load: ``load(buffer, at)``, as plain Python.
        store: ``store(buffer, at, value)``, as plain Python.
        example: A nested tuple of floats and bools.
        places: The place of each number relative to ``at``.
    """

    def register(compiler: Any) -> None:
        load_numbers, store_numbers = compiler.loading(example, places), compiler.storing(places)
        compiler.overload(load, lambda buffer, at: lambda buffer, at: load_numbers(buffer, at))
        compiler.overload(store, lambda buffer, at, value: lambda buffer, at, value: store_numbers(buffer, at, value))

    _register(register)


def in_loops(loop: Callable[..., Any]) -> Callable[[F], F]:
    """Decorate a function of whole arrays that compiled loops replace by one of loops, with the same results to the last bit.

    Whole arrays are fast in plain Python; compiled, they bring numpy's checks of shapes with them, which take long to compile.

    Args:
        loop: The function in loops. It has no types, as numba wants of what stands for another function.
    """

    def decorate(function: F) -> F:
        vars(function)["in_loops"] = loop  # a part of the fingerprint of machine code
        _register(lambda compiler: compiler.overload(function, lambda *arguments: loop, strict=False))
        return function

    return decorate


def _register_primitives(compiler: Any) -> None:
    overload, int64 = compiler.overload, compiler.int64
    root, multiply, add, split_bits = compiler.square_root, compiler.multiply, compiler.add, compiler.split_bits
    whole, exact, without_owner, fetch_line = compiler.floor, compiler.exactly, compiler.without_owner, compiler.fetch
    # Compiled math.sqrt is a call that may set errno, which prevents vectorization; this is a single instruction.
    overload(sqrt, lambda x: lambda x: root(x))
    overload(floor, lambda x: lambda x: whole(x))
    overload(exactly, lambda n: lambda n: exact(int64(n)))
    overload(times, lambda a, b: lambda a, b: multiply(int64(a), int64(b)))
    overload(plus, lambda a, b: lambda a, b: add(int64(a), int64(b)))
    overload(split, lambda x: lambda x: split_bits(x))
    overload(fetch, lambda array, index: lambda array, index: fetch_line(array, int64(index)))
    overload(is_plain, lambda: lambda: False)
    overload(borrowed, lambda array: lambda array: without_owner(array))
    compiler.replace(prefer_wide, compiler.emit_wide)
    compiler.replace(compiled_scratch, compiler.emit_scratch)


_register(_register_primitives)
