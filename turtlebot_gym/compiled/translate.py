"""Kernels with loops and arrays, translated from their syntax into instructions for LLVM.

Each kernel becomes a function, once for each form of its arguments: nested tuples exist only while it is translated.
"""

from __future__ import annotations

import ast
import builtins as builtins_of_python
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FunctionType
from typing import Any

from turtlebot_gym.compiled import builtins, expressions, statements  # noqa: F401  # builtins fills a table of expressions
from turtlebot_gym.compiled.code import Code, Module
from turtlebot_gym.compiled.syntax import syntax_of
from turtlebot_gym.compiled.values import (
    Array,
    Number,
    Untraceable,
    form_of,
    is_constant,
    is_number,
    key_of,
    kind_of,
    kinds_of,
    leaves,
    named_of,
    renamed,
    tuple_like,
    wider,
)

ALLOWED = "kernels use numbers, tuples, arrays, if, while, for over a range or a tuple, and other kernels"


class _Placed(Untraceable):
    """What cannot be translated, with its place."""


def call(code: Code, function: FunctionType, arguments: Sequence[Any]) -> Any:
    """Write the call of a kernel, and return its result; the kernel is translated once for each form of its arguments."""
    function, made = vars(function).get("in_loops", function), code.module.made
    key = (function, *map(key_of, arguments))
    if key not in made:
        made[key] = FunctionBody(code.module, function, arguments).made()
    name, result = made[key]
    kinds = kinds_of(result)
    kind = code.module.structure(kinds)
    text = f"call {kind} @{name}({named_of(tuple(arguments))})"
    if not kinds:
        code.do(text)
        return result
    whole = code.put(text)
    return renamed(result, (code.put(f"extractvalue {kind} {whole}, {at}") for at in range(len(kinds))))


