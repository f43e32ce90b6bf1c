"""Kernels with loops and arrays, translated from their syntax into instructions for LLVM.

Each kernel becomes a function, once for each form of its arguments: nested tuples exist only while it is translated.
"""

from __future__ import annotations

import ast
import builtins as builtins_of_python
import operator
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any, NamedTuple

from turtlebot_gym.compiled import builtins, expressions, statements  # noqa: F401  # builtins fills a table of expressions
from turtlebot_gym.compiled.code import Code, Module
from turtlebot_gym.compiled.syntax import syntax_of
from turtlebot_gym.compiled.values import (
    Array,
    Number,
    Untraceable,
    as_runtime,
    is_number,
    key_of,
    kind_of,
    kinds_of,
    leaves,
    merged_form,
    named_of,
    renamed,
    tuple_like,
)


class Room(NamedTuple):
    """A variable in memory."""

    form: Any
    names: tuple[str, ...]
    """The address of each of its numbers."""


class _Placed(Untraceable):
    """What cannot be translated, with its place."""


class Made(NamedTuple):
    """A function of the module, and the form of its result."""

    name: str
    result: Any


class Translator:
    """Translates kernels into a module."""

    def __init__(self) -> None:
        self.module = Module()
        self._made: dict[Any, Made] = {}
        self._held: list[Any] = []

    def call(self, code: Code, function: FunctionType, arguments: Sequence[Any]) -> Any:
        """Write the call of a kernel, and return its result."""
        made = self.function(vars(function).get("in_loops", function), arguments)
        kinds = kinds_of(made.result)
        whole = f"call {code.module.structure(kinds)} @{made.name}({named_of(tuple(arguments))})"
        if not kinds:
            code.do(whole)
            return made.result
        whole, numbers = code.put(whole), iter(range(len(kinds)))
        kind = code.module.structure(kinds)
        return renamed(made.result, lambda: code.put(f"extractvalue {kind} {whole}, {next(numbers)}"))

    def function(self, function: FunctionType, arguments: Sequence[Any]) -> Made:
        """Return the translation of a kernel for arguments of some form."""
        key = (id(function), tuple(map(key_of, arguments)))
        if key not in self._made:
            self._held.append(function)
            self._made[key] = Body(self, function, arguments).made()
        return self._made[key]


