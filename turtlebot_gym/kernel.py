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


def kernel(function: F) -> F:
    """Let a compiled loop inline this function; calling it from Python runs it as plain Python."""
    return function if extending is None else extending.register_jitable(forceinline=True)(function)


def algebra(function: F) -> F:
    """Make a `kernel` whose numbers are finite and in which the sign of a zero is irrelevant.

    The compiler can then omit products with a constant zero. No other result changes, not even in the last bit.
    """
    return function if extending is None else extending.register_jitable(forceinline=True, fastmath={"nnan", "nsz"})(function)


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


def access(load: Callable, store: Callable, example: Any, leaves: Sequence[int | float | bool]) -> tuple[Callable, Callable]:
    """Let a compiled loop inline two functions that load and store a value, without compiling them from Python, which is slow.

    Args:
        load: ``load(buffer, at)``, as plain Python.
        store: ``store(buffer, at, value)``, as plain Python.
        example: A nested tuple of floats and bools.
        leaves: For each number its place relative to ``at``, with its bits inverted if it is not stored; or the number itself,
            a float or a bool, if it is a constant.
    """
    return load, store


prefer_wide: Any = None
"""``prefer_wide()`` asks for the widest vectors in the loops of the compiled function that calls it."""
compiled_scratch: Any = None
"""``compiled_scratch(size)`` returns room for ``size`` numbers, a constant, until the calling compiled function ends."""


def scratch(size: int) -> Any:
    """Return room for ``size`` numbers; see `compiled_scratch`."""
    return [0.0] * size


def borrowed(array: Any) -> Any:
    """Return an array without reference counting in a compiled loop; its owner must outlive the loop.

    Each count is an atomic operation on a counter that all threads share for all views of an array.
    """
    return array


