"""What stands for functions of Python, numpy and `turtlebot_gym.kernel` in translated kernels."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from turtlebot_gym import kernel
from turtlebot_gym.compiled.expressions import IN_PLACE, Span
from turtlebot_gym.compiled.statements import put
from turtlebot_gym.compiled.values import MEMORY, Array, Number, Untraceable, filled, is_constant, kind_of, numbers_of

LOW, HALF, WHOLE = 0x000FFFFFFFFFFFFF, 0x3FE0000000000000, 0x4330000000000000
"""The bits of a double's mantissa, and those of 0.5 and of 2^52."""


def _stands_for(*functions: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    def register(emit: Callable[..., Any]) -> Callable[..., Any]:
        IN_PLACE.update(dict.fromkeys(functions, emit))
        return emit

    return register


def _extreme(op: str, plain: Callable[..., Any]) -> Callable[..., Any]:
    def emit(body: Any, first: Any, *others: Any) -> Any:
        def one(a: Any, b: Any) -> Any:
            both = is_constant(a) and is_constant(b)
            return plain(a, b) if both else body.code.select(body.code.binary(op, b, a), b, a)

        return reduce(one, (first, *others) if others else first)

    return emit


IN_PLACE[min], IN_PLACE[max] = _extreme("<", min), _extreme(">", max)
for _kind, _types in {
    "i": (int, np.int64, np.int32, np.uint8, np.int8, np.uint16),
    "f": (float, np.float64),
    "b": (bool, np.bool_),
}.items():
    for _type in _types:
        IN_PLACE[_type] = lambda body, value, kind=_kind, type=_type: (
            body.code.converted(value, kind) if isinstance(value, Number) else type(value)
        )
IN_PLACE[math.sqrt] = IN_PLACE[np.sqrt] = IN_PLACE[kernel.sqrt] = lambda body, x: body.code.library("llvm.sqrt", x)
IN_PLACE[kernel.floor] = lambda body, x: body.code.library("llvm.floor", x)
for _name in ("exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "tanh", "pow", "copysign", "hypot"):
    IN_PLACE[getattr(math, _name)] = lambda body, *values, name=_name: body.code.library(name, *values)
for _name in ("floor", "ceil"):
    IN_PLACE[getattr(math, _name)] = lambda body, x, name=_name: body.code.converted(body.code.library(f"llvm.{name}", x), "i")


@_stands_for(np.float32)
def _single(body: Any, x: Any) -> Number:
    """Return a number rounded to what 32 bits hold."""
    single = body.code.put(f"fptrunc double {body.code.as_kind(x, 'f')} to float")
    return body.code.number("f", f"fpext float {single} to double")


@_stands_for(abs)
def _abs(body: Any, x: Any) -> Any:
    if is_constant(x):
        return abs(x)
    code = body.code
    return code.library("llvm.fabs", x) if x.kind == "f" else code.select(code.binary("<", x, 0), code.negative(x), x)


IN_PLACE[math.isnan] = lambda body, x: body.code.binary("!=", x, x)
IN_PLACE[math.isfinite] = lambda body, x: body.code.binary("<", _abs(body, x), math.inf)
IN_PLACE[math.isinf] = lambda body, x: body.code.binary("==", _abs(body, x), math.inf)


for _function, _text in {kernel.times: "mul i64 {}, {}", kernel.plus: "add i64 {}, {}"}.items():
    IN_PLACE[_function] = lambda body, a, b, text=_text: body.code.number(
        "i", text.format(body.code.as_kind(a, "i"), body.code.as_kind(b, "i"))
    )


@_stands_for(kernel.exactly)
def _exactly(body: Any, n: Any) -> Any:
    code = body.code
    return code.number("f", f"uitofp i32 {code.put('trunc i64 ' + code.as_kind(n, 'i') + ' to i32')} to double")


@_stands_for(kernel.fetch)
def _fetch(body: Any, array: Array, index: Any) -> None:
    code = body.code
    code.module.declared.add("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
    code.do(f"call void @llvm.prefetch.p0(ptr {code.item(array, index).address.name}, i32 0, i32 3, i32 1)")


@_stands_for(kernel.split)
def _split(body: Any, x: Any) -> Any:
    code = body.code
    bits = code.put(f"bitcast double {code.as_kind(x, 'f')} to i64")
    half = code.put(f"or i64 {code.put(f'and i64 {bits}, {LOW}')}, {HALF}")
    exponent = code.put(f"or i64 {code.put(f'lshr i64 {bits}, 52')}, {WHOLE}")  # those of 2^52 and the exponent
    shifted = code.binary("-", code.number("f", f"bitcast i64 {exponent} to double"), 2.0**52 + 1022.0)
    return code.number("f", f"bitcast i64 {half} to double"), shifted


for _name in ("thread", "threads"):
    IN_PLACE[getattr(kernel, _name)] = lambda body, name=_name: body.code.number("i", f"call i64 @{name}()")
IN_PLACE[kernel.is_plain] = lambda body: False


# Python: tuples exist only while a kernel is translated

for _function in (getattr, filled, numbers_of):
    IN_PLACE[_function] = lambda body, *values, function=_function: function(*values)
for _function in (tuple, zip, enumerate):
    IN_PLACE[_function] = lambda body, *values, function=_function, **options: tuple(function(*values, **options))
IN_PLACE[len] = lambda body, value: value.shape[0] if isinstance(value, Array) else len(value)
IN_PLACE[kernel.lanes] = lambda body, count: Span(0, count, 1, True)


@_stands_for(range)
def _range(body: Any, *bounds: Any) -> Span:
    return Span(0, bounds[0], 1) if len(bounds) == 1 else Span(*bounds, *((1,) if len(bounds) == 2 else ()))


def _strides(code: Any, sizes: tuple[Any, ...], element: str) -> tuple[Any, ...]:
    """Return the distances along the axes of adjacent numbers, and the size of all, in bytes."""
    strides = [MEMORY[element][1]]
    for size in sizes[::-1]:
        strides.append(code.binary("*", size, strides[-1]))
    return (*strides[-2::-1], strides[-1])


MOST_IN_FRAME = 1 << 16
"""Bytes of the largest array in a function's frame, which needs no allocator; its size must be a constant."""


def _new(fill: Any) -> Callable[..., Array]:
    def emit(body: Any, shape: Any, dtype: Any = np.float64) -> Array:
        code, element = body.code, np.dtype(dtype).name
        if element not in MEMORY:
            raise Untraceable(f"an array of {element}")
        sizes = shape if isinstance(shape, tuple) else (shape,)
        *strides, size = _strides(code, sizes, element)
        if is_constant(size) and size <= MOST_IN_FRAME:
            address = code.room("i8", size, 64)
        else:
            code.module.declared.add("declare ptr @malloc(i64)")
            address = code.put(f"call ptr @malloc(i64 {code.as_kind(size, 'i')})")
            body.own(address)
        array = Array(element, Number("p", address), sizes, tuple(strides))
        if fill is not None:
            put(body, array, fill)
        return array

    return emit


IN_PLACE[np.empty], IN_PLACE[np.zeros], IN_PLACE[np.ones] = _new(None), _new(0), _new(1)


@_stands_for(np.full)
def _full(body: Any, shape: Any, value: Any, dtype: Any = None) -> Array:
    return _new(value)(body, shape, dtype or {"f": np.float64, "i": np.int64, "b": np.bool_}[kind_of(value)])


IN_PLACE["fill"] = put


@_stands_for("copy")
def _copy(body: Any, array: Array) -> Array:
    return _new(array)(body, array.shape, array.element)


@_stands_for("reshape")
def _reshape(body: Any, array: Array, *lengths: Any) -> Array:
    """Return a row of adjacent numbers as a table, or as an array of more axes, of as many numbers."""
    if array.strides != (MEMORY[array.element][1],):
        raise Untraceable("another shape of an array that is not one row of adjacent numbers")
    shape = lengths[0] if isinstance(lengths[0], tuple) else lengths
    return Array(array.element, array.address, shape, _strides(body.code, shape, array.element)[:-1])
