"""The graph of a step: numbers, and the operations that make them from others, without an order of lanes and without memory.

A `Node` is an operation on nodes and constants. Equal nodes are one node, and what constants decide is folded by the rules of
Python's floats, to the bit; only in kernels that are `kernel.algebra`, a product with a constant zero is zero. No number is
taken to be NaN that is compared with an infinite constant.

Kinds are "f" (double), "i" (64-bit integer) and "b" (truth). The operations:

======================  ============================================================================================
load                    a number of the environment by its name: state, action, key, or a parameter of its own
gather                  column of a row of the environment's own table, by the row's number: waypoints
add sub mul div neg     arithmetic of kind "f", or "i" modulo 2^64 (no div)
sqrt floor abs          of kind "f"
mod and or xor not shr  remainder of a positive divisor, bits of kind "i", and logic of kind "b"; shr keeps the sign
lt le eq ne             comparisons, of two numbers of one kind
sel                     ``sel(c, a, b)`` is a where c is true, else b
if                      the same, with the number of an ``if`` statement: a is rarely wanted, and may be left out where no
                        lane wants it
search                  ``search(x, accepted, most, number, attempt)`` is the first x that is accepted, with "attempt", an
                        integer load, at 0, 1, and so on below "most"; else the last x
tofloat toint truth     conversions: of "i" or "b", of "f" towards zero or of "b", and whether a number is not 0
mantissa exponent       the parts of `kernel.split`
call                    a function of the C library of one or two numbers, by name
======================  ============================================================================================
"""

from __future__ import annotations

import math
import operator
import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from turtlebot_gym.kernel import split

_SIGN = 1 << 63
_PYTHON: dict[str, Callable[..., Any]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "mod": operator.mod, "neg": operator.neg,
    "and": operator.and_, "or": operator.or_, "xor": operator.xor, "shr": operator.rshift, "not": operator.not_,
    "lt": operator.lt, "le": operator.le, "eq": operator.eq, "ne": operator.ne, "abs": abs, "sqrt": math.sqrt,
    "floor": lambda x: float(math.floor(x)), "tofloat": float, "toint": int, "truth": bool,
    "mantissa": lambda x: split(x)[0], "exponent": lambda x: split(x)[1], "call": lambda name, *x: getattr(math, name)(*x),
}  # fmt: skip


class Untraceable(Exception):
    """A kernel does what no graph can hold; the message says what."""


class Node:
    """A number of a graph: see the module for its operation, its arguments and its kind."""

    __slots__ = ("args", "id", "kind", "loose", "op")
    op: str
    args: tuple[Any, ...]
    kind: str
    id: int
    """Its number in the graph, above those of its arguments."""
    loose: bool
    """Whether it comes from a kernel of `kernel.algebra`."""
    decide: Callable[[Node], bool] | None = None
    """How the truth of a node decides a branch of Python; set while kernels are traced."""

    def __bool__(self) -> bool:
        if Node.decide is None:
            raise Untraceable("a branch on a number that is not known")
        return Node.decide(make("truth", self))

    def __index__(self) -> int:
        raise Untraceable("an index or a range that is not known")

    __float__ = __int__ = __index__  # type: ignore[assignment]
    __hash__ = object.__hash__

    def __neg__(self) -> Any:
        return make("neg", self)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return make("abs", self)

    def __pow__(self, power: Any) -> Any:
        if not (isinstance(power, int) and 0 < power < 5):
            return make("call", "pow", self, float(power))
        square = make("mul", self, self)  # the products of the other compiler, see `code`
        return {1: self, 2: square, 3: make("mul", square, self), 4: make("mul", square, square)}[power]


def _operator(op: str, *, swapped: bool = False) -> Callable[[Any, Any], Any]:
    return (lambda a, b: make(op, b, a)) if swapped else (lambda a, b: make(op, a, b))


for _name, _op in {
    "truediv": "div",
    "rshift": "shr",
    **{op: op for op in ("add", "sub", "mul", "mod", "and", "or", "xor")},
}.items():
    setattr(Node, f"__{_name}__", _operator(_op))
    setattr(Node, f"__r{_name}__", _operator(_op, swapped=True))
for _name, _op, _swapped in (
    ("lt", "lt", False),
    ("le", "le", False),
    ("gt", "lt", True),
    ("ge", "le", True),
    ("eq", "eq", False),
    ("ne", "ne", False),
):
    setattr(Node, f"__{_name}__", _operator(_op, swapped=_swapped))


class Graph:
    """The nodes that exist; `Graph.now` takes the new ones."""

    now: Graph

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._known: dict[Any, Node] = {}
        self.loose = False
        """Whether a kernel of `kernel.algebra` runs."""
        self.branches = 0
        """Number of ``if`` statements so far."""

    def node(self, op: str, kind: str, *args: Any) -> Node:
        loose = self.loose and kind == "f" and op in ("add", "sub", "mul", "div")
        key = (op, kind, loose, *map(key_of, args))
        node = self._known.get(key)
        if node is None:
            node = Node()
            node.op, node.kind, node.args, node.loose, node.id = op, kind, args, loose, len(self.nodes)
            self._known[key] = node
            self.nodes.append(node)
        return node


