"""What the compiler of loops works on: numbers of machine code, arrays, and nested tuples of both and of constants.

Kinds of numbers are "f" (double), "i" (64-bit integer), "b" (truth) and "p" (the address of an array). A Python number is a
constant.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


class Untraceable(Exception):
    """A kernel does what cannot be compiled; the message says what."""


LLVM = {"f": "double", "i": "i64", "b": "i1", "p": "ptr"}


@dataclass(slots=True)
class Number:
    """A number that is known when the code runs."""

    kind: str
    name: str = ""
    natural: bool = False
    """Whether it is a whole number that is known not to be negative: an index that counts from the start."""


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
    "int8": ("i8", 1, "i"),
    "uint16": ("i16", 2, "i"),
    "uint8": ("i8", 1, "i"),
    "bool": ("i8", 1, "b"),
}
"""LLVM's type of an array's element, its size in bytes, and the kind of number that it is loaded as."""


def kind_of(value: Any) -> str:
    """Return the kind of a number or a constant."""
    if isinstance(value, Number):
        return value.kind
    for kind, types in (("b", (bool, np.bool_)), ("i", (int, np.integer)), ("f", (float, np.floating))):
        if isinstance(value, types):
            return kind
    raise Untraceable(f"a value of the type {type(value).__name__} among numbers")


def is_constant(value: Any) -> bool:
    return isinstance(value, (bool, int, float, np.generic))


def is_number(value: Any) -> bool:
    return isinstance(value, Number) or is_constant(value)


def is_natural(value: Any) -> bool:
    return value.natural if isinstance(value, Number) else value >= 0


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


def numbers_of(value: Any) -> list[Any]:
    """Return what stands in a nested tuple, in order."""
    return [number for item in value for number in numbers_of(item)] if isinstance(value, tuple) else [value]


def filled(like: Any, numbers: Iterable[Any]) -> Any:
    """Return a nested tuple with others in place of what stands in it, in order."""
    left = iter(numbers)

    def part(like: Any) -> Any:
        return tuple_like(like, [part(item) for item in like]) if isinstance(like, tuple) else next(left)

    return part(like)


def rebuilt(value: Any, leaf: Callable[[Any], Any]) -> Any:
    """Return a nested tuple with others in place of the numbers that are known when the code runs."""
    if isinstance(value, tuple):
        return tuple_like(value, [rebuilt(item, leaf) for item in value])
    return leaf(value) if isinstance(value, Number) else value


def leaves(value: Any) -> list[Number]:
    """Return the numbers that are known when the code runs, in order."""
    return [item for item in numbers_of(value) if isinstance(item, Number)]


def kinds_of(value: Any) -> list[str]:
    """Return LLVM's types of the leaves of a value."""
    return [LLVM[leaf.kind] for leaf in leaves(value)]


def named_of(value: Any) -> str:
    """Return the leaves of a value, each with its type, as LLVM has them in an argument."""
    return ", ".join(f"{LLVM[leaf.kind]} {leaf.name}" for leaf in leaves(value))


def renamed(value: Any, names: Iterator[str]) -> Any:
    """Return a value with other names of its leaves."""
    return rebuilt(value, lambda leaf: Number(leaf.kind, next(names)))


def form_of(value: Any) -> Any:
    """Return the form of a value: what a variable or an argument can hold, with numbers in place of its constants."""
    if isinstance(value, np.ndarray):
        strides = [Number("i")] * value.ndim
        last = [value.itemsize] if value.strides[-1:] == (value.itemsize,) else strides[-1:]
        return Array(value.dtype.name, Number("p"), (Number("i"),) * value.ndim, (*strides[:-1], *last))
    if isinstance(value, Array):
        strides = tuple(part if isinstance(part, int) else Number("i") for part in value.strides)
        return Array(value.element, Number("p"), (Number("i"),) * len(value.shape), strides)
    if isinstance(value, tuple):
        return tuple_like(value, [form_of(item) for item in value])
    return Number(kind_of(value)) if is_number(value) else value


def key_of(value: Any) -> Any:
    """Return what tells the form of a value from all others."""
    if isinstance(value, tuple):
        return (type(value), *map(key_of, value))
    if isinstance(value, Number):
        return value.kind
    return (type(value), value) if isinstance(value, Hashable) else id(value)
