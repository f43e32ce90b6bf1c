"""Mutants: small random changes to a module's code that its tests should notice.

cosmic-ray finds the places and makes the changes. Exchanges of operators that any test would notice, because most of them cause
a TypeError (``*`` for ``<<``, ``<`` for ``is``), are left out, since they would only inflate the score. Five operators are
added: a number doubled or halved, a deleted statement, a name replaced by its counterpart, two arguments swapped, and an
exception that is not caught (cosmic-ray's own operator fails at dotted names). A change to annotations or docstrings only is
not a mutant, nor is one that only makes a keyword-only argument positional, or that compares two words alphabetically.
"""

from __future__ import annotations

import ast
import difflib
import random
from collections.abc import Iterator
from typing import Any, NamedTuple

import parso
from cosmic_ray.ast import ast_nodes, get_ast, is_number
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names

ALIKE = (
    {"Add", "Sub", "Mul", "Div"},
    {"Mul", "Pow"},
    {"Mul", "FloorDiv", "Mod"},
    {"RShift", "LShift"},
    {"BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
)
"""Operators are exchanged within each of these sets."""
NO_EFFECT = ("kernel",)
"""Decorators whose removal changes nothing without compilation."""


class Mutant(NamedTuple):
    """One change to one module."""

    path: str
    """The module, from the root of the project."""
    operator: str
    line: int
    function: str
    """Qualified name of the function; "" at the top of the module."""
    was: str
    """The changed lines before, without indentation."""
    now: str
    """The changed lines after."""
    code: str
    """The whole module, changed."""


class _Own(Operator):
    """An operator that cosmic-ray does not have; its own tests take examples from each."""

    @classmethod
    def examples(cls) -> tuple[()]:
        return ()


class ScaleNumber(_Own):
    """Double or halve a number."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        if is_number(node):
            yield from [(node.start_pos, node.end_pos)] * 2

    def mutate(self, node: Any, index: int) -> Any:
        value = ast.literal_eval(node.value)
        scaled = (value * 2 if index == 0 else value // 2) if isinstance(value, int) else value * (2.0, 0.5)[index]
        return parso.python.tree.Number(f"{node.prefix}{scaled!r}", node.start_pos)


class DeleteStatement(_Own):
    """Delete an assignment, a call or a ``raise``."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        if node.type == "simple_stmt" and node.children[0].type in ("expr_stmt", "atom_expr", "raise_stmt"):
            yield (node.start_pos, node.end_pos)

    def mutate(self, node: Any, index: int) -> Any:
        statement = node.children[0]
        node.children[0] = parso.python.tree.Keyword("pass", statement.start_pos, statement.get_first_leaf().prefix)
        return node


class SwapName(_Own):
    """Replace a function or a name by its counterpart: min by max, sine by cosine, x by y."""

    pairs = (("min", "max"), ("minimum", "maximum"), ("any", "all"), ("sin", "cos"), ("sine", "cosine"), ("floor", "ceil"))
    counterparts = dict(pairs) | {other: name for name, other in pairs} | {"x": "y", "y": "x", "v": "omega", "omega": "v"}

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        if node.type == "name" and node.value in self.counterparts and not node.is_definition():
            keyword = node.parent.type == "argument" and node is node.parent.children[0]
            if not keyword and node.parent.type != "param":
                yield (node.start_pos, node.end_pos)

    def mutate(self, node: Any, index: int) -> Any:
        node.value = self.counterparts[node.value]
        return node


class SwapArguments(_Own):
    """Swap a call's first two positional arguments, unless their order is irrelevant."""

    symmetric = ("min", "max", "minimum", "maximum", "hypot", "array_equal")

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        if node.type == "arglist" and all(child.type not in ("argument", "operator") for child in node.children[0:3:2]):
            callee = node.get_previous_leaf().get_previous_leaf()
            if callee.value not in self.symmetric:
                yield (node.start_pos, node.end_pos)

    def mutate(self, node: Any, index: int) -> Any:
        left, right = node.children[0], node.children[2]
        prefixes = left.get_first_leaf().prefix, right.get_first_leaf().prefix
        node.children[0], node.children[2] = right, left
        right.get_first_leaf().prefix, left.get_first_leaf().prefix = prefixes
        return node


class ExceptionReplacer(_Own):
    """Replace the class of a caught exception by one that nothing raises."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        if node.type == "except_clause":
            yield from [(caught.start_pos, caught.end_pos) for caught in self._caught(node)]

    def mutate(self, node: Any, index: int) -> Any:
        caught = self._caught(node)[index]
        at = caught.parent.children.index(caught)
        name = parso.python.tree.Name("NeverRaised", caught.start_pos, caught.get_first_leaf().prefix)
        caught.parent.children[at], name.parent = name, caught.parent
        return node

    @staticmethod
    def _caught(node: Any) -> list[Any]:
        caught = node.children[1]
        if caught.type != "atom":  # no parentheses
            return [caught]
        listed = caught.children[1]
        return listed.children[::2] if listed.type == "testlist_comp" else [listed]


def operators() -> dict[str, Operator]:
    """Return the operators by name."""
    by_name: dict[str, Operator] = {operator.__name__: operator() for operator in _Own.__subclasses__()}
    for full in operator_names():
        name = full.rpartition("/")[2]
        kind, *exchanged = name.split("_")
        if name in by_name:
            continue
        if kind in ("ReplaceBinaryOperator", "ReplaceComparisonOperator"):
            if any(set(exchanged) <= group for group in ALIKE):
                by_name[name] = get_operator(full)()
        elif kind not in ("VariableReplacer", "VariableInserter"):  # these need arguments
            by_name[name] = get_operator(full)()
    return by_name


def draw(path: str, code: str, count: int, *, seed: int) -> list[Mutant]:
    """Draw mutants of a module: random places, each with one applicable operator, and with a second one if needed.

    Args:
        path: Name of the module.
        code: Its source.
        count: Number of mutants; fewer if there are not enough.
        seed: The same seed draws the same mutants of the same code.
    """
    known, tree = operators(), get_ast(code)
    nodes = list(ast_nodes(tree))
    places: dict[tuple[int, int], list[tuple[str, int]]] = {}
    for name, operator in known.items():
        occurrence = 0
        for node in nodes:
            for start, _ in operator.mutation_positions(node):
                places.setdefault(start, []).append((name, occurrence))
                occurrence += 1
    rng = random.Random(f"{seed} {path}")
    queue = [rng.sample(choices, len(choices)) for _, choices in sorted(places.items())]
    rng.shuffle(queue)
    original = _meaning(code)
    seen, drawn = {original}, []
    while queue and len(drawn) < count:
        choices = queue.pop(0)
        name, occurrence = choices.pop()
        if choices:
            queue.append(choices)
        changed = mutate_code(code, known[name], occurrence)
        meaning = None if changed is None else _meaning(changed)
        if changed is not None and meaning is not None and meaning not in seen:
            seen.add(meaning)
            drawn.append(_mutant(path, name, code, changed))
    return drawn


def _meaning(code: str) -> str | None:
    """Return the parts of a module that have an effect; None if it is not valid Python."""
    try:
        tree = ast.parse(code)
    except (SyntaxError, ValueError):
        return None
    if any(_orders_words(node) for node in ast.walk(tree)):
        return None
    return ast.dump(_WithoutWords().visit(tree))


def _orders_words(node: ast.AST) -> bool:
    if not isinstance(node, ast.Compare) or not any(isinstance(part, (ast.Lt, ast.LtE, ast.Gt, ast.GtE)) for part in node.ops):
        return False
    return any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in (node.left, *node.comparators))


class _WithoutWords(ast.NodeTransformer):
    """Removes docstrings, annotations, keyword-only markers, and decorators without effect."""

    def visit_Expr(self, node: ast.Expr) -> Any:
        return None if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str) else self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> Any:
        node.annotation = ast.Constant(None)
        return self.generic_visit(node)

    def visit_arg(self, node: ast.arg) -> Any:
        node.annotation = None
        return node

    def visit_arguments(self, node: ast.arguments) -> Any:
        self.generic_visit(node)
        positional = [*node.posonlyargs, *node.args]
        defaults = [*[None] * (len(positional) - len(node.defaults)), *node.defaults, *node.kw_defaults]
        every = [*positional, *node.kwonlyargs]
        return ast.arguments([], [], node.vararg, every, defaults, node.kwarg, [])

    def visit_FunctionDef(self, node: ast.FunctionDef) -> Any:
        node.returns = None
        node.decorator_list = [decorator for decorator in node.decorator_list if getattr(decorator, "id", "") not in NO_EFFECT]
        return self.generic_visit(node)


def _mutant(path: str, operator: str, before: str, after: str) -> Mutant:
    was, now, first = [], [], 0
    lines, changed = before.splitlines(), after.splitlines()
    for tag, i, end_i, j, end_j in difflib.SequenceMatcher(None, lines, changed, autojunk=False).get_opcodes():
        if tag != "equal":
            first = first or i + 1
            was += [line.strip() for line in lines[i:end_i]]
            now += [line.strip() for line in changed[j:end_j]]
    return Mutant(path, operator, first, _function_at(ast.parse(before), first), "\n".join(was), "\n".join(now), after)


def _function_at(tree: ast.AST, line: int) -> str:
    names = []
    for node in ast.walk(tree):  # outer ones come first
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.lineno <= line <= (node.end_lineno or line):
            names.append(node.name)
    return ".".join(names)
