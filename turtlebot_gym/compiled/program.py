"""Functions of arrays as machine code, by llvmlite: translated at their first call, and kept in files.

A function's arguments are numbers, arrays, and nested tuples of them. The code takes the address of a block of 64-bit integers:
the numbers, and of each array the address, the lengths and the distances of its items along the axes, in bytes.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from turtlebot_gym.compiled import builtins, native  # noqa: F401  # builtins fills a table
from turtlebot_gym.compiled.code import Code
from turtlebot_gym.compiled.translate import Translator
from turtlebot_gym.compiled.values import Address, Array, Number, Untraceable, kinds_of, leaves, rebuilt

_one_at_a_time = threading.Lock()
MAKERS = ("syntax", "values", "code", "scopes", "expressions", "statements", "translate", "builtins", "program", "native")
"""Modules that make the machine code."""


def _is_adjacent(value: np.ndarray) -> bool:
    """Return whether the items of an array's rows are adjacent."""
    return value.strides[-1:] == (value.itemsize,)


def _address(array: np.ndarray) -> int:
    """Return the address of an array, in a third of the time of ``array.ctypes`` if it has no gaps."""
    flags = array.flags
    buffer: Any = array
    return ctypes.addressof(ctypes.c_char.from_buffer(buffer)) if flags.carray else array.ctypes.data


def _form(value: Any) -> Any:
    """Return what stands for an argument of Python in the code."""
    if isinstance(value, np.ndarray):
        strides: list[Any] = [Number("i", "")] * value.ndim
        if _is_adjacent(value):
            strides[-1] = value.itemsize
        return Array(value.dtype.name, Address(""), (Number("i", ""),) * value.ndim, tuple(strides))
    if isinstance(value, tuple):
        items = [_form(item) for item in value]
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    if isinstance(value, (bool, np.bool_)):
        return Number("b", "")
    if isinstance(value, (int, np.integer)):
        return Number("i", "")
    if isinstance(value, (float, np.floating)):
        return Number("f", "")
    return value


def _signature(value: Any) -> Any:
    """Return what tells the form of an argument from others, in little time."""
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim, _is_adjacent(value)
    if isinstance(value, tuple):
        return (type(value), *map(_signature, value))
    return type(value)


def _words(value: Any) -> Iterator[int | float]:
    """Yield an argument's numbers for the block."""
    if isinstance(value, np.ndarray):
        yield value.ctypes.data
        yield from value.shape
        yield from value.strides[:-1] if _is_adjacent(value) else value.strides
    elif isinstance(value, tuple):
        for item in value:
            yield from _words(item)
    elif isinstance(value, (bool, int, float, np.generic)):
        yield value if isinstance(value, float) else int(value)


def text_of(function: Any, forms: tuple[Any, ...]) -> tuple[str, Any]:
    """Return the text of a function for LLVM, and the form of its result."""
    translator = Translator()
    code = Code(translator.module)
    at = iter(range(10**6))

    def word() -> str:
        return code.put(f"getelementptr i64, ptr %block, i64 {next(at)}")

    def argument(leaf: Any) -> Any:
        if isinstance(leaf, Address):
            return Address(code.put(f"load ptr, ptr {word()}, align 8"))
        if leaf.kind == "b":
            return code.compare("!=", code.number("i", f"load i64, ptr {word()}, align 8"), 0, "i")
        return code.number(leaf.kind, f"load {'double' if leaf.kind == 'f' else 'i64'}, ptr {word()}, align 8")

    arguments = [rebuilt(form, argument) for form in forms]
    result, owners = translator.call(code, function, arguments)
    if owners:
        raise Untraceable("a function that returns an array of its own")
    for leaf, kind in zip(leaves(result), kinds_of(result), strict=True):
        name = leaf.name if kind in ("double", "i64", "ptr") else code.as_kind(leaf, "f" if kind == "float" else "i")
        kind = {"float": "double", "i1": "i64"}.get(kind, kind)
        code.do(f"store {kind} {name}, ptr {word()}, align 8")
    lines = "\n".join(["entry:", *code.entry, *code.lines, "  ret void"])
    code.module.functions.append(f"define void @entry(ptr noalias %block) #0 {{\n{lines}\n}}")
    return code.module.text(), rebuilt(result, lambda leaf: leaf)


