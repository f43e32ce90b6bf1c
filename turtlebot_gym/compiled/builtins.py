"""What stands for functions of Python, numpy and `turtlebot_gym.kernel` in translated kernels."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from turtlebot_gym import kernel
from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.expressions import IN_PLACE, Span
from turtlebot_gym.compiled.statements import put
from turtlebot_gym.compiled.values import HALF, LOW, MAGIC, MEMORY, Address, Array, Number, Untraceable, is_constant, kind_of


def _stands_for(*functions: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    def register(emit: Callable[..., Any]) -> Callable[..., Any]:
        for function in functions:
            IN_PLACE[function] = emit
        return emit

    return register


def _extreme(op: str) -> Callable[..., Any]:
    def emit(body: Any, first: Any, *others: Any) -> Any:
        items = (first, *others) if others else first
        code = body.code

        def one(a: Any, b: Any) -> Any:
            if is_constant(a) and is_constant(b):
                return {"<": min, ">": max}[op](a, b)
            return code.select(code.binary(op, b, a), b, a)

        return reduce(one, items)

    return emit


IN_PLACE[min], IN_PLACE[max] = _extreme("<"), _extreme(">")


def _conversion(kind: str, plain: Callable[[Any], Any]) -> Callable[..., Any]:
    return lambda body, value: body.code.converted(value, kind) if isinstance(value, Number) else plain(value)


for _function in (int, np.int64, np.int32, np.uint8, np.int8, np.uint16):
    IN_PLACE[_function] = _conversion("i", int)
for _function in (float, np.float64):
    IN_PLACE[_function] = _conversion("f", float)
IN_PLACE[np.float32] = _conversion("s", np.float32)
IN_PLACE[bool] = IN_PLACE[np.bool_] = _conversion("b", bool)


@_stands_for(abs, math.fabs)
def _abs(body: Any, x: Any) -> Any:
    if is_constant(x):
        return abs(x)
    code = body.code
    return code.intrinsic("fabs", x) if x.kind in "fs" else code.select(code.binary("<", x, 0), code.negative(x), x)


@_stands_for(math.sqrt, kernel.sqrt, np.sqrt)
def _sqrt(body: Any, x: Any) -> Any:
    return math.sqrt(x) if is_constant(x) else body.code.intrinsic("sqrt", x)


def _rounded(name: str) -> Callable[..., Any]:
    def emit(body: Any, x: Any) -> Any:
        if is_constant(x):
            return getattr(math, name)(x)
        return body.code.converted(body.code.intrinsic(name, x), "i") if x.kind in "fs" else x

    return emit


IN_PLACE[math.floor], IN_PLACE[math.ceil] = _rounded("floor"), _rounded("ceil")


@_stands_for(kernel.floor, np.floor)
def _floor(body: Any, x: Any) -> Any:
    return body.code.intrinsic("floor", x)


@_stands_for(math.isnan)
def _is_nan(body: Any, x: Any) -> Any:
    return math.isnan(x) if is_constant(x) else body.code.compare("!=", x, x, x.kind)


@_stands_for(math.isfinite)
def _is_finite(body: Any, x: Any) -> Any:
    return math.isfinite(x) if is_constant(x) else body.code.binary("<", _abs(body, x), math.inf)


@_stands_for(math.isinf)
def _is_infinite(body: Any, x: Any) -> Any:
    return math.isinf(x) if is_constant(x) else body.code.binary("==", _abs(body, x), math.inf)


for _name in (
    *("exp", "expm1", "log", "log1p", "log2", "log10", "sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sinh", "cosh", "tanh", "fmod", "pow", "copysign", "hypot"),
):
    IN_PLACE[getattr(math, _name)] = lambda body, *values, name=_name: body.code.library(name, *values)
IN_PLACE[np.hypot] = IN_PLACE[math.hypot]


@_stands_for(kernel.times)
def _times(body: Any, a: Any, b: Any) -> Any:
    return body.code.number("i", f"mul i64 {body.code.as_kind(a, 'i')}, {body.code.as_kind(b, 'i')}")


@_stands_for(kernel.plus)
def _plus(body: Any, a: Any, b: Any) -> Any:
    return body.code.number("i", f"add i64 {body.code.as_kind(a, 'i')}, {body.code.as_kind(b, 'i')}")


def _exact(code: Any, bits: str, less: int) -> Number:
    number = code.put(f"bitcast i64 {code.put(f'or i64 {bits}, {MAGIC}')} to double")
    return code.binary("-", Number("f", number), float((1 << 52) + less))


@_stands_for(kernel.exactly)
def _exactly(body: Any, n: Any) -> Any:
    if is_constant(n):
        return float(n)
    code, name = body.code, body.code.as_kind(n, "i")
    if native.has("avx512dq"):
        return code.number("f", f"uitofp nneg i64 {name} to double")
    return code.intrinsic("fabs", _exact(code, name, 0))  # so LLVM knows, too, that it is not negative


@_stands_for(kernel.split)
def _split(body: Any, x: Any) -> Any:
    code = body.code
    bits = code.put(f"bitcast double {code.as_kind(x, 'f')} to i64")
    half = code.put(f"or i64 {code.put(f'and i64 {bits}, {LOW}')}, {HALF}")
    return code.number("f", f"bitcast i64 {half} to double"), _exact(code, code.put(f"lshr i64 {bits}, 52"), 1022)


IN_PLACE[kernel.thread] = lambda body: body.code.number("i", "call i64 @thread()")
IN_PLACE[kernel.threads] = lambda body: body.code.number("i", "call i64 @threads()")


@_stands_for(kernel.is_plain)
def _is_plain(body: Any) -> bool:
    return False


@_stands_for(kernel.prefer_wide)
def _prefer_wide(body: Any) -> None:
    body.code.module.wide = True


@_stands_for(kernel.fetch)
def _fetch(body: Any, array: Array, index: Any) -> None:
    code = body.code
    code.module.declared.add("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
    place = code.moved(array.address, index, array.strides[-1])
    code.do(f"call void @llvm.prefetch.p0(ptr {place.name}, i32 0, i32 3, i32 1)")


@_stands_for(kernel.compiled_scratch)
def _scratch(body: Any, size: int, element: str = "float64") -> Array:
    kind, width, _ = MEMORY[element]
    return Array(element, Address(body.code.room(kind, int(size), 64)), (int(size),), (width,))


@_stands_for(len)
def _length(body: Any, value: Any) -> Any:
    return value.shape[0] if isinstance(value, Array) else len(value)


@_stands_for(range)
def _range(body: Any, *bounds: Any) -> Span:
    return Span(0, bounds[0], 1) if len(bounds) == 1 else Span(bounds[0], bounds[1], bounds[2] if len(bounds) > 2 else 1)


@_stands_for(kernel.lanes)
def _lanes(body: Any, count: Any) -> Span:
    return Span(0, count, 1, True)


@_stands_for(getattr)
def _getattr(body: Any, value: Any, name: str) -> Any:
    return getattr(value, name)


@_stands_for(tuple, list)
def _tuple(body: Any, value: Any = ()) -> Any:
    return tuple(value)


@_stands_for(zip)
def _zip(body: Any, *values: Any, strict: bool = False) -> Any:
    return tuple(zip(*values, strict=strict))


# New arrays


def _element(kind: Any) -> str:
    name = np.dtype(kind).name
    if name not in MEMORY:
        raise Untraceable(f"an array of {name}")
    return name


def _strides(code: Any, sizes: tuple[Any, ...], element: str) -> tuple[Any, ...]:
    """Return the distances along the axes of adjacent numbers, and the size of all, in bytes."""
    strides = [MEMORY[element][1]]
    for size in sizes[::-1]:
        strides.append(code.binary("*", size, strides[-1]))
    return (*strides[-2::-1], strides[-1])


def _new(body: Any, shape: Any, element: str) -> Array:
    """Return an array that lives until the function returns."""
    code = body.code
    sizes = tuple(shape) if isinstance(shape, (tuple, list)) and not isinstance(shape, Number) else (shape,)
    *strides, size = _strides(code, sizes, element)
    code.module.declared.add("declare ptr @malloc(i64)")
    address = code.put(f"call ptr @malloc(i64 {code.as_kind(size, 'i')})")
    body.own(address)
    return Array(element, Address(address), sizes, tuple(strides))


@_stands_for(np.empty)
def _empty(body: Any, shape: Any, dtype: Any = np.float64) -> Array:
    return _new(body, shape, _element(dtype))


def _filled(value: float) -> Callable[..., Any]:
    def emit(body: Any, shape: Any, dtype: Any = np.float64) -> Array:
        array = _new(body, shape, _element(dtype))
        put(body, array, value)
        return array

    return emit


IN_PLACE[np.zeros], IN_PLACE[np.ones] = _filled(0), _filled(1)


@_stands_for(np.full)
def _full(body: Any, shape: Any, value: Any, dtype: Any = None) -> Array:
    element = {"f": "float64", "s": "float32", "i": "int64", "b": "bool"}[kind_of(value)] if dtype is None else _element(dtype)
    array = _new(body, shape, element)
    put(body, array, value)
    return array


def _copy(body: Any, array: Array) -> Array:
    made = _new(body, array.shape, array.element)
    put(body, made, array)
    return made


def _fill(body: Any, array: Array, value: Any) -> None:
    put(body, array, value)


def _reshape(body: Any, array: Array, *lengths: Any) -> Array:
    """Return a row of adjacent numbers as a table, or as an array of more axes, of as many numbers."""
    if array.strides != (MEMORY[array.element][1],):
        raise Untraceable("another shape of what is not one row of adjacent numbers")
    shape = lengths[0] if isinstance(lengths[0], tuple) and not isinstance(lengths[0], Number) else lengths
    return Array(array.element, array.address, tuple(shape), _strides(body.code, tuple(shape), array.element)[:-1])


IN_PLACE["copy"], IN_PLACE["fill"], IN_PLACE["reshape"] = _copy, _fill, _reshape
