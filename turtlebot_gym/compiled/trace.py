"""Kernels, unchanged, run on the nodes of a graph: what they return is the graph of what they compute.

A conditional expression, ``and``, ``or``, ``not`` and an ``if`` that only assigns become selections: the syntax tree of a
kernel is rewritten for that. Any other branch on a number, such as a ``return`` in the middle, is taken both ways in turn.
"""

from __future__ import annotations

import ast
import copy
import inspect
import math
from collections.abc import Callable, Sequence
from functools import cache, reduce
from types import CodeType, FunctionType
from typing import Any
from weakref import WeakKeyDictionary

from turtlebot_gym import kernel
from turtlebot_gym.compiled.graph import Graph, Node, Untraceable, as_kind, kind_of, load, make

MOST_WAYS = 200
"""Most ways through a kernel that are taken."""
_TOO_MANY = f"a kernel has more than {MOST_WAYS} ways through it"
_UNSET: Any = object()


def merged(op: str, condition: Any, a: Any, b: Any, *tag: int) -> Any:
    """Return one of two values of the same structure, number by number: an operation "sel" or "if" of the graph."""
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        items = [merged(op, condition, one, other, *tag) for one, other in zip(a, b, strict=True)]
        return type(a)(*items) if hasattr(a, "_fields") else tuple(items)
    if a is _UNSET or b is _UNSET or a is b:
        return a if a is b else _UNSET
    if isinstance(a, tuple) or isinstance(b, tuple):
        raise Untraceable("branches that return different structures")
    return make(op, condition, a, b, *tag)


def _tag() -> int:
    Graph.now.branches += 1
    return Graph.now.branches


def _select(condition: Any, then: Callable[[], Any], other: Callable[[], Any]) -> Any:
    if not isinstance(condition, Node):
        return then() if condition else other()
    return merged("sel", condition, then(), other())


def _both(a: Any, other: Callable[[], Any]) -> Any:
    if not isinstance(a, Node):
        return other() if a else a
    b = other()
    return a & b if a.kind == kind_of(b) == "b" else merged("sel", a, b, a)


def _either(a: Any, other: Callable[[], Any]) -> Any:
    if not isinstance(a, Node):
        return a if a else other()
    b = other()
    return a | b if a.kind == kind_of(b) == "b" else merged("sel", a, a, b)


def _not(a: Any) -> Any:
    return make("not", a) if isinstance(a, Node) else not a


