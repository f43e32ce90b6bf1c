"""Which variables of a function need room in memory: those that branches or loops assign differently.

All others stand for the value that they were assigned last, which may be a constant, an array, a tuple or a function.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence

from turtlebot_gym.compiled.syntax import walk

_Path = tuple[int, ...]
"""The statements around a block; -1 at the end of one that reads a variable before it assigns it."""


def blocks_of(statement: ast.stmt) -> list[list[ast.stmt]]:
    """Return the lists of statements in a statement."""
    return [part for name in ("body", "orelse") if (part := getattr(statement, name, None))]


def _own(statement: ast.stmt) -> Iterator[ast.AST]:
    """Return the syntax of a statement, without the statements in it."""
    return walk(*(child for child in ast.iter_child_nodes(statement) if not isinstance(child, ast.stmt)))


def _names(nodes: Iterator[ast.AST], kind: type) -> set[str]:
    return {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, kind)}


def _visit(
    block: Sequence[ast.stmt], path: tuple[int, ...], found: dict[str, list[tuple[int, ...]]], first: set[str]
) -> set[str]:
    """Record the blocks in which variables are assigned, and those that read them before; return what this block reads so."""
    assigned, before = set(first), set[str]()
    for statement in block:
        read, names = _names(_own(statement), ast.Load), _names(_own(statement), ast.Store)
        if isinstance(statement, ast.AugAssign):
            read |= names
        is_loop = isinstance(statement, ast.For)
        for at, part in enumerate(blocks_of(statement)):
            inner = (*path, id(statement), *([at] if at else []))
            read |= _visit(part, inner, found, names if is_loop and not at else set())
        for name in read - assigned:
            found.setdefault(name, []).append((*path, -1))
        before |= read - assigned
        for name in names:
            found.setdefault(name, []).append((*path, id(statement)) if is_loop else path)
        assigned |= set() if is_loop else names
    return before


def in_memory(function: ast.FunctionDef) -> set[str]:
    """Return the variables of a function that need room in memory."""
    parameters = {part.arg for part in ast.walk(function.args) if isinstance(part, ast.arg)}
    found: dict[str, list[tuple[int, ...]]] = {name: [()] for name in parameters}
    _visit(function.body, (), found, set())
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


def has_loops(function: ast.FunctionDef) -> bool:
    return any(isinstance(node, (ast.For, ast.While)) for node in walk(function))


def returns_at_end(function: ast.FunctionDef) -> bool:
    """Return whether a function returns in its last statement only."""
    return isinstance(function.body[-1], ast.Return) and sum(isinstance(node, ast.Return) for node in walk(function)) == 1
