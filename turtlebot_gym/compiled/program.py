"""Functions of arrays as machine code: translated at their first call, and kept in files.

A function's arguments are numbers, arrays, and nested tuples of them. The code takes the address of a block of 64-bit integers:
the numbers, and of each array the address, the lengths and the distances of its items along the axes, in bytes.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.files import fingerprint, kept
from turtlebot_gym.compiled.values import LLVM, as_runtime, kinds_of, leaves, rebuilt
from turtlebot_gym.kernel import HAS_LLVM

_one_at_a_time = threading.Lock()


def _is_adjacent(value: np.ndarray) -> bool:
    """Return whether the items of an array's rows are adjacent."""
    return value.strides[-1:] == (value.itemsize,)


def address_of(array: np.ndarray) -> int:
    """Return the address of an array, in a quarter of the time of ``array.ctypes`` if it has no gaps."""
    buffer: Any = array
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(buffer))
    except (TypeError, ValueError):  # it has gaps, nothing in it, or must not be written
        return array.ctypes.data


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
    from turtlebot_gym.compiled.code import Code
    from turtlebot_gym.compiled.translate import Translator

    translator = Translator()
    code = Code(translator.module)
    at = iter(range(10**6))

    def word() -> str:
        return code.put(f"getelementptr i64, ptr %block, i64 {next(at)}")

    def argument(leaf: Any) -> Any:
        if leaf.kind == "b":
            return code.compare("!=", code.number("i", f"load i64, ptr {word()}, align 8"), 0, "i")
        return code.number(leaf.kind, f"load {LLVM[leaf.kind]}, ptr {word()}, align 8")

    arguments = [rebuilt(form, argument) for form in forms]
    result = translator.call(code, function, arguments)
    for leaf, kind in zip(leaves(result), kinds_of(result), strict=True):
        kind, name = ("i64", code.as_kind(leaf, "i")) if kind == "i1" else (kind, leaf.name)
        code.do(f"store {kind} {name}, ptr {word()}, align 8")
    lines = "\n".join(["entry:", *code.entry, *code.lines, "  ret void"])
    code.module.functions.append(f"define void @entry(ptr noalias %block) #0 {{\n{lines}\n}}")
    return code.module.text(), rebuilt(result, lambda leaf: leaf)


class Program:
    """A function that runs as machine code.

    Args:
        function: Its globals and its closure hold kernels and numbers, which become a part of it.
        name: What it does, for people and the name of its file.
        level: How much LLVM has to optimize it, from 1 to 3.
        build: ``build(text)`` returns the machine code of LLVM's text, in place of this processor's, which is kept in files.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        name: str,
        level: int = 3,
        build: Callable[[str], Callable[[int], None]] | None = None,
    ) -> None:
        self._function, self._name, self._level, self._build = function, name, level, build
        self._made: dict[Any, tuple[Callable[[int], None], Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        return Call(self, arguments)()

    @cached_property
    def identity(self) -> str:
        """What tells everything that the machine code is made of, except for the types of the arguments."""
        return f"{self._level} {fingerprint(self._function)}"

    @property
    def signatures(self) -> list[Any]:
        """The forms of arguments for which there is machine code."""
        return [*self._made]

    def code_for(self, arguments: tuple[Any, ...]) -> tuple[Callable[[int], None], Any]:
        """Return the machine code for arguments of some form, and the form of its result."""
        signature = _signature(arguments)
        if signature not in self._made:
            forms = tuple(map(as_runtime, arguments))

            def compile_now() -> tuple[bytes, Any]:
                text, result = text_of(self._function, forms)
                return native.machine_code(text, self._level), result

            with _one_at_a_time:
                if self._build:
                    text, result = text_of(self._function, forms)
                    entry = self._build(text)
                else:
                    code, result = kept(self._name, f"{self.identity} {forms}", compile_now)
                    entry = native.entry_of(code)
            self._made[signature] = entry, result
        return self._made[signature]


class Call:
    """A program and its arguments, to be called again and again.

    Attributes:
        code: The machine code, which takes `address`.
        address: Where the arguments stand.
    """

    def __init__(self, program: Program, arguments: tuple[Any, ...]) -> None:
        self.code, self._form = program.code_for(arguments)
        self._arguments = [*arguments]
        words = [[*_words(value)] for value in arguments]
        sizes = [*map(len, words)]
        self._places = [sum(sizes[:at]) for at in range(len(sizes))]
        self._end = sum(sizes)
        size = self._end + max(1, len(leaves(self._form)))
        self._block = (ctypes.c_int64 * size)()
        self._floats = (ctypes.c_double * size).from_buffer(self._block)
        self.address = ctypes.addressof(self._block)
        for at, word in enumerate(word for part in words for word in part):
            (self._floats if isinstance(word, float) else self._block)[at] = word

    def __call__(self) -> Any:
        self.code(self.address)
        at = iter(range(self._end, self._end + len(leaves(self._form))))

        def number(leaf: Any) -> Any:
            index = next(at)
            return self._floats[index] if leaf.kind == "f" else (bool if leaf.kind == "b" else int)(self._block[index])

        return rebuilt(self._form, number)

    def count(self) -> int:
        """Call, and return the integer that the code returns, if it does."""
        self.code(self.address)
        return self._block[self._end]

    def put(self, at: int, word: int) -> None:
        """Put an integer in the place of an argument, or the address of an array that differs in nothing else.

        Whoever calls holds that array.
        """
        self._block[self._places[at]], self._arguments[at] = word, None


def compiled(function: Callable[..., Any], name: str, level: int = 3) -> Callable[..., Any]:
    """Return a function as a `Program`, or itself where nothing is compiled; the arguments are those of `Program`."""
    return Program(function, name, level) if HAS_LLVM else function


def in_machine_code(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a function that is `compiled` under a name: llvmlite is not imported before its first call."""
    return lambda function: compiled(function, name)
