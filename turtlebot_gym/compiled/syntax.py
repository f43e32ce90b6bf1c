"""The syntax of a kernel, from its source, and what the translator asks of it."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Sequence
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

from turtlebot_gym.compiled.values import Untraceable


@cache
def _functions_of(file: str, source: str) -> dict[int, list[Any]]:
    """Return the functions of a module by the line on which they begin."""
    found: dict[int, list[Any]] = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.Lambda)):
            decorators = getattr(node, "decorator_list", [])
            found.setdefault(min([node.lineno, *(each.lineno for each in decorators)]), []).append(node)
    return found


class Syntax(NamedTuple):
    """The syntax of a kernel; a lambda is a function that returns its value."""

    parameters: list[str]
    body: list[ast.stmt]
    in_memory: set[str]
    """Variables that several blocks assign, which need room in memory. All others stand for the value that they were assigned
    last, which may be a constant, an array, a tuple or a function, until their block ends."""
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
    body: list[Any] = [ast.copy_location(ast.Return(node.body), node.body)] if isinstance(node, ast.Lambda) else node.body
    parameters = [part.arg for part in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    blocks = {parameter: {id(body)} for parameter in parameters}
    nodes = _assign(body, blocks)
    returns = sum(isinstance(part, ast.Return) for part in nodes)
    has_loops = any(isinstance(part, (ast.For, ast.While)) for part in nodes)
    in_memory = {name for name, where in blocks.items() if len(where) > 1}
    return Syntax(parameters, body, in_memory, has_loops, returns == 1 and isinstance(body[-1], ast.Return))


def _assign(block: Sequence[ast.stmt], blocks: dict[str, set[int]]) -> list[ast.stmt]:
    """Record for each variable the blocks that assign it; return all statements of a block and of those in it."""
    found: list[ast.stmt] = []
    for statement in block:
        found.append(statement)
        where = id(statement.body) if isinstance(statement, ast.For) else id(block)
        for child in ast.iter_child_nodes(statement):
            if not isinstance(child, ast.stmt):
                for node in ast.walk(child):
                    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                        blocks.setdefault(node.id, set()).add(where)
        for inner in (getattr(statement, "body", []), getattr(statement, "orelse", [])):
            found += _assign(inner, blocks)
    return found
