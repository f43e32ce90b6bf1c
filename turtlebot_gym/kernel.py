"""The decorator for equations: one source that runs as plain Python and inside a compiled loop.

Decorated functions are pure: they take and return scalars and (nested) ``NamedTuple``s of scalars; noise draws are arguments;
there are no clocks and no generators. They are ordinary functions of Python, which `turtlebot_gym.compiled` translates from
their source: a robot needs no compiler, and a debugger can enter the loops.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable)


def _has_compiler() -> bool:
    """Return whether llvmlite is installed, and nobody has asked for plain Python."""
    try:
        return find_spec("llvmlite") is not None and not int(os.environ.get("TURTLEBOT_GYM_PLAIN") or 0)
    except ValueError:  # sys.modules holds None
        return False


HAS_LLVM = _has_compiler()
"""Whether loops are compiled."""


def kernel(function: F) -> F:
    """Let a compiled loop inline this function; calling it from Python runs it as plain Python."""
    return function


def algebra(function: F) -> F:
    """Make a `kernel` whose numbers are finite and in which the sign of a zero is irrelevant.

    The compiler can then omit products with a constant zero. No other result changes, not even in the last bit.
    """
    vars(function)["is_algebra"] = True
    return function


def sqrt(x: float) -> float:
    """Return the square root of ``x >= 0``, correctly rounded."""
    return math.sqrt(x)


def floor(x: float) -> float:
    """Return the greatest whole number up to x as a float: AVX2 cannot convert vectors of floats to 64-bit integers."""
    return 1.0 * math.floor(x) if x else x  # a zero keeps its sign


def exactly(n: int) -> float:
    """Return a whole number from 0 to 2^32 - 1 as a float; AVX2 cannot convert vectors of larger ones."""
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


def lanes(count: int) -> range:
    """Return a range whose rounds share nothing: compiled loops run them side by side, in vectors."""
    return range(count)


def fetch(array: Any, at: int) -> None:
    """Bring an array's numbers from ``at`` on near the processor, since they are read soon."""


def thread() -> int:
    """Return the number of this thread of a GPU: the environment that it begins with."""
    return 0


def threads() -> int:
    """Return the number of threads of a GPU that share a loop."""
    return 1


def is_plain() -> bool:
    """Return whether the caller runs as plain Python; compiled code knows the answer in advance."""
    return True


def in_loops(loop: Callable[..., Any]) -> Callable[[F], F]:
    """Decorate a function of whole arrays that compiled loops replace by one of loops, with the same results to the last bit.

    Whole arrays are fast in plain Python; the compiler knows loops only.

    Args:
        loop: The function in loops.
    """

    def decorate(function: F) -> F:
        vars(function)["in_loops"] = loop
        return function

    return decorate
