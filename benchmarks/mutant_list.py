"""Mutants by their source text, so that they can be found again after code has moved.

A list is a JSON file of entries with ``path``, ``function``, ``was`` and ``now``. An entry is found again in the module of its
path or, if that no longer has the changed lines, in the one module of the project that has them in a function of that name.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mutation import Mutant, draw


class Entry(NamedTuple):
    """A mutant of a list."""

    path: str
    """The module, from the root of the project."""
    function: str
    """Qualified name of the function; "" at the top of the module."""
    operator: str
    was: str
    """The changed lines before, without indentation."""
    now: str
    """The same lines afterwards."""


def record(tree: Path, quotas: Mapping[str, int], seed: int, left_out: Sequence[Mapping[str, Any]]) -> list[Entry]:
    """Draw mutants of the modules in a tree, without testing them.

    Args:
        tree: Root of a clone of the project.
        quotas: Number of mutants by module.
        seed: Seed of the draw.
        left_out: Mutants to leave out, such as those that survived or are equivalent.
    """
    known = {(row["path"], row["function"], row["was"], row["now"]) for row in left_out}
    entries = []
    for path, quota in quotas.items():
        for mutant in draw(path, (tree / path).read_text(encoding="utf-8"), quota, seed=seed):
            if (path, mutant.function, mutant.was, mutant.now) not in known:
                entries.append(Entry(path, mutant.function, mutant.operator, mutant.was, mutant.now))
    return entries


def write(path: Path, entries: Sequence[Entry]) -> None:
    """Write a list."""
    path.write_text(json.dumps([entry._asdict() for entry in entries], indent=1) + "\n", encoding="utf-8")


def read(path: Path) -> list[Entry]:
    """Read a list."""
    return [Entry(**row) for row in json.loads(path.read_text(encoding="utf-8"))]


def find(entry: Entry, sources: Mapping[str, str]) -> Mutant | None:
    """Return the mutant of an entry in the sources as they are, or None if its code is gone or stands in several modules.

    Args:
        entry: What to find.
        sources: Source by path of every module that may hold it.
    """
    if entry.path in sources and (mutant := _in_module(entry, entry.path, sources[entry.path])):
        return mutant
    mutants = [mutant for path, code in sources.items() if (mutant := _in_module(entry, path, code))]
    return mutants[0] if len(mutants) == 1 else None


def _in_module(entry: Entry, path: str, code: str) -> Mutant | None:
    was, now = entry.was.split("\n"), entry.now.split("\n")
    if was[0] not in code:
        return None
    lines = code.split("\n")
    for name, first, last in _functions(code):
        if name.rpartition(".")[2] != entry.function.rpartition(".")[2]:
            continue
        for at in range(first - 1, last - len(was) + 1):
            if [line.strip() for line in lines[at : at + len(was)]] == was:
                changed = "\n".join([*lines[:at], *_indented(lines[at : at + len(was)], now), *lines[at + len(was) :]])
                if _is_python(changed):
                    return Mutant(path, entry.operator, at + 1, name, entry.was, entry.now, changed)
    return None


def _functions(code: str) -> Iterator[tuple[str, int, int]]:
    """Yield the qualified name, first and last line of each function and class, outer ones first, and of the module last."""

    def inside(node: ast.AST, names: tuple[str, ...]) -> Iterator[tuple[str, int, int]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                start = min([child.lineno, *(decorator.lineno for decorator in child.decorator_list)])
                yield ".".join((*names, child.name)), start, child.end_lineno or child.lineno
                yield from inside(child, (*names, child.name))
            else:
                yield from inside(child, names)

    yield from inside(ast.parse(code), ())
    yield "", 1, code.count("\n") + 1


def _indented(before: Sequence[str], now: Sequence[str]) -> list[str]:
    """Return the new lines with the indentation of the old ones; further lines have that of the first."""
    indents = [line[: len(line) - len(line.lstrip())] for line in before]
    if len(now) != len(before):
        indents = [indents[0]] * len(now)
    return [indent + line for indent, line in zip(indents, now, strict=True)]


def _is_python(code: str) -> bool:
    try:
        ast.parse(code)
    except SyntaxError:
        return False
    return True
