"""The decorator for equations: one source that runs as plain Python and inside a compiled loop.

Decorated functions are pure: they take and return scalars and (nested) ``NamedTuple``s of scalars; noise draws are arguments;
there are no clocks and no generators. Without numba, or with numba's own ``NUMBA_DISABLE_JIT=1``, the decorator returns the
function unchanged: a robot needs neither numba nor a compiler, and a debugger can enter the loops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable)

try:
    from numba import config, extending

    extending = None if config.DISABLE_JIT else extending  # pyright: ignore[reportAttributeAccessIssue]
except ImportError:
    extending = None

HAS_NUMBA = extending is not None
intrinsics: Any = None
if HAS_NUMBA:
    from turtlebot_gym import intrinsics  # pyright: ignore[reportConstantRedefinition]


def kernel(function: F) -> F:
    """Let a compiled loop inline this function; calling it from Python runs it as plain Python."""
    return function if extending is None else extending.register_jitable(**intrinsics.INLINED)(function)


def algebra(function: F) -> F:
    """Make a `kernel` whose numbers are finite and in which the sign of a zero is irrelevant.

    The compiler can then omit products with a constant zero. No other result changes, not even in the last bit.
    """
    return (
        function if extending is None else extending.register_jitable(**intrinsics.INLINED, fastmath={"nnan", "nsz"})(function)
    )


def sqrt(x: float) -> float:
    """Return the square root of ``x >= 0``, correctly rounded."""
    return math.sqrt(x)


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


prefer_wide: Any = intrinsics.wide_vectors if HAS_NUMBA else None
"""``prefer_wide()`` asks for the widest vectors in the loops of the compiled function that calls it, and of the kernels that
this function inlines; in a kernel it has no effect."""
compiled_scratch: Any = intrinsics.stack_array if HAS_NUMBA else None
"""``compiled_scratch(size)`` returns room for ``size`` numbers, a constant, until the calling compiled function ends."""


def _inlined(function: Callable, make: Callable[..., Callable]) -> None:
    """Let compiled loops inline what ``make`` returns in place of a function."""
    intrinsics.extending.overload(function, jit_options=intrinsics.INLINED)(make)


Leaf = int | float | bool | tuple[int]
"""Where compiled code finds a number of a value, see `access`."""


def access(load: Callable, store: Callable, example: Any, leaves: Sequence[Leaf]) -> tuple[Callable, Callable]:
    """Let a compiled loop inline two functions that load and store a value.

    To compile them from their Python would take numba longer than a whole step.

    Args:
        load: ``load(buffer, at)``, as plain Python.
        store: ``store(buffer, at, value)``, as plain Python.
        example: A nested tuple of floats and bools.
        leaves: For each number its place relative to ``at``, with its bits inverted if it is not stored; in a tuple, its place
            in the buffer whatever ``at`` is, where it is not stored either; or the number itself, a float or a bool, if it is a
            constant.
    """
    if HAS_NUMBA:
        load_numbers, store_numbers = intrinsics.loading(example, leaves), intrinsics.storing(leaves)
        _inlined(load, lambda buffer, at: lambda buffer, at: load_numbers(buffer, at))
        _inlined(store, lambda buffer, at, value: lambda buffer, at, value: store_numbers(buffer, at, value))
    return load, store


def in_loops(loop: Callable[..., Any]) -> Callable[[F], F]:
    """Decorate a function of whole arrays that compiled loops replace by one of loops, with the same results to the last bit.

    Whole arrays are fast in plain Python; compiled, they bring numpy's checks of shapes with them, which take long to compile.

    Args:
        loop: The function in loops. It has no types, as numba wants of what stands for another function.
    """

    def decorate(function: F) -> F:
        vars(function)["in_loops"] = loop  # a part of the fingerprint of machine code
        if HAS_NUMBA:
            intrinsics.extending.overload(function, jit_options=intrinsics.INLINED, strict=False)(lambda *arguments: loop)
        return function

    return decorate


if HAS_NUMBA:
    from numba import int64

    _root, _multiply, _add, _split = intrinsics.square_root, intrinsics.multiply, intrinsics.add, intrinsics.split_bits
    _without_owner, _fetch = intrinsics.without_owner, intrinsics.fetch

    # Compiled math.sqrt is a call that may set errno, which prevents vectorization; this is a single instruction.
    _inlined(sqrt, lambda x: lambda x: _root(x))
    _inlined(times, lambda a, b: lambda a, b: _multiply(int64(a), int64(b)))
    _inlined(plus, lambda a, b: lambda a, b: _add(int64(a), int64(b)))
    _inlined(split, lambda x: lambda x: _split(x))
    _inlined(fetch, lambda array, index: lambda array, index: _fetch(array, int64(index)))
    _inlined(is_plain, lambda: lambda: False)
    _inlined(borrowed, lambda array: lambda array: _without_owner(array))