class Body:
    """A kernel that is translated."""

    def __init__(self, translator: Translator, function: FunctionType, arguments: Sequence[Any]) -> None:
        self.translator, self.function, self.syntax = translator, function, syntax_of(function)
        self.code = Code(translator.module, loose=getattr(function, "is_algebra", False))
        self.loops: list[statements.Loop] = []
        self.names: dict[str, Any] = {}
        self.owned: list[str] = []
        """Where the addresses of arrays stand that this function makes."""
        self.parameters = [renamed(value, lambda: self.code.module.fresh("%a")) for value in arguments]
        cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
        self.closure = {name: cell.cell_contents for name, cell in cells}

    def made(self) -> Made:
        """Write the function."""
        code, syntax, result = self.code, self.syntax, None
        for name, value in zip(syntax.parameters, self.parameters, strict=True):
            self.bind(name, value)
        if syntax.returns_at_end:
            *body, last = syntax.body
            self.run(body)
            assert isinstance(last, ast.Return)
            result = self.placed(last, lambda: self.of(last.value) if last.value else None)
        else:
            self.exit = code.module.fresh("exit")
            self.run(syntax.body)
            if code.alive:
                statements.leave(self, None)
            code.label(self.exit)
            result = self.read("return") if "return" in self.names else None
        self.free(result)
        found, kinds = leaves(result), kinds_of(result)
        whole = code.module.structure(kinds)
        value = "poison"
        for at, (kind, leaf) in enumerate(zip(kinds, found, strict=True)):
            value = code.put(f"insertvalue {whole} {value}, {kind} {leaf.name}, {at}")
        code.do(f"ret {whole} {value}" if kinds else "ret void")
        name = code.module.fresh(f"{self.function.__name__.strip('<>')}.")
        inline = "" if syntax.has_loops else "alwaysinline "
        head = f"define internal {whole} @{name}({named_of(tuple(self.parameters))}) {inline}#0 {{"
        lines = [head, "entry:", *code.entry, "  br label %start", "start:", *code.lines, "}"]
        code.module.functions.append("\n".join(lines))
        return Made(name, renamed(result, str))

    # Memory

    def own(self, address: str) -> None:
        """Free what stands at an address when the function returns, or when this instruction runs again."""
        code, room = self.code, self.code.room("ptr")
        code.module.declared.add("declare void @free(ptr)")
        code.entry.append(f"  store ptr null, ptr {room}, align 8")
        code.do(f"call void @free(ptr {code.put(f'load ptr, ptr {room}')})")
        code.do(f"store ptr {address}, ptr {room}, align 8")
        self.owned.append(room)

    def free(self, result: Any) -> None:
        """Free what the function owns."""
        if self.owned and any(leaf.kind == "p" for leaf in leaves(result)):
            raise Untraceable(f"the kernel {self.function.__name__!r} returns an array: let it take one to write to")
        for room in self.owned:
            self.code.do(f"call void @free(ptr {self.code.put(f'load ptr, ptr {room}')})")

    # Variables

    def bind(self, name: str, value: Any) -> None:
        """Assign a variable."""
        if name in self.syntax.in_memory:
            self.write(name, value)
        else:
            self.names[name] = value

    def write(self, name: str, value: Any) -> None:
        """Write a variable to its room in memory."""
        code, form = self.code, as_runtime(value)
        room = self.names.get(name)
        if not isinstance(room, Room):
            room = self.names[name] = Room(form, tuple(code.room(kind) for kind in kinds_of(form)))
        if key_of(merged_form(room.form, form)) != key_of(room.form):
            raise Untraceable("a variable or a choice that holds a whole number first, and then a float: begin with a float")
        for kind, leaf, place in zip(kinds_of(room.form), self.as_form(value, room.form), room.names, strict=True):
            code.do(f"store {kind} {leaf}, ptr {place}, align {1 if kind == 'i1' else 8}")

    def as_form(self, value: Any, form: Any) -> list[str]:
        """Return the names of a value's leaves in a form."""
        if isinstance(form, Number):
            return [self.code.as_kind(value, form.kind)]
        if isinstance(form, tuple):
            return [name for item, like in zip(value, form, strict=True) for name in self.as_form(item, like)]
        return []

    def read(self, name: str) -> Any:
        """Return the value of a variable in memory."""
        room, code = self.names[name], self.code
        kinds, places = iter(kinds_of(room.form)), iter(room.names)
        return renamed(room.form, lambda: code.put(f"load {next(kinds)}, ptr {next(places)}"))

    def name(self, name: str) -> Any:
        """Return what a name stands for."""
        if name in self.names:
            value = self.names[name]
            return self.read(name) if isinstance(value, Room) else value
        if name in self.closure:
            return self.closure[name]
        scope = self.function.__globals__
        if name in scope:
            return scope[name]
        if not hasattr(builtins_of_python, name):
            raise Untraceable(f"the name {name!r} in the kernel {self.function.__name__!r}")
        return getattr(builtins_of_python, name)

    # Statements

    def run(self, block: Sequence[ast.stmt]) -> None:
        for statement in block:
            if self.code.alive:
                method = getattr(statements, f"on_{type(statement).__name__}", Body.refuse)
                self.placed(statement, lambda statement=statement, method=method: method(self, statement))

    def placed(self, node: ast.stmt, translate: Callable[[], Any]) -> Any:
        """Return what a statement gives; say where it stands if it cannot be translated."""
        try:
            return translate()
        except (Untraceable, TypeError, AttributeError, ValueError, LookupError) as error:
            return self.refuse(node, error)

    def refuse(self, node: Any, error: Exception | None = None) -> Any:
        """Say what cannot be translated, and where."""
        if isinstance(error, _Placed):
            raise error
        where = f"line {node.lineno} of the kernel {self.function.__name__!r}"
        raise _Placed(
            f"{where}, {ast.unparse(node).splitlines()[0]!r}, cannot be compiled: {error or type(node).__name__}"
        ) from error

    def whole(self, array: Array) -> Any:
        """Return a number in place of an array without axes."""
        return array if array.shape else self.code.load(array)

    def truth(self, node: ast.expr) -> Any:
        """Return whether a condition holds."""
        value = self.of(node)
        if isinstance(value, Number):
            return self.code.converted(value, "b")
        return bool(value)

    # Expressions

    def of(self, node: ast.expr) -> Any:
        """Return the value of an expression."""
        return getattr(expressions, f"of_{type(node).__name__}", Body.refuse)(self, node)

    def held(self, value: Any) -> Any:
        """Return a value with numbers in place of constants."""
        if type(value) is Number:
            return value
        if is_number(value):
            return self.code.converted(value, kind_of(value))
        if isinstance(value, tuple) and not isinstance(value, Array):
            items = [self.held(item) for item in value]
            return value if all(map(operator.is_, items, value)) else tuple_like(value, items)
        return value
