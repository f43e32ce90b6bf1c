"""The syntax of a kernel, from its source, and what the translator asks of it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Sequence
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

from turtlebot_gym.compiled.values import Untraceable


def _walk(*nodes: Any) -> Iterator[Any]:
    """Yield nodes and all nodes in them, as `ast.walk`, in half the time."""
    stack = [*nodes]
    while stack:
        node = stack.pop()
        yield node
        for name in node._fields:
            value = getattr(node, name, None)
            if isinstance(value, list):
                stack += [item for item in value if isinstance(item, ast.AST)]
            elif isinstance(value, ast.AST) and name not in ("ctx", "op"):
                stack.append(value)


@cache
def _functions_of(file: str, source: str) -> dict[int, list[Any]]:
    """Return the functions of a module by the line on which they begin."""
    found: dict[int, list[Any]] = {}
    for node in _walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.Lambda)):
            decorators = getattr(node, "decorator_list", [])
            found.setdefault(min([node.lineno, *(each.lineno for each in decorators)]), []).append(node)
    return found


class Syntax(NamedTuple):
    """The syntax of a kernel; a lambda is a function that returns its value."""

    parameters: list[str]
    body: list[ast.stmt]
    in_memory: set[str]
    """Variables that need room in memory: those that branches or loops assign differently. All others stand for the value that
    they were assigned last, which may be a constant, an array, a tuple or a function."""
    has_loops: bool
    returns_at_end: bool
    """Whether it returns in its last statement only."""


@cache
def syntax_of(function: FunctionType) -> Syntax:
    """Return the syntax of a function.

    Raises:
        Untraceable: If the source is not there, has changed, or has two such lambdas on a line.
    """
    name, code = function.__name__, function.__code__
    try:
        lines, _ = inspect.findsource(function)
    except (OSError, TypeError) as error:
        raise Untraceable(f"the kernel {name!r}, whose source is not there") from error
    here = _functions_of(code.co_filename, "".join(lines)).get(code.co_firstlineno, [])
    named = [node for node in here if getattr(node, "name", "<lambda>") == name]
    if len(named) != 1:
        what = "which stands on a line with another: give it a line of its own" if named else "whose source has changed"
        raise Untraceable(f"the kernel {name!r}, {what}")
    (node,) = named
    is_lambda = isinstance(node, ast.Lambda)
    body: list[Any] = [ast.copy_location(ast.Return(node.body), node.body)] if is_lambda else node.body
    parameters = [part.arg for part in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    nodes = [*_walk(*body)]
    returns = sum(isinstance(part, ast.Return) for part in nodes)
    has_loops = any(isinstance(part, (ast.For, ast.While)) for part in nodes)
    return Syntax(parameters, body, _in_memory(parameters, body), has_loops, returns == 1 and isinstance(body[-1], ast.Return))


def _own_names(statement: ast.stmt) -> tuple[set[str], set[str]]:
    """Return the variables that a statement reads and assigns, without the statements in it."""
    read, assigned = set[str](), set[str]()
    for node in _walk(*(child for child in ast.iter_child_nodes(statement) if not isinstance(child, ast.stmt))):
        if isinstance(node, ast.Name):
            (read if isinstance(node.ctx, ast.Load) else assigned).add(node.id)
    return (read | assigned if isinstance(statement, ast.AugAssign) else read), assigned


def _visit(
    block: Sequence[ast.stmt], path: tuple[int, ...], found: dict[str, list[tuple[int, ...]]], first: set[str]
) -> set[str]:
    """Record the blocks in which variables are assigned, and those that read them before; return what this block reads so.

    A path holds the statements around a block; -1 at its end stands for one that reads a variable before it assigns it.
    """
    assigned, before = set(first), set[str]()
    for statement in block:
        (read, names), is_loop = _own_names(statement), isinstance(statement, ast.For)
        for at, part in enumerate(filter(None, (getattr(statement, name, []) for name in ("body", "orelse")))):
            inner = (*path, id(statement), *([at] if at else []))
            read |= _visit(part, inner, found, names if is_loop and not at else set())
        for name in read - assigned:
            found.setdefault(name, []).append((*path, -1))
        before |= read - assigned
        for name in names:
            found.setdefault(name, []).append((*path, id(statement)) if is_loop else path)
        assigned |= set() if is_loop else names
    return before


def _in_memory(parameters: Sequence[str], body: Sequence[ast.stmt]) -> set[str]:
    found: dict[str, list[tuple[int, ...]]] = {name: [()] for name in parameters}
    _visit(body, (), found, set())
    rooms = set()
    for name, places in found.items():
        assigned = {place for place in places if not place or place[-1] != -1}
        reads = [place[:-1] for place in places if place and place[-1] == -1]
        if len(assigned) > 1:
            rooms.add(name)
        elif assigned:
            (only,) = assigned
            # Inside of a branch or a loop, whoever reads it must stand behind the assignment.
            if only and any(read[: len(only)] != only or read == only for read in reads):
                rooms.add(name)
    return rooms
