"""What `kernel` needs from numba and LLVM: ways to register a function, and single instructions and buffers below Python.

Without numba this module cannot be imported; `kernel` then uses plain Python alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from inspect import signature
from typing import Any

from llvmlite import ir
from numba import extending, float64, int64, typeof, types
from numba.core import cgutils, errors
from numba.np import arrayobj

_extending: Any = extending
_intrinsic: Any = extending.intrinsic
_TUPLE: Any = types.BaseTuple


_INLINED: dict[str, Any] = {"forceinline": True, "no_cfunc_wrapper": True}
"""Options of all functions that compiled loops inline."""
with suppress(ImportError):  # a numba whose insides differ takes longer
    from turtlebot_gym.inlining import Inlined

    _INLINED["pipeline_class"] = Inlined


def inline(function: Callable, **options: Any) -> None:
    """Let compiled loops inline a function."""
    extending.register_jitable(**_INLINED, **options)(function)


def overload(function: Callable, make: Callable[..., Callable], *, strict: bool = True) -> None:
    """Let compiled loops inline what ``make`` returns in place of a function."""
    _extending.overload(function, jit_options=_INLINED, strict=strict)(make)


def replace(function: Callable, emitting: Callable[..., Any]) -> None:
    """Let compiled functions emit an intrinsic's instructions in place of a call of a function, in the frame of the caller."""
    parameters = list(signature(emitting).parameters.values())[1:]  # the first one is the context

    @extending.type_callable(function)
    def type_function(context):
        def type_call(*arguments):
            kind, emit = emitting(context, *arguments)
            extending.lower_builtin(function, *kind.args)(emit)
            return kind

        type_call.pysig = signature(emitting).replace(parameters=parameters)  # type: ignore[attr-defined]
        return type_call


def _emit_sqrt(typing_context, x):
    def emit(context, builder, signature, arguments):
        return builder.call(builder.module.declare_intrinsic("llvm.sqrt", [arguments[0].type]), arguments)

    return float64(float64), emit


def _emit_floor(typing_context, x):
    def emit(context, builder, signature, arguments):
        whole = builder.call(builder.module.declare_intrinsic("llvm.floor", [arguments[0].type]), arguments)
        return builder.fadd(whole, whole.type(0.0))  # no integer is a negative zero

    return float64(float64), emit


def _exact(builder, number, less):
    """Return the float of a 64-bit integer from 0 to 2^52 - 1, less another one: as the significand of a larger number."""
    number = builder.bitcast(builder.or_(number, number.type(0x433 << 52)), ir.DoubleType())
    return builder.fsub(number, number.type(float((1 << 52) + less)))


def _emit_exactly(typing_context, n):
    def emit(context, builder, signature, arguments):
        return _exact(builder, arguments[0], 0)

    return float64(int64), emit


def _emitting(operation: str) -> Any:
    def typing(typing_context, a, b):
        def emit(context, builder, signature, arguments):
            return getattr(builder, operation)(*arguments)

        return int64(int64, int64), emit

    return _intrinsic(typing)


def _emit_split(typing_context, x):
    def emit(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(64))
        half = builder.or_(builder.and_(bits, bits.type(0x000FFFFFFFFFFFFF)), bits.type(0x3FE0000000000000))
        parts = builder.bitcast(half, ir.DoubleType()), _exact(builder, builder.lshr(bits, bits.type(52)), 1022)
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(float64, 2)(float64), emit


def emit_scratch(typing_context, size):
    """Emit `kernel.compiled_scratch`."""
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


def emit_wide(typing_context):
    """Emit `kernel.prefer_wide`."""

    def emit(context, builder, signature, arguments):
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')  # llvmlite does not support such attributes
        return context.get_dummy_value()

    return types.void(), emit


def _emit_borrowed(typing_context, array):
    def emit(context, builder, signature, arguments):
        view = context.make_array(signature.args[0])(context, builder, value=arguments[0])
        view.meminfo, view.parent = view.meminfo.type(None), view.parent.type(None)
        return view._getvalue()

    return array(array), emit


def _emit_fetch(typing_context, array, index):
    def emit(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, value=arguments[0]).data
        line = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(8).as_pointer())
        flag, kind = ir.IntType(32), ir.FunctionType(ir.VoidType(), [line.type, *[ir.IntType(32)] * 3])
        prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        builder.call(prefetch, [line, flag(0), flag(3), flag(1)])  # to read, into the nearest cache, data
        return context.get_dummy_value()

    return types.void(array, int64), emit


def _emit_call(typing_context, address, arguments):
    def emit(context, builder, signature, values):
        kinds = tuple(arguments.types)
        kind_of_function = context.call_conv.get_function_type(types.none, kinds).as_pointer()
        function = builder.inttoptr(values[0], kind_of_function)
        items = [builder.extract_value(values[1], at) for at in range(len(kinds))]
        status, _ = context.call_conv.call_function(builder, function, types.none, kinds, items)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.none(int64, arguments), emit


def _place(context, builder, signature, arguments):
    data = context.make_array(signature.args[0])(context, builder, value=arguments[0]).data
    return builder.gep(data, [context.cast(builder, arguments[1], signature.args[1], types.intp)])


def loading(example: Any, leaves: Sequence[int]) -> Callable[..., Any]:
    """Return the intrinsic ``load(buffer, at)`` of a value, each of whose numbers has a place relative to ``at``."""
    loaded = typeof(example)

    def type_load(typing_context, buffer, at):
        def emit(context, builder, signature, arguments):
            first, rest = _place(context, builder, signature, arguments), iter(leaves)

            def build(kind):
                if isinstance(kind, _TUPLE):
                    return context.make_tuple(builder, kind, [build(item) for item in kind.types])
                number = builder.load(builder.gep(first, [context.get_constant(types.intp, next(rest))]))
                return builder.fcmp_unordered("!=", number, number.type(0.0)) if kind == types.boolean else number

            return build(loaded)

        return loaded(buffer, at), emit

    return _intrinsic(type_load)


def storing(leaves: Sequence[int]) -> Callable[..., Any]:
    """Return the intrinsic ``store(buffer, at, value)`` of such a value."""

    def type_store(typing_context, buffer, at, value):
        def emit(context, builder, signature, arguments):
            first, rest = _place(context, builder, signature, arguments), iter(leaves)

            def write(kind, part):
                if isinstance(kind, _TUPLE):
                    for index, item in enumerate(kind.types):
                        write(item, builder.extract_value(part, index))
                    return
                number = context.cast(builder, part, kind, float64)
                builder.store(number, builder.gep(first, [context.get_constant(types.intp, next(rest))]))

            write(signature.args[2], arguments[2])
            return context.get_dummy_value()

        return types.void(buffer, at, value), emit

    return _intrinsic(type_store)


square_root = _intrinsic(_emit_sqrt)
floor, exactly = _intrinsic(_emit_floor), _intrinsic(_emit_exactly)
# numba declares that its integers never overflow, and LLVM then drops masks that only matter on overflow.
multiply, add = _emitting("mul"), _emitting("add")
split_bits = _intrinsic(_emit_split)
without_owner = _intrinsic(_emit_borrowed)
fetch = _intrinsic(_emit_fetch)
call = _intrinsic(_emit_call)