Graph.now = Graph()


def key_of(value: Any) -> Any:
    """Return what tells a node or a constant from all others, to the bit."""
    if isinstance(value, Node):
        return value.id
    return ("f", struct.pack("d", value)) if isinstance(value, float) else (type(value).__name__, value)


def kind_of(value: Any) -> str:
    """Return the kind of a node or a constant."""
    if isinstance(value, Node):
        return value.kind
    if not isinstance(value, (bool, int, float)):
        raise Untraceable(f"a value of the type {type(value).__name__} among numbers")
    return "b" if isinstance(value, bool) else "i" if isinstance(value, int) else "f"


def load(name: str, kind: str = "f") -> Node:
    """Return a number of the environment."""
    return Graph.now.node("load", kind, name)


def as_kind(value: Any, kind: str) -> Any:
    """Return a value converted to a kind."""
    if kind_of(value) == kind:
        return value
    return make({"f": "tofloat", "i": "toint", "b": "truth"}[kind], value)


def is_constant(value: Any, number: float) -> bool:
    """Return whether a value is a constant of that number and sign."""
    return not isinstance(value, Node) and value == number and math.copysign(1.0, value) == math.copysign(1.0, number)


def make(op: str, *args: Any) -> Any:
    """Return the node of an operation, converted to one kind and folded; a constant if all arguments are."""
    kinds = [kind_of(value) for value in args if not isinstance(value, str)]
    if op in ("add", "sub", "mul", "mod", "div", "neg", "abs", "lt", "le", "eq", "ne"):
        kind = "f" if "f" in kinds or op == "div" else "i"
        args = tuple(as_kind(value, kind) for value in args)
    elif op in ("and", "or", "xor"):
        kind = "b" if kinds == ["b", "b"] else "i"
        args = tuple(as_kind(value, kind) for value in args)
    elif op in ("tofloat", "toint", "truth"):
        kind = {"tofloat": "f", "toint": "i", "truth": "b"}[op]
        if kinds[0] == kind:
            return args[0]
    elif op in ("sel", "if"):
        return _select(op, *args)
    else:
        kind = {"shr": "i", "not": "b"}.get(op, "f")
        args = tuple(value if isinstance(value, str) else as_kind(value, kind) for value in args)
    if not any(isinstance(value, Node) for value in args):
        return _compute(op, kind, args)
    if op in ("add", "mul") and not isinstance(args[0], Node):
        args = args[::-1]  # a constant is the second; the sum and the product of two numbers are the same in both orders
    folded = _fold(op, kind, args)
    return Graph.now.node(op, "b" if op in ("lt", "le", "eq", "ne") else kind, *args) if folded is None else folded


def _compute(op: str, kind: str, args: tuple[Any, ...]) -> Any:
    if op == "div":
        return (
            args[0] / args[1]
            if args[1]
            else math.copysign(math.inf, args[0]) * math.copysign(1.0, args[1])
            if args[0]
            else math.nan
        )
    value = _PYTHON[op](*args)
    return (value + _SIGN) % (2 * _SIGN) - _SIGN if kind == "i" and type(value) is int else value


def _is_never_minus_zero(value: Any) -> bool:
    """Return whether a value is certainly not -0: a sum with a constant that is not 0, also times a positive one."""
    if not isinstance(value, Node):
        return not is_constant(value, -0.0)
    constants = [x for x in value.args if isinstance(x, float)]
    if value.op == "add":
        return any(not is_constant(x, -0.0) for x in constants)
    if value.op == "mul":
        return any(x > 0.0 for x in constants) and all(map(_is_never_minus_zero, value.args))
    return value.op == "tofloat" or (value.op == "floor" and _is_never_minus_zero(value.args[0]))


def bounds(value: Any) -> tuple[float, float]:
    """Return the least and the greatest value of a number, as far as its constants say: those of a draw, above all."""
    if not isinstance(value, Node):
        return value, value
    a = value.args[0]
    if value.op == "tofloat" and isinstance(a, Node) and a.kind == "i":
        masks = [x for x in a.args if isinstance(x, int) and x >= 0] if a.op == "and" else []
        return (0.0, float(min(masks))) if masks else (-math.inf, math.inf)
    if value.op in ("add", "mul") and isinstance(b := value.args[1], float):  # rounding is monotonic
        low, high = bounds(a)
        if value.op == "add" or b > 0.0:
            return (low + b, high + b) if value.op == "add" else (low * b, high * b)
    return -math.inf, math.inf


