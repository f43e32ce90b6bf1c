"""The syntax of a kernel, from its source."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from functools import cache
from types import CodeType, FunctionType
from typing import Any

from turtlebot_gym.compiled.values import Untraceable


def walk(*nodes: Any) -> Iterator[Any]:
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
def _tree(file: str, source: str) -> dict[int, list[Any]]:
    """Return the functions of a module by the line on which they begin."""
    found: dict[int, list[Any]] = {}
    for node in walk(ast.parse(source)):
        if isinstance(node, (ast.FunctionDef, ast.Lambda)):
            decorators = getattr(node, "decorator_list", [])
            found.setdefault(min([node.lineno, *(each.lineno for each in decorators)]), []).append(node)
    return found


def syntax_of(function: FunctionType) -> ast.FunctionDef:
    """Return the syntax of a function, or of a lambda as one that returns its value: not to be changed, since others share it.

    Raises:
        Untraceable: If the source is not there, or has changed.
    """
    code = function.__code__
    try:
        lines, _ = inspect.findsource(function)
    except (OSError, TypeError) as error:
        raise Untraceable(f"the kernel {function.__name__!r}, whose source is not there") from error
    here = _tree(code.co_filename, "".join(lines)).get(code.co_firstlineno, [])
    named = [node for node in here if getattr(node, "name", "<lambda>") == function.__name__]
    if len(named) > 1:  # several lambdas on a line
        named = [node for node in named if _code_of(node, code) == code.co_code]
    if not named:
        raise Untraceable(f"the kernel {function.__name__!r}, whose source has changed")
    node = named[0]
    body: list[ast.stmt] = node.body
    if isinstance(node, ast.Lambda):
        body = [ast.copy_location(ast.Return(node.body), node.body)]
    for argument in ast.walk(node.args):
        if isinstance(argument, ast.arg):
            argument.annotation = None
    node.args.defaults, node.args.kw_defaults = [], [None] * len(node.args.kwonlyargs)
    return ast.FunctionDef("function", node.args, body, [])


def _code_of(node: ast.Lambda, like: CodeType) -> bytes:
    """Return the code of a lambda among the variables of another one."""
    cells = ast.arguments([], [ast.arg(name) for name in like.co_freevars], None, [], [], None, [])
    outer = ast.fix_missing_locations(ast.Expression(ast.Lambda(cells, node)))
    inner = next(x for x in compile(outer, "", "eval").co_consts if isinstance(x, CodeType))
    return next(x for x in inner.co_consts if isinstance(x, CodeType)).co_code
