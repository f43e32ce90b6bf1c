"""Expressions of translated kernels; ``body`` is the `translate.FunctionBody` that they belong to."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Sequence
from functools import cache, partial
from types import FunctionType, MethodType
from typing import Any, NamedTuple

from turtlebot_gym.compiled.values import Array, Number, Untraceable, form_of, is_number, leaves, rebuilt

OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**",
    ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^", ast.LShift: "<<", ast.RShift: ">>",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
IN_PLACE: dict[Any, Callable[..., Any]] = {}
"""What stands for a function: ``f(body, *arguments)`` writes its instructions. See `builtins`."""


class Span(NamedTuple):
    """What `range` returns."""

    start: Any
    stop: Any
    step: Any
    independent: bool = False
    """Whether the rounds share nothing."""


def of_Constant(body: Any, node: ast.Constant) -> Any:
    return node.value


def of_Name(body: Any, node: ast.Name) -> Any:
    return body.name(node.id)


def of_Tuple(body: Any, node: ast.Tuple) -> Any:
    return tuple(each(body, node.elts))


of_List = of_Tuple


def each(body: Any, nodes: Sequence[ast.expr]) -> list[Any]:
    values: list[Any] = []
    for node in nodes:
        if isinstance(node, ast.Starred):
            values += body.of(node.value)
        else:
            values.append(body.of(node))
    return values


def of_GeneratorExp(body: Any, node: ast.GeneratorExp) -> Any:
    """Return the values of a comprehension over one tuple, which is written out."""
    from turtlebot_gym.compiled.statements import assign  # which imports this module

    (loop,) = node.generators
    values = []
    for item in body.of(loop.iter):
        assign(body, loop.target, item)
        if all(body.truth(condition) for condition in loop.ifs):
            values.append(body.of(node.elt))
    return tuple(values)


of_ListComp = of_GeneratorExp


def of_Attribute(body: Any, node: ast.Attribute) -> Any:
    value = body.of(node.value)
    if not isinstance(value, Array):
        return getattr(value, node.attr)
    if node.attr == "shape":
        return value.shape
    if node.attr == "T":
        return Array(value.element, value.address, value.shape[::-1], value.strides[::-1])
    return MethodType(IN_PLACE[node.attr], value)


def of_Slice(body: Any, node: ast.Slice) -> Any:
    return slice(*(body.of(part) if part else None for part in (node.lower, node.upper, node.step)))


def of_Subscript(body: Any, node: ast.Subscript) -> Any:
    value, index = body.of(node.value), body.of(node.slice)
    if isinstance(value, Array):
        return body.whole(body.code.item(value, index))
    if not isinstance(index, Number):
        return value[index]
    chosen = body.held(value[-1])  # a tuple of equal forms
    for at, item in enumerate(value[:-1]):
        is_this, names = body.code.compare("==", index, at, "i"), body.as_form(item, form_of(chosen))
        pairs = zip(leaves(chosen), names, strict=True)
        items = iter([body.code.select(is_this, Number(leaf.kind, name), leaf) for leaf, name in pairs])
        chosen = rebuilt(chosen, lambda _, items=items: next(items))
    return chosen


def of_BinOp(body: Any, node: ast.BinOp) -> Any:
    a, b, op = body.of(node.left), body.of(node.right), OPERATORS[type(node.op)]
    if is_number(a) and is_number(b):
        return body.code.binary(op, a, b)
    if op == "+" and isinstance(a, tuple) and isinstance(b, tuple):
        return (*a, *b)
    raise Untraceable(f"the operator {op} of {type(a).__name__} and {type(b).__name__}")


def of_UnaryOp(body: Any, node: ast.UnaryOp) -> Any:
    if isinstance(node.op, ast.Not):
        truth = body.truth(node.operand)
        return body.code.number("b", f"xor i1 {truth.name}, true") if isinstance(truth, Number) else not truth
    return body.code.negative(body.of(node.operand)) if isinstance(node.op, ast.USub) else body.refuse(body, node.op)


def of_Compare(body: Any, node: ast.Compare) -> Any:
    left, result = body.of(node.left), True
    for op, right in zip(node.ops, map(body.of, node.comparators), strict=True):
        if isinstance(op, (ast.Is, ast.IsNot)):
            one: Any = (left is right) == isinstance(op, ast.Is)
        elif is_number(left) and is_number(right):
            one = body.code.binary(OPERATORS[type(op)], left, right)
        else:
            one = (left == right) == isinstance(op, ast.Eq)
        result = one if result is True else body.code.binary("&", result, one)
        left = right
    return result


def of_BoolOp(body: Any, node: ast.BoolOp) -> Any:
    is_and = isinstance(node.op, ast.And)
    value = body.truth(node.values[0])
    for rest in node.values[1:]:
        if not isinstance(value, Number):
            value = body.truth(rest) if value == is_and else value
        else:
            ways: list[Callable[[], Any]] = [partial(body.truth, rest), lambda: not is_and]
            value = either(body, value, *(ways if is_and else ways[::-1]))
    return value


def of_IfExp(body: Any, node: ast.IfExp) -> Any:
    condition = body.truth(node.test)
    if not isinstance(condition, Number):
        return body.of(node.body if condition else node.orelse)
    return either(body, condition, lambda: body.of(node.body), lambda: body.of(node.orelse))


def either(body: Any, condition: Number, then: Callable[[], Any], other: Callable[[], Any]) -> Any:
    """Return one of two values, and work out only that one."""
    code = body.code
    yes, no, after = (code.module.fresh(name) for name in ("yes", "no", "both"))
    code.fork(condition, yes, no)
    for label, way in ((yes, then), (no, other)):
        code.label(label)
        body.write(after, way())
        code.jump(after)
    code.label(after)
    return body.read(after)


def of_Call(body: Any, node: ast.Call) -> Any:
    function, arguments = body.of(node.func), each(body, node.args)
    named = {word.arg: body.of(word.value) for word in node.keywords if word.arg is not None}
    if len(named) < len(node.keywords):
        raise Untraceable("arguments with **")
    if isinstance(function, MethodType) and isinstance(function.__self__, Array):
        return function.__func__(body, function.__self__, *arguments)
    if isinstance(function, MethodType) and function.__name__ == "_replace":  # of a named tuple
        return function(**named)
    if emit := IN_PLACE.get(function) if function.__hash__ else None:
        return emit(body, *arguments, **named)
    if isinstance(function, FunctionType):
        return body.call(function, given(body, function, arguments, named))
    if isinstance(function, type) and issubclass(function, tuple):
        return function(*arguments, **named)
    if not leaves((*arguments, *named.values())):
        return function(*arguments, **named)
    raise Untraceable(f"the function {getattr(function, '__name__', function)!r}")


_signature_of = cache(inspect.signature)


def given(body: Any, function: FunctionType, arguments: list[Any], named: dict[str, Any]) -> list[Any]:
    """Return the arguments of a kernel in order, numbers in place of constants."""
    bound = _signature_of(function).bind(*arguments, **named)
    bound.apply_defaults()
    return [body.held(value) for value in bound.arguments.values()]