if extending is not None:
    from llvmlite import ir
    from numba import float64, int64, typeof, types
    from numba.core import cgutils, errors
    from numba.np import arrayobj

    def _emit_sqrt(typing_context, x):
        def emit(context, builder, signature, arguments):
            return builder.call(builder.module.declare_intrinsic("llvm.sqrt", [arguments[0].type]), arguments)

        return float64(float64), emit

    _intrinsic: Any = extending.intrinsic
    _sqrt_instruction = _intrinsic(_emit_sqrt)
    _overload: Any = extending.overload

    @_overload(sqrt, jit_options={"forceinline": True})
    def _sqrt(x):
        # Compiled math.sqrt is a call that may set errno, which prevents vectorization; this is a single instruction.
        return lambda x: _sqrt_instruction(x)

    def _emitting(operation: str) -> Any:
        def typing(typing_context, a, b):
            def emit(context, builder, signature, arguments):
                return getattr(builder, operation)(*arguments)

            return int64(int64, int64), emit

        return _intrinsic(typing)

    # numba declares that its integers never overflow, and LLVM then drops masks that only matter on overflow.
    _multiply, _add = _emitting("mul"), _emitting("add")

    @_overload(times, jit_options={"forceinline": True})
    def _times(a, b):
        return lambda a, b: _multiply(int64(a), int64(b))

    @_overload(plus, jit_options={"forceinline": True})
    def _plus(a, b):
        return lambda a, b: _add(int64(a), int64(b))

    _TUPLE: Any = types.BaseTuple

    def _place(context, builder, signature, arguments):
        """Return the address of number ``at`` in a buffer."""
        data = context.make_array(signature.args[0])(context, builder, value=arguments[0]).data
        return builder.gep(data, [context.cast(builder, arguments[1], signature.args[1], types.intp)])

    def access(
        load: Callable, store: Callable, example: Any, leaves: Sequence[int | float | bool]
    ) -> tuple[Callable, Callable]:
        loaded = typeof(example)

        def type_load(typing_context, buffer, at):
            def emit(context, builder, signature, arguments):
                first, rest = _place(context, builder, signature, arguments), iter(leaves)

                def build(kind):
                    if isinstance(kind, _TUPLE):
                        return context.make_tuple(builder, kind, [build(one) for one in kind.types])
                    leaf = next(rest)
                    if not isinstance(leaf, int) or isinstance(leaf, bool):
                        return context.get_constant(kind, leaf)
                    number = builder.load(builder.gep(first, [context.get_constant(types.intp, max(leaf, ~leaf))]))
                    return builder.fcmp_unordered("!=", number, number.type(0.0)) if kind == types.boolean else number

                return build(loaded)

            return loaded(buffer, at), emit

        def type_store(typing_context, buffer, at, value):
            def emit(context, builder, signature, arguments):
                first, rest = _place(context, builder, signature, arguments), iter(leaves)

                def write(kind, part):
                    if isinstance(kind, _TUPLE):
                        for index, one in enumerate(kind.types):
                            write(one, builder.extract_value(part, index))
                        return
                    leaf = next(rest)
                    if isinstance(leaf, int) and not isinstance(leaf, bool) and leaf >= 0:
                        number = context.cast(builder, part, kind, float64)
                        builder.store(number, builder.gep(first, [context.get_constant(types.intp, leaf)]))

                write(signature.args[2], arguments[2])
                return context.get_dummy_value()

            return types.void(buffer, at, value), emit

        load_numbers, store_numbers = _intrinsic(type_load), _intrinsic(type_store)
        _overload(load, jit_options={"forceinline": True})(lambda buffer, at: lambda buffer, at: load_numbers(buffer, at))
        _overload(store, jit_options={"forceinline": True})(
            lambda buffer, at, value: lambda buffer, at, value: store_numbers(buffer, at, value)
        )
        return load, store

    def _emit_split(typing_context, x):
        def emit(context, builder, signature, arguments):
            bits = builder.bitcast(arguments[0], ir.IntType(64))
            exponent = builder.sub(builder.lshr(bits, bits.type(52)), bits.type(1022))
            half = builder.or_(builder.and_(bits, bits.type(0x000FFFFFFFFFFFFF)), bits.type(0x3FE0000000000000))
            parts = builder.bitcast(half, ir.DoubleType()), builder.sitofp(exponent, ir.DoubleType())
            return context.make_tuple(builder, signature.return_type, parts)

        return types.UniTuple(float64, 2)(float64), emit

    _split_bits = _intrinsic(_emit_split)

    @_overload(split, jit_options={"forceinline": True})
    def _split(x):
        return lambda x: _split_bits(x)

    def _emit_scratch(typing_context, size):
        if not isinstance(size, types.Literal):
            raise errors.RequireLiteralValue(size)
        count = size.literal_value

        def emit(context, builder, signature, arguments):
            with builder.goto_entry_block():
                room = builder.alloca(ir.DoubleType(), ir.Constant(ir.IntType(64), count))
                room.align = 64
            array = context.make_array(signature.return_type)(context, builder)
            shape = cgutils.pack_array(builder, [context.get_constant(types.intp, count)])
            strides = cgutils.pack_array(builder, [context.get_constant(types.intp, 8)])
            arrayobj.populate_array(array, room, shape, strides, context.get_constant(types.intp, 8), None)
            return array._getvalue()

        return types.Array(float64, 1, "C")(size), emit  # an overload's frame would end before its caller's

    compiled_scratch = _intrinsic(_emit_scratch)

    def _emit_wide(typing_context):
        def emit(context, builder, signature, arguments):
            set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite does not support such attributes
            return context.get_dummy_value()

        return types.void(), emit

    prefer_wide = _intrinsic(_emit_wide)

    def _emit_borrowed(typing_context, array):
        def emit(context, builder, signature, arguments):
            view = context.make_array(signature.args[0])(context, builder, value=arguments[0])
            view.meminfo, view.parent = view.meminfo.type(None), view.parent.type(None)
            return view._getvalue()

        return array(array), emit

    _without_owner = _intrinsic(_emit_borrowed)

    @_overload(borrowed, jit_options={"forceinline": True})
    def _borrowed(array):
        return lambda array: _without_owner(array)
