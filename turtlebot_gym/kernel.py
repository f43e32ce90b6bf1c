"""The decorator of every equation: one source that runs as plain Python and inside a compiled loop.

The functions under it are pure: scalars and (nested) ``NamedTuple``s of scalars in, the same out; noise draws are
arguments; there are no clocks and no generators. Without numba the decorator returns the function unchanged, so a robot
needs neither numba nor a compiler.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable)

try:
    from numba import extending
except ImportError:
    extending = None

HAS_NUMBA = extending is not None


def kernel(function: F) -> F:
    """Let a compiled loop inline this function; calling it from Python runs it as plain Python."""
    return function if extending is None else extending.register_jitable(forceinline=True)(function)


def sqrt(x: float) -> float:
    """Return the square root of ``x >= 0``, correctly rounded."""
    return math.sqrt(x)


if extending is not None:
    from numba import float64

    def _emit_sqrt(typing_context, x):
        def emit(context, builder, signature, arguments):
            return builder.call(builder.module.declare_intrinsic("llvm.sqrt", [arguments[0].type]), arguments)

        return float64(float64), emit

    _sqrt_instruction: Any = extending.intrinsic(_emit_sqrt)
    _overload: Any = extending.overload

    @_overload(sqrt, jit_options={"forceinline": True})
    def _sqrt(x):
        # Compiled math.sqrt is a call that may set errno, which keeps a loop from being vectorized; this is one instruction.
        return lambda x: _sqrt_instruction(x)
