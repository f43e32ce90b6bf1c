"""What the compiler of loops works on: numbers of machine code, arrays, and nested tuples of both and of constants.

Kinds of numbers are "f" (double), "i" (64-bit integer), "b" (truth) and "p" (the address of an array). A Python number is a
constant.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np


class Untraceable(Exception):
    """A kernel does what cannot be compiled; the message says what."""


LLVM = {"f": "double", "i": "i64", "b": "i1", "p": "ptr"}
LOW, HALF = 0x000FFFFFFFFFFFFF, 0x3FE0000000000000
"""The bits of a double's mantissa, and those of 0.5."""
MAGIC = 0x4330000000000000
"""The bits of 2^52, in whose last places a whole number stands."""


class Number(NamedTuple):
    """A number that is known when the code runs."""

    kind: str
    name: str


class Array(NamedTuple):
    """A strided array."""

    element: str
    """numpy's name of the type of its elements."""
    address: Number
    shape: tuple[Any, ...]
    strides: tuple[Any, ...]
    """In bytes."""


MEMORY = {
    "float64": ("double", 8, "f"),
    "float32": ("float", 4, "f"),
    "int64": ("i64", 8, "i"),
    "int32": ("i32", 4, "i"),
    "int16": ("i16", 2, "i"),
    "int8": ("i8", 1, "i"),
    "uint64": ("i64", 8, "i"),
    "uint32": ("i32", 4, "i"),
    "uint16": ("i16", 2, "i"),
    "uint8": ("i8", 1, "i"),
    "bool": ("i8", 1, "b"),
}
"""LLVM's type of an array's element, its size in bytes, and the kind of number that it is loaded as."""


def kind_of(value: Any) -> str:
    """Return the kind of a number or a constant."""
    if type(value) is Number:
        return value.kind
    for kind, types in (("b", (bool, np.bool_)), ("i", (int, np.integer)), ("f", (float, np.floating))):
        if isinstance(value, types):
            return kind
    raise Untraceable(f"a value of the type {type(value).__name__} among numbers")


def is_number(value: Any) -> bool:
    return isinstance(value, (Number, bool, int, float, np.generic))


def is_constant(value: Any) -> bool:
    return is_number(value) and not isinstance(value, Number)


def signed(value: int) -> int:
    """Return an integer modulo 2^64, from -2^63 on."""
    return (value + (1 << 63)) % (1 << 64) - (1 << 63)


def constant(value: Any, kind: str) -> str:
    """Return LLVM's text of a constant."""
    if kind == "i":
        return str(signed(int(value)))
    if kind == "b":
        return "true" if value else "false"
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def wider(a: str, b: str) -> str:
    """Return the kind that holds numbers of two kinds."""
    return a if a == b else "f" if "f" in (a, b) else "i"


def tuple_like(value: tuple[Any, ...], items: Sequence[Any]) -> Any:
    """Return a tuple of other items, with the names of a tuple."""
    return type(value)(*items) if hasattr(value, "_fields") else tuple(items)


def rebuilt(value: Any, leaf: Callable[[Number], Any]) -> Any:
    """Return a value with others for what is known when the code runs."""
    if type(value) is Number:
        return leaf(value)
    return tuple_like(value, [rebuilt(item, leaf) for item in value]) if isinstance(value, tuple) else value


def leaves(value: Any) -> list[Number]:
    """Return what is known when the code runs, in order."""
    found: list[Any] = []
    rebuilt(value, found.append)
    return found


def kinds_of(value: Any) -> list[str]:
    """Return LLVM's types of the leaves of a value."""
    return [LLVM[leaf.kind] for leaf in leaves(value)]


def named_of(value: Any) -> str:
    """Return the leaves of a value, each with its type, as LLVM has them in an argument."""
    return ", ".join(f"{LLVM[leaf.kind]} {leaf.name}" for leaf in leaves(value))


def renamed(value: Any, name: Callable[[], str]) -> Any:
    """Return a value with other names of its leaves."""
    return rebuilt(value, lambda leaf: Number(leaf.kind, name()))


def as_runtime(value: Any) -> Any:
    """Return a value with numbers in place of its constants, without names: what a variable or an argument can hold."""
    if isinstance(value, np.ndarray):
        strides = [Number("i", "")] * value.ndim
        last = [value.itemsize] if value.strides[-1:] == (value.itemsize,) else strides[-1:]
        value = Array(value.dtype.name, Number("p", ""), tuple(strides), (*strides[:-1], *last))
    if isinstance(value, Array):
        strides = tuple(part if isinstance(part, int) else Number("i", "") for part in value.strides)
        return Array(value.element, Number("p", ""), (Number("i", ""),) * len(value.shape), strides)
    if isinstance(value, tuple) and not isinstance(value, Number):
        return tuple_like(value, [as_runtime(item) for item in value])
    return Number(kind_of(value), "") if is_number(value) else value


def key_of(value: Any) -> Any:
    """Return what tells the form of a value from all others."""
    if isinstance(value, Number):
        return value.kind
    if isinstance(value, tuple):
        return (type(value), *map(key_of, value))
    if isinstance(value, float):
        return ("float", struct.pack("d", value))
    return (type(value), value) if isinstance(value, Hashable) else id(value)


def merged_form(a: Any, b: Any) -> Any:
    """Return the form of a variable that holds values of two forms, see `as_runtime`."""
    if isinstance(a, Number) and isinstance(b, Number):
        return Number(wider(a.kind, b.kind), "")
    if isinstance(a, Array) and isinstance(b, Array) and a.element == b.element and len(a.shape) == len(b.shape):
        strides = tuple(x if x == y else Number("i", "") for x, y in zip(a.strides, b.strides, strict=True))
        return Array(a.element, Number("p", ""), a.shape, strides)
    if type(a) is type(b) and isinstance(a, tuple) and len(a) == len(b) and not isinstance(a, (Number, Array)):
        return tuple_like(a, [merged_form(x, y) for x, y in zip(a, b, strict=True)])
    if key_of(a) == key_of(b):
        return a
    raise Untraceable(f"a variable that holds {type(a).__name__} and {type(b).__name__}")