class Program:
    """A function that runs as machine code.

    Args:
        function: The function.
        name: What it does, for people.
        identity: Everything that its machine code is made of, except for types and processor.
        level: How much LLVM has to optimize it, from 1 to 3.
        build: ``build(text)`` returns the machine code of LLVM's text, in place of this processor's, which is kept in files.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        name: str,
        identity: str,
        level: int = 3,
        build: Callable[[str], Callable[[int], None]] | None = None,
    ) -> None:
        self._function, self._name, self._identity, self._level, self._build = function, name, identity, level, build
        self._made: dict[Any, tuple[Callable[[int], None], Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        return Caller(self)(*arguments)

    @property
    def signatures(self) -> list[Any]:
        """The forms of arguments for which there is machine code."""
        return [*self._made]

    def code_for(self, arguments: tuple[Any, ...]) -> tuple[Callable[[int], None], Any]:
        """Return the machine code for arguments of some form, and the form of its result."""
        signature = _signature(arguments)
        if signature not in self._made:
            forms = tuple(map(_form, arguments))
            with _one_at_a_time:
                if self._build:
                    text, notes = text_of(self._function, forms)
                    self._made[signature] = self._build(text), notes
                    return self._made[signature]
                code = native.code_of(
                    self._name, f"{self._identity} {forms}", lambda: text_of(self._function, forms), self._level
                )
                (entry,) = native.functions_of(code.machine_code, "entry")
            self._made[signature] = entry, code.notes
        return self._made[signature]


class Caller:
    """Calls a program again and again, mostly with the same arrays.

    Args:
        program: The program.
    """

    def __init__(self, program: Program) -> None:
        self._program, self._arguments, self._signatures = program, list[Any](), list[Any]()

    def __call__(self, *arguments: Any) -> Any:
        call, address = self.prepared(*arguments)
        call(address)
        return self._result()

    def again(self, others: Sequence[tuple[int, np.ndarray]]) -> None:
        """Repeat the last call with others in place of some arrays, by their index: they differ in nothing but the address."""
        for at, array in others:
            self._block[self._places[at]], self._arguments[at] = _address(array), None  # nobody holds results any longer
        self._call(self._address)

    def prepared(self, *arguments: Any) -> tuple[Callable[[int], None], int]:
        """Return the machine code, and the address of its arguments, which this object holds until the next call."""
        old = self._arguments
        if len(old) != len(arguments):
            self._lay_out(arguments)
            return self._call, self._address
        for at, (new, was) in enumerate(zip(arguments, old, strict=True)):
            if new is was:
                continue
            if _signature(new) != self._signatures[at]:
                self._lay_out(arguments)
                break
            if isinstance(was, np.ndarray) and new.shape == was.shape and new.strides == was.strides:
                self._block[self._places[at]] = _address(new)
            else:
                self._write(self._places[at], new)
            old[at] = new
        return self._call, self._address

    def _lay_out(self, arguments: tuple[Any, ...]) -> None:
        self._call, self._form = self._program.code_for(arguments)
        self._arguments, self._signatures = list(arguments), [_signature(value) for value in arguments]
        sizes = [len(list(_words(value))) for value in arguments]
        self._places = [sum(sizes[:at]) for at in range(len(sizes))]
        self._end = sum(sizes)
        size = self._end + len(leaves(self._form))
        self._block = (ctypes.c_int64 * max(size, 1))()
        self._floats = (ctypes.c_double * max(size, 1)).from_buffer(self._block)
        self._address = ctypes.addressof(self._block)
        for place, value in zip(self._places, arguments, strict=True):
            self._write(place, value)

    def _write(self, place: int, value: Any) -> None:
        for at, word in enumerate(_words(value), place):
            if isinstance(word, float):
                self._floats[at] = word
            else:
                self._block[at] = word

    def _result(self) -> Any:
        at = iter(range(self._end, len(self._block)))

        def number(leaf: Any) -> Any:
            index = next(at)
            return self._floats[index] if leaf.kind in "fs" else (bool if leaf.kind == "b" else int)(self._block[index])

        return rebuilt(self._form, number)


def caller_of(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return what calls a program or another function again and again."""
    return Caller(function) if isinstance(function, Program) else function
