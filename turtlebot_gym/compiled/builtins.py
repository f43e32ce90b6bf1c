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
from turtlebot_gym.compiled.values import HALF, LOW, MAGIC, MEMORY, Array, Number, Untraceable, is_constant


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
IN_PLACE[kernel.floor] = IN_PLACE[np.floor] = lambda body, x: body.code.library("llvm.floor", x)
for _name in (
    *("exp", "expm1", "log", "log1p", "log2", "log10", "sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sinh", "cosh", "tanh", "fmod", "pow", "copysign", "hypot"),
):
    IN_PLACE[getattr(math, _name)] = lambda body, *values, name=_name: body.code.library(name, *values)
IN_PLACE[np.hypot] = IN_PLACE[math.hypot]
for _name in ("floor", "ceil"):
    IN_PLACE[getattr(math, _name)] = lambda body, x, name=_name: _rounded(body, x, name)


def _rounded(body: Any, x: Any, name: str) -> Any:
    if is_constant(x):
        return getattr(math, name)(x)
    return body.code.converted(body.code.library(f"llvm.{name}", x), "i") if x.kind == "f" else x


@_stands_for(np.float32)
def _single(body: Any, x: Any) -> Any:
    """Return a number rounded to what 32 bits hold."""
    if is_constant(x):
        return np.float32(x)
    single = body.code.put(f"fptrunc double {body.code.as_kind(x, 'f')} to float")
    return body.code.number("f", f"fpext float {single} to double")


@_stands_for(abs, math.fabs)
def _abs(body: Any, x: Any) -> Any:
    code = body.code
    if is_constant(x) or x.kind == "f":
        return abs(x) if is_constant(x) else code.library("llvm.fabs", x)
    return code.select(code.binary("<", x, 0), code.negative(x), x)


@_stands_for(math.isnan)
def _is_nan(body: Any, x: Any) -> Any:
    return body.code.binary("!=", x, x)


@_stands_for(math.isfinite)
def _is_finite(body: Any, x: Any) -> Any:
    return body.code.binary("<", _abs(body, x), math.inf)


@_stands_for(math.isinf)
def _is_infinite(body: Any, x: Any) -> Any:
    return body.code.binary("==", _abs(body, x), math.inf)


# What kernels ask of the machine


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
    return code.library("llvm.fabs", _exact(code, name, 0))  # so LLVM knows, too, that it is not negative


@_stands_for(kernel.split)
def _split(body: Any, x: Any) -> Any:
    code = body.code
    bits = code.put(f"bitcast double {code.as_kind(x, 'f')} to i64")
    half = code.put(f"or i64 {code.put(f'and i64 {bits}, {LOW}')}, {HALF}")
    return code.number("f", f"bitcast i64 {half} to double"), _exact(code, code.put(f"lshr i64 {bits}, 52"), 1022)


IN_PLACE[kernel.thread] = lambda body: body.code.number("i", "call i64 @thread()")
IN_PLACE[kernel.threads] = lambda body: body.code.number("i", "call i64 @threads()")
IN_PLACE[kernel.is_plain] = lambda body: False


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
    return Array(element, Number("p", body.code.room(kind, int(size), 64)), (int(size),), (width,))


# Python

IN_PLACE[len] = lambda body, value: value.shape[0] if isinstance(value, Array) else len(value)
IN_PLACE[kernel.lanes] = lambda body, count: Span(0, count, 1, True)
IN_PLACE[getattr] = lambda body, value, name: getattr(value, name)
IN_PLACE[tuple] = IN_PLACE[list] = lambda body, value=(): tuple(value)
IN_PLACE[zip] = lambda body, *values, strict=False: tuple(zip(*values, strict=strict))


@_stands_for(range)
def _range(body: Any, *bounds: Any) -> Span:
    return Span(0, bounds[0], 1) if len(bounds) == 1 else Span(*bounds, *((1,) if len(bounds) == 2 else ()))


# New arrays, which live until the function returns


def _strides(code: Any, sizes: tuple[Any, ...], element: str) -> tuple[Any, ...]:
    """Return the distances along the axes of adjacent numbers, and the size of all, in bytes."""
    strides = [MEMORY[element][1]]
    for size in sizes[::-1]:
        strides.append(code.binary("*", size, strides[-1]))
    return (*strides[-2::-1], strides[-1])


def _new(fill: float | None) -> Callable[..., Array]:
    def emit(body: Any, shape: Any, dtype: Any = np.float64) -> Array:
        code, element = body.code, np.dtype(dtype).name
        if element not in MEMORY:
            raise Untraceable(f"an array of {element}")
        sizes = tuple(shape) if isinstance(shape, tuple) and not isinstance(shape, Number) else (shape,)
        *strides, size = _strides(code, sizes, element)
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
    own = {"f": np.float64, "i": np.int64, "b": np.bool_}[value.kind] if isinstance(value, Number) else np.asarray(value).dtype
    array = _new(None)(body, shape, dtype or own)
    put(body, array, value)
    return array


IN_PLACE["fill"] = put


@_stands_for("copy")
def _copy(body: Any, array: Array) -> Array:
    made = _new(None)(body, array.shape, array.element)
    put(body, made, array)
    return made


@_stands_for("reshape")
def _reshape(body: Any, array: Array, *lengths: Any) -> Array:
    """Return a row of adjacent numbers as a table, or as an array of more axes, of as many numbers."""
    if array.strides != (MEMORY[array.element][1],):
        raise Untraceable("another shape of what is not one row of adjacent numbers")
    shape = lengths[0] if isinstance(lengths[0], tuple) and not isinstance(lengths[0], Number) else lengths
    return Array(array.element, array.address, tuple(shape), _strides(body.code, tuple(shape), array.element)[:-1])
