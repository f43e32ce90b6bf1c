"""Instructions for LLVM, one at a time: arithmetic of Python's numbers, and the memory of arrays.

The bits are those of plain Python: nothing is reordered or contracted, and only in a kernel of `kernel.algebra` a product with
a constant zero is zero.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

from turtlebot_gym.compiled.values import (
    LLVM,
    MEMORY,
    Array,
    Number,
    Untraceable,
    constant,
    is_constant,
    is_natural,
    kind_of,
    signed,
    wider,
)

_OPERATORS: dict[str, tuple[Callable[[Any, Any], Any], str, str]] = {
    "+": (operator.add, "fadd", "add nsw"),
    "-": (operator.sub, "fsub", "sub nsw"),
    "*": (operator.mul, "fmul", "mul nsw"),
    "/": (operator.truediv, "fdiv", ""),
    "//": (operator.floordiv, "", ""),
    "%": (operator.mod, "", ""),
    "**": (operator.pow, "", ""),
    "&": (operator.and_, "", "and"),
    "|": (operator.or_, "", "or"),
    "^": (operator.xor, "", "xor"),
    "<<": (operator.lshift, "", "shl"),
    ">>": (operator.rshift, "", "ashr"),
    "<": (operator.lt, "fcmp olt", "icmp slt"),
    "<=": (operator.le, "fcmp ole", "icmp sle"),
    ">": (operator.gt, "fcmp ogt", "icmp sgt"),
    ">=": (operator.ge, "fcmp oge", "icmp sge"),
    "==": (operator.eq, "fcmp oeq", "icmp eq"),
    "!=": (operator.ne, "fcmp une", "icmp ne"),
}
"""Each operator in Python, and its instructions for floats and for integers."""
_CONVERSIONS = {
    "bi": "zext i1 {} to i64",
    "bf": "select i1 {}, double 1.0, double 0.0",
    "if": "sitofp i64 {} to double",
    "fi": "fptosi double {} to i64",
    "ib": "icmp ne i64 {}, 0",
    "fb": "fcmp une double {}, 0.0",
}


class Module:
    """The functions of a program, and what they share."""

    def __init__(self) -> None:
        self.functions: list[str] = []
        self.made: dict[Any, tuple[str, Any]] = {}
        """The names of translated kernels, and the forms of their results, by kernel and forms of arguments."""
        self.declared: set[str] = set()
        self.types: dict[tuple[str, ...], str] = {}
        self.notes: list[str] = []
        """Metadata: of loops whose rounds share nothing."""
        self._count = itertools.count()

    def fresh(self, name: str) -> str:
        return f"{name}{next(self._count)}"

    def structure(self, kinds: Sequence[str]) -> str:
        """Return the name of a type for several numbers."""
        return self.types.setdefault(tuple(kinds), f"%t{len(self.types)}") if kinds else "void"

    def text(self) -> str:
        notes = [f"!{at} = {text}" for at, text in enumerate(self.notes)]
        types = [f"{name} = type {{ {', '.join(kinds)} }}" for kinds, name in self.types.items()]
        attributes = 'attributes #0 = { nounwind "prefer-vector-width"="512" }'
        return "\n".join([*types, *self.functions, *sorted(self.declared), attributes, *notes, ""])

    def independent(self) -> tuple[str, str]:
        """Return what marks memory that the rounds of a loop do not share, and what marks its jump back."""
        at = len(self.notes)
        self.notes += [
            "distinct !{}",
            f'!{{!"llvm.loop.parallel_accesses", !{at}}}',
            '!{!"llvm.loop.vectorize.enable", i1 true}',
            f"distinct !{{!{at + 3}, !{at + 1}, !{at + 2}}}",
        ]
        return f", !llvm.access.group !{at}", f", !llvm.loop !{at + 3}"


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
        self.alive = True
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
        self.alive = True

    def jump(self, label: str) -> None:
        self.do(f"br label %{label}")
        self.alive = False

    def fork(self, condition: Any, then: str, other: str) -> None:
        self.do(f"br i1 {self.as_kind(condition, 'b')}, label %{then}, label %{other}")
        self.alive = False

    def as_kind(self, value: Any, kind: str) -> str:
        """Return LLVM's name of a number converted to a kind."""
        if is_constant(value):
            return constant(value != 0 if kind == "b" else value, kind)
        own = kind_of(value)
        return value.name if own == kind else self.put(_CONVERSIONS[own + kind].format(value.name))

    def converted(self, value: Any, kind: str) -> Number:
        """Return a number converted to a kind."""
        return value if isinstance(value, Number) and value.kind == kind else Number(kind, self.as_kind(value, kind))

    def binary(self, op: str, a: Any, b: Any) -> Any:
        """Return the result of an operator of Python."""
        plain, of_floats, of_integers = _OPERATORS[op]
        if is_constant(a) and is_constant(b) and not (op in ("/", "//", "%") and b == 0):
            value = plain(a, b)
            return signed(value) if type(value) is int else value
        kind = wider(kind_of(a), kind_of(b))
        if "cmp" in of_integers:
            return self.compare(op, a, b, "i" if kind == "b" else kind)
        if op == "**":  # Python rounds a square as a product
            return self.binary("*", a, a) if is_constant(b) and b == 2 else self.library("pow", a, b)
        if kind == "b" and op in "&|^":
            return self.number("b", f"{of_integers} i1 {self.as_kind(a, 'b')}, {self.as_kind(b, 'b')}")
        kind = "f" if kind == "f" or op == "/" else "i"
        x, y = self.as_kind(a, kind), self.as_kind(b, kind)
        if kind == "i" and of_integers:
            return Number("i", self.put(f"{of_integers} i64 {x}, {y}"), op in "+*" and is_natural(a) and is_natural(b))
        if kind == "i":
            return self.divided(op, x, y)
        if op == "%":
            rest = self.library("fmod", a, b)
            return self.select(self.compare("<", self.binary("*", rest, b), 0.0, "f"), self.binary("+", rest, b), rest)
        if not of_floats:
            raise Untraceable(f"the operator {op} of floats")
        return self.number("f", f"{of_floats}{self.flags} double {x}, {y}")

    def compare(self, op: str, a: Any, b: Any, kind: str) -> Number:
        """Return whether numbers of a kind are as an operator says."""
        instruction = _OPERATORS[op][1 if kind == "f" else 2]
        return self.number("b", f"{instruction} {LLVM[kind]} {self.as_kind(a, kind)}, {self.as_kind(b, kind)}")

    def divided(self, op: str, a: str, b: str) -> Number:
        """Return the quotient, rounded down, or the remainder of two integers."""
        rest = self.put(f"srem i64 {a}, {b}")
        signs = self.put(f"icmp slt i64 {self.put(f'xor i64 {rest}, {b}')}, 0")
        off = self.put(f"and i1 {signs}, {self.put(f'icmp ne i64 {rest}, 0')}")
        if op == "%":
            return self.number("i", f"select i1 {off}, i64 {self.put(f'add i64 {rest}, {b}')}, i64 {rest}")
        return self.number("i", f"sub i64 {self.put(f'sdiv i64 {a}, {b}')}, {self.put(f'zext i1 {off} to i64')}")

    def negative(self, a: Any) -> Any:
        """Return a number with the other sign."""
        if is_constant(a):
            return -a
        return self.number("f", f"fneg double {a.name}") if a.kind == "f" else self.binary("-", 0, a)

    def select(self, condition: Any, a: Any, b: Any) -> Number:
        """Return a where a condition holds, else b."""
        kind = wider(kind_of(a), kind_of(b))
        own, chosen = LLVM[kind], self.as_kind(condition, "b")
        return self.number(kind, f"select i1 {chosen}, {own} {self.as_kind(a, kind)}, {own} {self.as_kind(b, kind)}")

    def library(self, name: str, *values: Any) -> Any:
        """Return the result of a function of the C library, or of LLVM, such as "llvm.floor"."""
        if all(map(is_constant, values)):
            return getattr(math, name.split(".")[-1])(*values)
        full, given = f"{name}.f64" if "." in name else name, [f"double {self.as_kind(value, 'f')}" for value in values]
        self.module.declared.add(f"declare double @{full}({', '.join(['double'] * len(values))})")
        return self.number("f", f"call double @{full}({', '.join(given)})")

    def index(self, value: Any, length: Any) -> Any:
        """Return an index, counted from the end if it is negative."""
        if is_natural(value):
            return value
        if is_constant(value):
            return self.binary("+", length, int(value))
        return self.select(self.compare("<", value, 0, "i"), self.binary("+", value, length), value)

    def moved(self, address: Number, index: Any, stride: Any) -> Number:
        """Return the address of an item along an axis."""
        if is_constant(index) and index == 0:
            return address
        if is_constant(stride) and stride in (1, 2, 4, 8):
            text = f"getelementptr inbounds i{8 * stride}, ptr {address.name}, i64 {self.as_kind(index, 'i')}"
        else:
            offset = self.as_kind(self.binary("*", index, stride), "i")
            text = f"getelementptr inbounds i8, ptr {address.name}, i64 {offset}"
        return Number("p", self.put(text))

    def item(self, array: Array, index: Any) -> Array:
        """Return what is left of an array for an index or a slice, or for one along each of the first axes."""
        indices = index if isinstance(index, tuple) else (index,)
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
        if value is None:
            return default
        value = self.index(value, length)
        if not is_natural(value):
            value = self.select(self.compare("<", value, 0, "i"), 0, value)
        return value if is_constant(value) and value == 0 else self.select(self.compare(">", value, length, "i"), length, value)

    def load(self, array: Array) -> Number:
        """Return the number of an array without axes."""
        kind, size, own = MEMORY[array.element]
        name = self.put(f"load {kind}, ptr {array.address.name}, align {size}")
        if own == "b":
            return self.number("b", f"icmp ne i8 {name}, 0")
        if kind == "float":
            return self.number("f", f"fpext float {name} to double")
        if kind in ("double", "i64"):
            return Number(own, name)
        return self.number("i", f"{'zext' if array.element.startswith('u') else 'sext'} {kind} {name} to i64")

    def store(self, array: Array, value: Any) -> None:
        """Write a number to an array without axes."""
        kind, size, own = MEMORY[array.element]
        name = self.as_kind(value, own)
        if own == "b":
            name = self.put(f"zext i1 {name} to i8")
        elif kind == "float":
            name = self.put(f"fptrunc double {name} to float")
        elif kind not in ("double", "i64"):
            name = self.put(f"trunc i64 {name} to {kind}")
        self.do(f"store {kind} {name}, ptr {array.address.name}, align {size}")