def _fold(op: str, kind: str, args: tuple[Any, ...]) -> Any:  # a table of rules
    """Return what an operation with a constant is, None if it is no less."""
    a, b = args if len(args) == 2 else (args[0], None)
    loose = Graph.now.loose
    if op == "add" and (is_constant(b, -0.0) or (is_constant(b, 0.0) and (loose or kind == "i"))):
        return a
    if op == "sub" and (is_constant(b, 0.0) or (loose and is_constant(b, -0.0))):
        return a
    if op in ("mul", "div") and is_constant(b, 1.0):
        return a
    if op == "mul":
        if kind == "f" and loose and not isinstance(b, Node) and b == 0.0:
            return 0.0
        if kind == "f" and is_constant(b, -1.0):
            return make("neg", a)
    if op == "neg" and isinstance(a, Node) and a.op == "neg":
        return a.args[0]
    if op == "mod" and kind == "i" and is_constant(b, 1):
        return 0
    if op in ("and", "or") and kind == "b":
        for one, other in (args, args[::-1]):
            if not isinstance(one, Node):
                return other if one is (op == "and") else one
        return a if a is b else None
    if (
        op == "and"
        and isinstance(a, Node)
        and a.op == "toint"
        and isinstance(a.args[0], Node)
        and a.args[0].op == "floor"
        and b in (1, 3)
    ):
        whole, turn = a.args[0], (2, 4)[b == 3]  # the last bits of a whole number, without an integer
        return make("toint", make("sub", whole, make("mul", make("floor", make("mul", whole, 1.0 / turn)), float(turn))))
    if op in ("lt", "le", "eq", "ne") and kind == "f":
        if op in ("lt", "le") and not (isinstance(a, Node) and isinstance(b, Node)):
            (least_a, most_a), (least_b, most_b) = bounds(a), bounds(b)
            if most_a < least_b:
                return True
            if least_a > most_b:
                return False
        if op == "lt" and (is_constant(a, math.inf) or is_constant(b, -math.inf)):
            return False
        if op == "le" and (is_constant(b, math.inf) or is_constant(a, -math.inf)):
            return True
        if op == "ne" and isinstance(a, Node) and a.op == "tofloat" and is_constant(b, 0.0):
            return make("truth", a.args[0])
    if op in ("lt", "le", "eq", "ne") and kind == "i":  # whole numbers that are exact as floats compare as such
        whole = [x.args[0] if isinstance(x, Node) and x.op == "toint" and _is_whole(x.args[0]) else x for x in args]
        if all(not isinstance(x, Node) or x.kind == "f" for x in whole):
            return make(op, *(as_kind(x, "f") for x in whole))
    if op == "not" and isinstance(a, Node) and a.op == "not":
        return a.args[0]
    if op == "tofloat" and isinstance(a, Node) and a.op == "toint" and isinstance(a.args[0], Node) and _is_whole(a.args[0]):
        return a.args[0]
    if op == "truth" and kind == "b" and isinstance(a, Node):
        return make("ne", a, 0.0 if a.kind == "f" else 0)
    if op == "floor" and not _is_never_minus_zero(a):
        return make("add", Graph.now.node("floor", "f", a), 0.0) if not loose else None
    return None


def _is_whole(value: Any) -> bool:
    """Return whether a float is a whole number by how it was made, and not -0."""
    if not isinstance(value, Node):
        return value == math.floor(value)
    if value.op in ("add", "sub", "mul"):
        return all(_is_whole(x) for x in value.args)
    return value.op in ("floor", "tofloat")


def _select(op: str, condition: Any, a: Any, b: Any, *tag: int) -> Any:
    condition = as_kind(condition, "b")
    if not isinstance(condition, Node):
        return a if condition else b
    if key_of(a) == key_of(b):
        return a
    kinds = {kind_of(a), kind_of(b)}
    kind = kinds.pop() if len(kinds) == 1 else "f" if "f" in kinds else "i"
    a, b = as_kind(a, kind), as_kind(b, kind)
    if kind == "b" and not (isinstance(a, Node) and isinstance(b, Node)):
        if isinstance(a, Node):
            return make("and", condition, a) if b is False else make("or", make("not", condition), a)
        if isinstance(b, Node):
            return make("and", make("not", condition), b) if a is False else make("or", condition, b)
        return condition if a else make("not", condition)
    return Graph.now.node(op, kind, condition, a, b, *tag)


def live(values: Iterable[Any]) -> list[Node]:
    """Return the nodes that some values are made of, each after its arguments."""
    found: dict[int, Node] = {}
    stack = [value for value in values if isinstance(value, Node)]
    while stack:
        node = stack.pop()
        if node.id not in found:
            found[node.id] = node
            stack += [value for value in node.args if isinstance(value, Node)]
    return [found[number] for number in sorted(found)]


def rebuilt(values: Mapping[str, Any], loads: Mapping[str, Any]) -> dict[str, Any]:
    """Return values made anew in the present graph, with other values for some loads, and folded again."""
    new: dict[int, Any] = {}
    for node in live(values.values()):
        if node.op == "load":
            new[node.id] = loads[node.args[0]] if node.args[0] in loads else load(node.args[0], node.kind)
            continue
        args = [new[value.id] if isinstance(value, Node) else value for value in node.args]
        Graph.now.loose = node.loose
        new[node.id] = Graph.now.node(node.op, "f", *args) if node.op in ("gather", "search") else make(node.op, *args)
    Graph.now.loose = False
    return {name: new[value.id] if isinstance(value, Node) else value for name, value in values.items()}
