"""Functions of arrays as machine code: translated at their first call.

A function's arguments are numbers, arrays, and nested tuples of them. The code takes the address of a block of 64-bit integers:
the numbers, and of each array the address, the lengths and the distances of its items along the axes, in bytes.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from turtlebot_gym.compiled import native
from turtlebot_gym.compiled.files import kept
from turtlebot_gym.compiled.values import LLVM, form_of, key_of, leaves, rebuilt
from turtlebot_gym.kernel import HAS_LLVM

_one_at_a_time = threading.Lock()


def address_of(array: np.ndarray) -> int:
    """Return the address of an array, in a quarter of the time of ``array.ctypes`` if its first row has no gaps."""
    first: Any = array[0] if array.ndim > 1 and array.size else array
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(first))
    except (TypeError, ValueError):  # it has gaps, nothing in it, or must not be written
        return array.ctypes.data


def _words(value: Any) -> Iterator[int | float]:
    """Yield an argument's numbers for the block."""
    if isinstance(value, np.ndarray):
        yield value.ctypes.data
        yield from value.shape
        yield from value.strides[:-1] if value.strides[-1:] == (value.itemsize,) else value.strides
    elif isinstance(value, tuple):
        for item in value:
            yield from _words(item)
    elif isinstance(value, (bool, int, float, np.generic)):
        yield value if isinstance(value, float) else int(value)


def text_of(function: Any, forms: tuple[Any, ...]) -> tuple[str, Any]:
    """Return the text of a function for LLVM, and the form of its result; numbers with the same name are the same."""
    from turtlebot_gym.compiled.code import Code, Module
    from turtlebot_gym.compiled.translate import call

    code = Code(Module())
    at, named = iter(range(10**6)), dict[str, Any]()

    def word() -> str:
        return code.put(f"getelementptr i64, ptr %block, i64 {next(at)}")

    def argument(leaf: Any) -> Any:
        kind = "i" if leaf.kind == "b" else leaf.kind
        number = code.converted(code.number(kind, f"load {LLVM[kind]}, ptr {word()}, align 8"), leaf.kind)
        return named.setdefault(leaf.name, number) if leaf.name else number

    arguments = [rebuilt(form, argument) for form in forms]
    result = call(code, function, arguments)
    for leaf in leaves(result):
        kind = "i" if leaf.kind == "b" else leaf.kind
        code.do(f"store {LLVM[kind]} {code.as_kind(leaf, kind)}, ptr {word()}, align 8")
    lines = "\n".join(["entry:", *code.entry, *code.lines, "  ret void"])
    code.module.functions.append(f"define void @entry(ptr noalias %block) #0 {{\n{lines}\n}}")
    return code.module.text(), result


class Program:
    """A function that runs as machine code.

    Args:
        function: Its globals and its closure hold kernels and numbers, which become a part of it.
        name: A name for people, and for the file of its machine code.
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
        self._function, self._name, self._level = function, name, level
        self._build = build or self._for_this_processor
        self._made: dict[Any, tuple[Callable[[int], None], Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        return Call(self, arguments)()

    def _for_this_processor(self, text: str) -> Callable[[int], None]:
        made_of = f"{self._level} {text}"
        return native.entry_of(kept(self._name, made_of, lambda: native.machine_code(text, self._level)))

    def code_for(self, arguments: tuple[Any, ...]) -> tuple[Callable[[int], None], Any]:
        """Return the machine code for arguments of some form, and the form of its result."""
        forms = tuple(map(form_of, arguments))
        key = key_of(forms)
        if key not in self._made:
            with _one_at_a_time:
                text, result = text_of(self._function, forms)
                self._made[key] = self._build(text), result
        return self._made[key]


class Call:
    """A program and its arguments, to be called again and again.

    Attributes:
        code: The machine code, which takes `address`.
        address: The address of the arguments.
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
