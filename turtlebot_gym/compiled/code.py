"""Instructions for LLVM, one at a time: arithmetic of Python's numbers, and the memory of arrays.

The bits are those of plain Python: nothing is reordered or contracted, and only in a kernel of `kernel.algebra` a product with
a constant zero is zero.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from turtlebot_gym.compiled.values import (
    LLVM,
    MEMORY,
    Address,
    Array,
    Number,
    Untraceable,
    constant,
    is_constant,
    kind_of,
    signed,
    wider,
)

_FLOAT = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_WHOLE = {"+": "add nsw", "-": "sub nsw", "*": "mul nsw", "&": "and", "|": "or", "^": "xor", "<<": "shl", ">>": "ashr"}
_COMPARED = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "!=": "ne"}
_FOLDED: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "//": operator.floordiv,
    "%": operator.mod,
    "**": operator.pow,
    "&": operator.and_,
    "|": operator.or_,
    "^": operator.xor,
    "<<": operator.lshift,
    ">>": operator.rshift,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


class Module:
    """The functions of a program, and what they share."""

    def __init__(self) -> None:
        self.functions: list[str] = []
        self.declared: set[str] = set()
        self.types: dict[tuple[str, ...], str] = {}
        self.wide = False
        """Whether loops ask for the widest vectors."""
        self.notes: list[str] = []
        """Metadata: of loops whose rounds share nothing."""
        self._count = itertools.count()

    def fresh(self, name: str) -> str:
        return f"{name}{next(self._count)}"

    def structure(self, kinds: Sequence[str]) -> str:
        """Return the name of a type for several numbers."""
        return self.types.setdefault(tuple(kinds), f"%t{len(self.types)}") if kinds else "void"

    def text(self) -> str:
        wide = ' "prefer-vector-width"="512"' if self.wide else ""
        notes = [f"!{at} = {text}" for at, text in enumerate(self.notes)]
        types = [f"{name} = type {{ {', '.join(kinds)} }}" for kinds, name in self.types.items()]
        return "\n".join([*types, *self.functions, *sorted(self.declared), f"attributes #0 = {{ nounwind{wide} }}", *notes, ""])

    def note(self, text: str) -> int:
        """Return the number of new metadata."""
        self.notes.append(text)
        return len(self.notes) - 1

    def independent(self) -> tuple[str, str]:
        """Return what marks memory that the rounds of a loop do not share, and what marks its jump back."""
        group, loop = self.note("distinct !{}"), len(self.notes) + 3
        parts = [f'!{{!"llvm.loop.parallel_accesses", !{group}}}', '!{!"llvm.loop.vectorize.enable", i1 true}']
        parts.append('!{!"llvm.loop.vectorize.width", i32 8}')
        inner = ", ".join(f"!{self.note(part)}" for part in parts)
        self.note(f"distinct !{{!{loop}, {inner}}}")
        return f", !llvm.access.group !{group}", f", !llvm.loop !{loop}"


class Code:
    """The instructions of a function.

    Args:
        module: Takes the function.
        loose: Whether it is `kernel.algebra`.
    """

    def __init__(self, module: Module, *, loose: bool = False) -> None:
        self.module, self.flags = module, " nnan nsz" if loose else ""
        self.lines: list[str] = []
        self.entry: list[str] = []
        """Instructions at the beginning: room for variables."""
        self.block, self.alive = "entry", True
        self.group = ""
        """Mark of memory in a loop whose rounds share nothing."""

    def do(self, text: str) -> None:
        if self.alive:
            touches = self.group and ("load " in text or "store " in text or ("call " in text and "@llvm" not in text))
            self.lines.append(f"  {text}{self.group if touches else ''}")

    def put(self, text: str) -> str:
        name = self.module.fresh("%v")
        self.do(f"{name} = {text}")
        return name

    def number(self, kind: str, text: str) -> Number:
        return Number(kind, self.put(text))

    def room(self, kind: str, count: int = 1, align: int = 8) -> str:
        """Return the address of room in the function's frame."""
        name = self.module.fresh("%r")
        many = f", i64 {count}" if count > 1 else ""
        self.entry.append(f"  {name} = alloca {LLVM.get(kind, kind)}{many}, align {align}")
        return name

    def label(self, name: str) -> None:
        self.lines.append(f"{name}:")
        self.block, self.alive = name, True

    def jump(self, label: str) -> None:
        self.do(f"br label %{label}")
        self.alive = False

    def fork(self, condition: Any, then: str, other: str) -> None:
        self.do(f"br i1 {self.as_kind(condition, 'b')}, label %{then}, label %{other}")
        self.alive = False

    @contextmanager
    def aside(self) -> Iterator[list[str]]:
        """Collect instructions in a list of their own."""
        before, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = before

    # Numbers

    def as_kind(self, value: Any, kind: str) -> str:
        """Return LLVM's name of a number converted to a kind."""
        own = kind_of(value)
        if is_constant(value):
            return constant(value != 0 if kind == "b" else value, kind)
        if own == kind:
            return value.name
        given, to = LLVM[own], LLVM[kind]
        if kind == "b":
            zero = "icmp ne i64 {}, 0" if own == "i" else f"fcmp une {given} {{}}, 0.0"
            return self.put(zero.format(value.name))
        if own == "b" and kind in "fs":
            return self.put(f"select i1 {value.name}, {to} 1.0, {to} 0.0")
        verb = {
            "bi": "zext", "if": "sitofp", "is": "sitofp", "fi": "fptosi", "si": "fptosi",
            "sf": "fpext", "fs": "fptrunc",
        }[own + kind]  # fmt: skip
        return self.put(f"{verb} {given} {value.name} to {to}")

    def converted(self, value: Any, kind: str) -> Any:
        """Return a number converted to a kind."""
        if kind_of(value) == kind and not is_constant(value):
            return value
        return Number(kind, self.as_kind(value, kind))

    def binary(self, op: str, a: Any, b: Any) -> Any:
        """Return the result of an operator of Python."""
        if is_constant(a) and is_constant(b) and not (op in ("/", "//", "%") and b == 0):
            value = _FOLDED[op](a, b)
            return signed(value) if type(value) is int else value
        kinds = kind_of(a), kind_of(b)
        kind = wider(*kinds)
        if op in _COMPARED:
            return self.compare(op, a, b, "i" if kind == "b" else kind)
        if op in "&|^" and kind == "b":
            return self.number("b", f"{_WHOLE[op]} i1 {self.as_kind(a, 'b')}, {self.as_kind(b, 'b')}")
        kind = "i" if kind == "b" else kind
        if op == "**":
            return self.power(a, b)
        if op == "/":
            kind = "f" if kind == "i" else kind
        if op in ("//", "%") and kind == "i":
            return self.divided(op, self.as_kind(a, "i"), self.as_kind(b, "i"))
        x, y, own = self.as_kind(a, kind), self.as_kind(b, kind), LLVM[kind]
        if kind == "i":
            return self.number("i", f"{_WHOLE[op]} i64 {x}, {y}")
        if op == "%":
            rest = self.put(f"frem {own} {x}, {y}")
            differs = self.put(f"fcmp olt {own} {self.put(f'fmul {own} {rest}, {y}')}, 0.0")
            return self.number(kind, f"select i1 {differs}, {own} {self.put(f'fadd {own} {rest}, {y}')}, {own} {rest}")
        if op not in _FLOAT:
            raise Untraceable(f"the operator {op} of floats")
        return self.number(kind, f"{_FLOAT[op]}{self.flags} {own} {x}, {y}")

    def compare(self, op: str, a: Any, b: Any, kind: str) -> Number:
        word = _COMPARED[op]
        if kind in "fs":
            predicate = "fcmp " + ("une" if op == "!=" else f"o{word}")
        else:
            predicate = "icmp " + (word if op in ("==", "!=") else f"s{word}")
        return self.number("b", f"{predicate} {LLVM[kind]} {self.as_kind(a, kind)}, {self.as_kind(b, kind)}")

    def divided(self, op: str, a: str, b: str) -> Number:
        """Return the quotient, rounded down, or the remainder of two integers."""
        rest = self.put(f"srem i64 {a}, {b}")
        signs = self.put(f"icmp slt i64 {self.put(f'xor i64 {rest}, {b}')}, 0")
        off = self.put(f"and i1 {signs}, {self.put(f'icmp ne i64 {rest}, 0')}")
        if op == "%":
            return self.number("i", f"select i1 {off}, i64 {self.put(f'add i64 {rest}, {b}')}, i64 {rest}")
        return self.number("i", f"sub i64 {self.put(f'sdiv i64 {a}, {b}')}, {self.put(f'zext i1 {off} to i64')}")

    def power(self, a: Any, b: Any) -> Any:
        if is_constant(b) and isinstance(b, int) and 0 < b < 5:
            square = self.binary("*", a, a)
            return {1: a, 2: square, 3: self.binary("*", square, a), 4: self.binary("*", square, square)}[b]
        return self.library("pow", a, b)

    def negative(self, a: Any) -> Any:
        if is_constant(a):
            return -a
        kind = "i" if a.kind == "b" else a.kind
        name = self.as_kind(a, kind)
        return self.number(kind, f"sub nsw i64 0, {name}" if kind == "i" else f"fneg {LLVM[kind]} {name}")

    def inverted(self, a: Any) -> Any:
        return (not a) if is_constant(a) else self.number("b", f"xor i1 {self.as_kind(a, 'b')}, true")

    def select(self, condition: Any, a: Any, b: Any) -> Any:
        """Return a where a condition holds, else b."""
        kind = wider(kind_of(a), kind_of(b))
        own, chosen = LLVM[kind], self.as_kind(condition, "b")
        return self.number(kind, f"select i1 {chosen}, {own} {self.as_kind(a, kind)}, {own} {self.as_kind(b, kind)}")

    def intrinsic(self, name: str, value: Any) -> Number:
        kind = kind_of(value) if kind_of(value) in "fs" else "f"
        own = LLVM[kind]
        full = f"llvm.{name}.{'f64' if kind == 'f' else 'f32'}"
        self.module.declared.add(f"declare {own} @{full}({own})")
        return self.number(kind, f"call {own} @{full}({own} {self.as_kind(value, kind)})")

    def library(self, name: str, *values: Any) -> Any:
        """Return the result of a function of the C library."""
        if all(map(is_constant, values)):
            return getattr(math, name)(*values)
        self.module.declared.add(f"declare double @{name}({', '.join(['double'] * len(values))})")
        arguments = ", ".join(f"double {self.as_kind(value, 'f')}" for value in values)
        return self.number("f", f"call double @{name}({arguments})")

    # Memory

    def index(self, value: Any, length: Any) -> Any:
        """Return an index, counted from the end if it is negative."""
        if is_constant(value):
            return int(value) if value >= 0 else self.binary("+", length, int(value))
        return self.select(self.compare("<", value, 0, "i"), self.binary("+", value, length), value)

    def moved(self, address: Any, index: Any, stride: Any) -> Address:
        """Return the address of an item along an axis."""
        if is_constant(index) and index == 0:
            return address
        if is_constant(stride) and stride in (1, 2, 4, 8):
            text = f"getelementptr inbounds i{8 * stride}, ptr {address.name}, i64 {self.as_kind(index, 'i')}"
        else:
            offset = self.as_kind(self.binary("*", index, stride), "i")
            text = f"getelementptr inbounds i8, ptr {address.name}, i64 {offset}"
        return Address(self.put(text))

    def item(self, array: Array, indices: Sequence[Any]) -> Array:
        """Return what is left of an array for an index or a slice along each of the first axes."""
        address, shape, strides = array.address, list[Any](), list[Any]()
        for axis, index in enumerate(indices):
            length, stride = array.shape[axis], array.strides[axis]
            if not isinstance(index, slice):
                address = self.moved(address, self.index(index, length), stride)
                continue
            first, last = self.bound(index.start, 0, length), self.bound(index.stop, length, length)
            if index.step is not None:
                raise Untraceable("a slice with a step")
            address = self.moved(address, first, stride)
            left = self.binary("-", last, first)
            shape.append(left if is_constant(left) else self.select(self.compare("<", left, 0, "i"), 0, left))
            strides.append(stride)
        rest = len(indices)
        return Array(array.element, address, (*shape, *array.shape[rest:]), (*strides, *array.strides[rest:]))

    def bound(self, value: Any, default: Any, length: Any) -> Any:
        """Return the bound of a slice within an array."""
        if value is None or (is_constant(value) and value == 0):
            return default if value is None else 0
        value = self.index(value, length)
        value = self.select(self.compare("<", value, 0, "i"), 0, value) if not is_constant(value) else value
        return self.select(self.compare(">", value, length, "i"), length, value)

    def load(self, array: Array) -> Number:
        kind, size, own = MEMORY[array.element]
        name = self.put(f"load {kind}, ptr {array.address.name}, align {size}")
        if own == "b":
            return self.number("b", f"icmp ne i8 {name}, 0")
        if kind[0] != "i" or size == 8:
            return Number(own, name)
        return self.number("i", f"{'zext' if array.element.startswith('u') else 'sext'} {kind} {name} to i64")

    def store(self, array: Array, value: Any) -> None:
        kind, size, own = MEMORY[array.element]
        name = self.as_kind(value, own)
        if own == "b":
            name = self.put(f"zext i1 {name} to i8")
        elif kind[0] == "i" and size < 8:
            name = self.put(f"trunc i64 {name} to {kind}")
        self.do(f"store {kind} {name}, ptr {array.address.name}, align {size}")