def _branch(condition: Any, then: Callable[..., Any], other: Callable[..., Any], now: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the variables that an ``if`` assigns, after it."""
    if not isinstance(condition, Node):
        return then(*now) if condition else other(*now)
    ways = then(*now), other(*now)
    tag = _tag()
    return tuple(merged("if", condition, a, b, tag) for a, b in zip(*ways, strict=True))


def _now(variables: dict[str, Any], *names: str) -> tuple[Any, ...]:
    return tuple(variables.get(name, _UNSET) for name in names)


def _has_node(*values: Any) -> bool:
    return any(isinstance(value, Node) for value in values)


def _least(*values: Any) -> Any:
    values = values if len(values) > 1 else tuple(*values)
    return reduce(lambda a, b: make("sel", b < a, b, a) if _has_node(a, b) else min(a, b), values)


def _greatest(*values: Any) -> Any:
    values = values if len(values) > 1 else tuple(*values)
    return reduce(lambda a, b: make("sel", b > a, b, a) if _has_node(a, b) else max(a, b), values)


def _search(most: int, draw: Callable[[Any], Any]) -> tuple[Any, ...]:
    tag = _tag()
    index = load(f"attempt.{tag}", "i")
    *numbers, accepted = draw(index)
    return tuple(Graph.now.node("search", "f", as_kind(x, "f"), as_kind(accepted, "b"), most, tag, index) for x in numbers)


def _of_node(op: str, plain: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *values: make(op, *values) if _has_node(*values) else plain(*values)


def _of_library(name: str) -> Callable[..., Any]:
    plain = getattr(math, name)
    return lambda *values: make("call", name, *values) if _has_node(*values) else plain(*values)


_IN_PLACE: dict[Any, Callable[..., Any]] = {
    min: _least,
    max: _greatest,
    abs: _of_node("abs", abs),
    int: _of_node("toint", int),
    float: _of_node("tofloat", float),
    bool: _of_node("truth", bool),
    math.floor: _of_node("floor", math.floor),
    math.ceil: lambda x: -make("floor", -x) if _has_node(x) else math.ceil(x),
    math.fabs: _of_node("abs", math.fabs),
    math.sqrt: _of_node("sqrt", math.sqrt),
    math.isfinite: lambda x: abs(x) < math.inf if _has_node(x) else math.isfinite(x),
    math.isnan: lambda x: x != x if _has_node(x) else math.isnan(x),
    kernel.sqrt: _of_node("sqrt", math.sqrt),
    kernel.floor: _of_node("floor", kernel.floor),
    kernel.exactly: _of_node("tofloat", kernel.exactly),
    kernel.times: lambda a, b: make("mul", a, b),
    kernel.plus: lambda a, b: make("add", a, b),
    kernel.split: lambda x: (make("mantissa", x), make("exponent", x)),
    kernel.first_accepted: _search,
    kernel.is_plain: lambda: False,
    **{
        getattr(math, name): _of_library(name)
        for name in ("exp", "expm1", "log1p", "log2", "log10", "sin", "cos", "tan", "asin", "acos", "atan", "atan2")
    },
    **{getattr(math, name): _of_library(name) for name in ("log", "sinh", "cosh", "tanh", "fmod", "pow", "copysign")},
}
"""What stands for a function in a graph."""
_HELPERS: dict[str, Any] = {"_select_": _select, "_both_": _both, "_either_": _either, "_not_": _not, "_branch_": _branch}


def _traced(function: Any) -> Any:
    """Return what a kernel calls in place of a function."""
    if isinstance(function, FunctionType):
        is_ready = "_traced_" in function.__code__.co_freevars or function.__module__ == __name__
        return _IN_PLACE.get(function) or (function if is_ready else traced(function))
    try:
        return _IN_PLACE.get(function, function)
    except TypeError:  # what has no hash
        return function


_HELPERS |= {"_traced_": _traced, "_now_": _now}


def _assigned(statements: Sequence[ast.stmt]) -> set[str] | None:
    """Return the variables that statements assign; None if they do anything else."""
    names: set[str] = set()
    for statement in statements:
        if isinstance(statement, ast.If):
            parts = [_assigned(statement.body), _assigned(statement.orelse)]
            if None in parts:
                return None
            names.update(*(part for part in parts if part))
            continue
        if isinstance(statement, (ast.Pass, ast.Expr)):
            continue
        if not isinstance(statement, (ast.Assign, ast.AugAssign, ast.AnnAssign)) or statement.value is None:
            return None
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        for part in (node for target in targets for node in ast.walk(target)):
            if isinstance(part, ast.Name):
                names.add(part.id)
            elif not isinstance(part, (ast.Tuple, ast.List, ast.Starred, ast.expr_context)):
                return None
    return names


def _call(name: str, *args: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(name, ast.Load()), list(args), [])


def _later(body: ast.expr) -> ast.Lambda:
    return ast.Lambda(ast.arguments([], [], None, [], [], None, []), body)


class _Rewriting(ast.NodeTransformer):
    """Replaces what Python decides by the truth of a value, and lets each call find what stands for its function."""

    def visit_IfExp(self, node: ast.IfExp) -> Any:
        self.generic_visit(node)
        return _call("_select_", node.test, _later(node.body), _later(node.orelse))

    def visit_BoolOp(self, node: ast.BoolOp) -> Any:
        self.generic_visit(node)
        name = "_both_" if isinstance(node.op, ast.And) else "_either_"
        return reduce(lambda one, other: _call(name, one, _later(other)), node.values)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Any:
        self.generic_visit(node)
        return _call("_not_", node.operand) if isinstance(node.op, ast.Not) else node

    def visit_Compare(self, node: ast.Compare) -> Any:
        self.generic_visit(node)
        terms = [node.left, *node.comparators]
        pairs = [ast.Compare(terms[at], [op], [terms[at + 1]]) for at, op in enumerate(node.ops)]
        return reduce(lambda one, other: _call("_both_", one, _later(other)), pairs)

    def visit_Call(self, node: ast.Call) -> Any:
        self.generic_visit(node)
        is_local = isinstance(node.func, ast.Name) and node.func.id in ("locals", "super")
        return node if is_local else ast.Call(_call("_traced_", node.func), node.args, node.keywords)

    def visit_If(self, node: ast.If) -> Any:
        names = _assigned([node])
        self.generic_visit(node)
        if names is None:
            return node
        variables, at = sorted(names), f"{node.lineno}_{node.col_offset}"
        result = ast.Tuple([ast.Name(name, ast.Load()) for name in variables], ast.Load())
        arguments = ast.arguments([], [ast.arg(name) for name in variables], None, [], [], None, [])
        ways = [
            ast.FunctionDef(f"_{way}_{at}", arguments, [*body, ast.Return(result)], [])
            for way, body in (("then", node.body), ("else", node.orelse))
        ]
        now = _call("_now_", _call("locals"), *(ast.Constant(name) for name in variables))
        value = _call("_branch_", node.test, *(ast.Name(way.name, ast.Load()) for way in ways), now)
        targets = ast.Tuple([ast.Name(name, ast.Store()) for name in variables], ast.Store())
        return [*ways, ast.Assign([targets], value) if variables else ast.Expr(value)]


@cache
def _tree(file: str, source: str) -> dict[int, list[Any]]:
    """Return the functions of a module by the line on which they begin."""
    found: dict[int, list[Any]] = {}
    for node in ast.walk(ast.parse(source)):
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


def _program(function: FunctionType) -> CodeType:
    """Return code that defines ``outer``, which takes what the rewritten kernel refers to, and returns the kernel."""
    code, inner = function.__code__, _Rewriting().visit(copy.deepcopy(syntax_of(function)))
    arguments = ast.arguments([], [ast.arg(name) for name in (*_HELPERS, *code.co_freevars)], None, [], [], None, [])
    outer = ast.FunctionDef("outer", arguments, [inner, ast.Return(ast.Name("function", ast.Load()))], [])
    for part in ast.walk(outer):
        if isinstance(part, ast.FunctionDef) and not hasattr(part, "type_params"):
            part.type_params = []  # type: ignore[attr-defined]  # of Python 3.12
    return compile(ast.fix_missing_locations(ast.Module([outer], [])), code.co_filename, "exec")


_programs: dict[CodeType, CodeType] = {}


def _rewritten(function: FunctionType) -> Callable[..., Any]:
    code, made = function.__code__, dict[str, Any]()
    if code not in _programs:
        _programs[code] = _program(function)
    exec(_programs[code], function.__globals__, made)
    result = made["outer"](*_HELPERS.values(), *(cell.cell_contents for cell in function.__closure__ or ()))
    result.__defaults__, result.__kwdefaults__ = function.__defaults__, function.__kwdefaults__
    return result


_made: WeakKeyDictionary[FunctionType, Callable[..., Any]] = WeakKeyDictionary()


def traced(function: Any) -> Callable[..., Any]:
    """Return a function that takes nodes in place of numbers, and returns nodes."""
    if function not in _made:
        loose, made = getattr(function, "is_algebra", False), list[Callable[..., Any]]()

        def run(*args: Any, **options: Any) -> Any:
            made[:] = made or [_rewritten(function)]
            before, Graph.now.loose = Graph.now.loose, loose
            try:
                return _every_way(lambda: made[0](*args, **options), [], [0])
            finally:
                Graph.now.loose = before

        _made[function] = run
    return _made[function]


def _every_way(run: Callable[[], Any], fixed: list[tuple[Node, bool]], count: list[int]) -> Any:
    """Return what a kernel returns, whatever the numbers are on which it branches: each branch is taken both ways."""
    taken, count[0] = list(fixed), count[0] + 1
    if count[0] > MOST_WAYS:
        raise Untraceable(_TOO_MANY)

    def decide(condition: Any) -> bool:
        if not isinstance(condition, Node):
            return condition
        for node, way in taken:
            if node is condition:
                return way
        if len(taken) == MOST_WAYS:
            raise Untraceable(_TOO_MANY)
        taken.append((condition, True))
        return True

    before, Node.decide = Node.decide, staticmethod(decide)
    try:
        value = run()
    finally:
        Node.decide = before
    for at in range(len(taken) - 1, len(fixed) - 1, -1):
        other = _every_way(run, [*taken[:at], (taken[at][0], False)], count)
        value = merged("if", taken[at][0], value, other, _tag())
    return value