class FunctionBody:
    """A kernel that is translated."""

    def __init__(self, module: Module, function: FunctionType, arguments: Sequence[Any]) -> None:
        self.function, self.syntax = function, syntax_of(function)
        self.code = Code(module, loose=getattr(function, "is_algebra", False))
        self.loops: list[tuple[str, str]] = []
        self.names: dict[str, Any] = {}
        self.rooms: dict[str, tuple[Any, list[str]]] = {}
        """The forms of variables in memory, and the addresses of their numbers."""
        self.owned: list[str] = []
        """Where the addresses of arrays stand that this function makes."""
        self.result: Any = None
        self.exit = module.fresh("exit")
        self.parameters = renamed(tuple(arguments), iter(lambda: module.fresh("%a"), ""))
        cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
        self.closure = {name: cell.cell_contents for name, cell in cells}

    def made(self) -> tuple[str, Any]:
        """Write the function; return its name, and the form of its result."""
        code, syntax = self.code, self.syntax
        for name, value in zip(syntax.parameters, self.parameters, strict=True):
            self.bind(name, value)
        self.run(syntax.body)
        if not syntax.returns_at_end:
            if code.alive:
                self.leave(None)
            code.label(self.exit)
            self.result = self.read("return") if "return" in self.rooms else None
        found, kinds = leaves(self.result), kinds_of(self.result)
        if self.owned and "ptr" in kinds:
            raise Untraceable(f"the kernel {self.function.__name__!r} returns an array: let it take one to write to")
        for room in self.owned:
            self.free(room)
        whole, value = code.module.structure(kinds), "poison"
        for at, (kind, leaf) in enumerate(zip(kinds, found, strict=True)):
            value = code.put(f"insertvalue {whole} {value}, {kind} {leaf.name}, {at}")
        code.do(f"ret {whole} {value}" if kinds else "ret void")
        name = code.module.fresh(f"{self.function.__name__.strip('<>')}.")
        inline = "" if syntax.has_loops else "alwaysinline "
        head = f"define internal {whole} @{name}({named_of(self.parameters)}) {inline}#0 {{"
        lines = [head, "entry:", *code.entry, "  br label %start", "start:", *code.lines, "}"]
        code.module.functions.append("\n".join(lines))
        return name, self.result

    def own(self, address: str) -> None:
        """Free the memory at an address when the function returns, or when this instruction runs again."""
        code, room = self.code, self.code.room("ptr")
        code.module.declared.add("declare void @free(ptr)")
        code.entry.append(f"  store ptr null, ptr {room}, align 8")
        self.free(room)
        code.do(f"store ptr {address}, ptr {room}, align 8")
        self.owned.append(room)

    def free(self, room: str) -> None:
        self.code.do(f"call void @free(ptr {self.code.put(f'load ptr, ptr {room}')})")

    def bind(self, name: str, value: Any) -> None:
        """Assign a variable."""
        if name in self.syntax.in_memory:
            self.write(name, value)
        else:
            self.names[name] = value

    @contextmanager
    def apart(self) -> Iterator[None]:
        """Forget the variables of a block at its end, except for those in memory."""
        before = self.names.copy()
        yield
        self.names = before

    def write(self, name: str, value: Any) -> None:
        """Write a variable to its room in memory."""
        code = self.code
        if name not in self.rooms:
            form = form_of(value)
            self.rooms[name] = form, [code.room(leaf.kind) for leaf in leaves(form)]
        form, places = self.rooms[name]
        for kind, number, place in zip(kinds_of(form), self.as_form(value, form), places, strict=True):
            code.do(f"store {kind} {number}, ptr {place}, align {1 if kind == 'i1' else 8}")

    def as_form(self, value: Any, form: Any) -> list[str]:
        """Return the names of a value's numbers in a form."""
        if isinstance(form, Number) and is_number(value) and wider(kind_of(value), form.kind) == form.kind:
            return [self.code.as_kind(value, form.kind)]
        if isinstance(form, tuple) and type(value) is type(form) and len(value) == len(form):
            return [name for item, like in zip(value, form, strict=True) for name in self.as_form(item, like)]
        if isinstance(form, (Number, tuple)) or value != form:
            raise Untraceable(f"a variable or a choice that holds {_spelled(form)}, and then {_spelled(value)}")
        return []

    def read(self, name: str) -> Any:
        """Return the value of a variable in memory."""
        form, places = self.rooms[name]
        loads = (self.code.put(f"load {kind}, ptr {place}") for kind, place in zip(kinds_of(form), places, strict=True))
        return renamed(form, loads)

    def leave(self, value: Any) -> None:
        """Return a value, of which the kernel has several."""
        if value is not None:
            self.write("return", value)
        self.code.jump(self.exit)

    def name(self, name: str) -> Any:
        """Return what a name stands for."""
        if name in self.rooms:
            return self.read(name)
        if name in self.names:
            return self.names[name]
        if name in self.function.__code__.co_varnames:
            raise Untraceable(f"the variable {name!r}, which has no value here: give it one before the branch or the loop")
        for scope in (self.closure, self.function.__globals__, vars(builtins_of_python)):
            if name in scope:
                return scope[name]
        raise Untraceable(f"the name {name!r}, which is not defined")

    def run(self, block: Sequence[ast.stmt]) -> None:
        """Write statements.

        Raises:
            Untraceable: If one cannot be translated; the message names its place and the reason.
        """
        for statement in block:
            if not self.code.alive:
                return
            try:
                getattr(statements, f"on_{type(statement).__name__}", self.refuse)(self, statement)
            except _Placed:
                raise
            except (Untraceable, TypeError, AttributeError, ValueError, LookupError) as error:
                code = self.function.__code__
                where = f"{code.co_filename}, line {statement.lineno} of the kernel {self.function.__name__!r}"
                text = ast.unparse(statement).splitlines()[0]
                raise _Placed(f"{where}, {text!r}, cannot be compiled: {error}; {ALLOWED}") from error

    def refuse(self, _: Any, node: ast.AST) -> Any:
        raise Untraceable(f"the syntax {type(node).__name__}")

    def whole(self, array: Array) -> Any:
        """Return a number in place of an array without axes."""
        return array if array.shape else self.code.load(array)

    def truth(self, node: ast.expr) -> Any:
        """Return whether a condition holds."""
        value = self.of(node)
        return self.code.converted(value, "b") if isinstance(value, Number) else bool(value)

    def call(self, function: FunctionType, arguments: Sequence[Any]) -> Any:
        return call(self.code, function, arguments)

    def of(self, node: ast.expr) -> Any:
        """Return the value of an expression."""
        return getattr(expressions, f"of_{type(node).__name__}", self.refuse)(self, node)

    def held(self, value: Any) -> Any:
        """Return a value with numbers in place of constants."""
        if isinstance(value, tuple) and not isinstance(value, Array):
            return tuple_like(value, [self.held(item) for item in value])
        return self.code.converted(value, kind_of(value)) if is_constant(value) else value


def _spelled(value: Any) -> str:
    """Return what a message calls a value."""
    kinds = {"f": "a float", "i": "a whole number", "b": "a truth"}
    return kinds[kind_of(value)] if is_number(value) and kind_of(value) in kinds else f"a {type(value).__name__}"
