"""Statements of translated kernels; ``body`` is the `translate.FunctionBody` that they belong to."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from turtlebot_gym.compiled.expressions import OPERATORS, Span
from turtlebot_gym.compiled.values import Array, Number, Untraceable, is_constant, is_natural


def on_Expr(body: Any, node: ast.Expr) -> None:
    if not isinstance(node.value, ast.Constant):
        body.of(node.value)


def on_Assign(body: Any, node: ast.Assign) -> None:
    value = body.of(node.value)
    for target in node.targets:
        assign(body, target, value)


def on_AugAssign(body: Any, node: ast.AugAssign) -> None:
    op = OPERATORS[type(node.op)]
    if isinstance(node.target, ast.Subscript):
        there = part_of(body, node.target)
        body.code.store(there, body.code.binary(op, body.code.load(there), body.of(node.value)))
    else:
        assert isinstance(node.target, ast.Name)
        body.bind(node.target.id, body.code.binary(op, body.name(node.target.id), body.of(node.value)))


def assign(body: Any, target: ast.expr, value: Any) -> None:
    if isinstance(target, ast.Name):
        body.bind(target.id, value)
    elif isinstance(target, (ast.Tuple, ast.List)):
        if isinstance(value, Array):
            value = [body.whole(body.code.item(value, at)) for at in range(len(target.elts))]
        for part, item in zip(target.elts, value, strict=True):
            assign(body, part, item)
    elif isinstance(target, ast.Subscript):
        put(body, part_of(body, target), value)
    else:
        raise Untraceable(f"an assignment to {ast.unparse(target)!r}")


def part_of(body: Any, node: ast.Subscript) -> Array:
    return body.code.item(body.of(node.value), body.of(node.slice))


def put(body: Any, place: Array, value: Any) -> None:
    """Write a number, a tuple, or another array, to a part of an array."""
    if not place.shape:
        body.code.store(place, value)
        return
    if isinstance(value, tuple) and not isinstance(value, Array):
        for at, item in enumerate(value):
            put(body, body.code.item(place, at), item)
        return
    with counting(body, 0, place.shape[0]) as at:
        item = body.whole(body.code.item(value, at)) if isinstance(value, Array) else value
        put(body, body.code.item(place, at), item)


def on_Return(body: Any, node: ast.Return) -> None:
    value = body.of(node.value) if node.value else None
    if body.syntax.returns_at_end:
        body.result = value
    else:
        body.leave(value)


def on_Break(body: Any, node: ast.Break) -> None:
    body.code.jump(body.loops[-1][0])


def on_Continue(body: Any, node: ast.Continue) -> None:
    body.code.jump(body.loops[-1][1])


def on_If(body: Any, node: ast.If) -> None:
    condition, code = body.truth(node.test), body.code
    if not isinstance(condition, Number):
        body.run(node.body if condition else node.orelse)
        return
    then, other, after = (code.module.fresh(name) for name in ("then", "else", "after"))
    code.fork(condition, then, other if node.orelse else after)
    goes_on = not node.orelse
    for label, block in ((then, node.body), (other, node.orelse)):
        if block:
            code.label(label)
            with body.apart():
                body.run(block)
            goes_on = goes_on or code.alive
            code.jump(after)
    if goes_on:
        code.label(after)


def on_While(body: Any, node: ast.While) -> None:
    code = body.code
    head, inner, after = (code.module.fresh(name) for name in ("head", "body", "after"))
    code.jump(head)
    code.label(head)
    code.fork(body.truth(node.test), inner, after)
    code.label(inner)
    with looping(body, after, head):
        run_rounds(body, node)
    code.jump(head)
    code.label(after)


def on_For(body: Any, node: ast.For) -> None:
    items, code = body.of(node.iter), body.code
    if isinstance(items, Span):
        with counting(body, *items) as at:
            run_rounds(body, node, at)
        return
    if not isinstance(items, tuple) or isinstance(items, Array):
        raise Untraceable("a loop over something that is neither a range nor a tuple")
    after = code.module.fresh("after")
    for item in items:
        following = code.module.fresh("next")
        with looping(body, after, following):
            run_rounds(body, node, item)
        code.jump(following)
        code.label(following)
    code.jump(after)
    code.label(after)


def run_rounds(body: Any, node: ast.For | ast.While, item: Any = None) -> None:
    """Write the block of a loop, for an item of its range or tuple."""
    if node.orelse:
        raise Untraceable("a loop with an else")
    if isinstance(node, ast.For):
        assign(body, node.target, item)
    body.run(node.body)


@contextmanager
def looping(body: Any, after: str, following: str) -> Iterator[None]:
    """Take what is written meanwhile for the block of a loop, with the labels of what comes after it and of its next round."""
    body.loops.append((after, following))
    with body.apart():
        yield
    body.loops.pop()


@contextmanager
def counting(body: Any, start: Any, stop: Any, step: Any = 1, independent: bool = False) -> Iterator[Number]:
    """Write a loop over whole numbers around what is written meanwhile, and yield the number."""
    code, outer = body.code, body.code.group
    head, inner, following, after = (code.module.fresh(name) for name in ("head", "body", "next", "after"))
    group, mark = code.module.independent() if independent else (outer, "")
    room = code.room("i")
    code.do(f"store i64 {code.as_kind(start, 'i')}, ptr {room}, align 8")
    last, by = Number("i", code.as_kind(stop, "i")), code.as_kind(step, "i")
    code.jump(head)
    code.label(head)
    at = Number("i", code.put(f"load i64, ptr {room}, align 8"), is_natural(start) and is_constant(step) and step > 0)
    if is_constant(step):
        goes_on = code.compare("<" if step > 0 else ">", at, last, "i")
    else:
        up, down = (code.compare(op, at, last, "i") for op in "<>")
        goes_on = code.select(code.compare(">", step, 0, "i"), up, down)
    code.fork(goes_on, inner, after)
    code.label(inner)
    code.group = group
    with looping(body, after, following):
        yield at
    code.jump(following)
    code.label(following)
    now = code.put(f"load i64, ptr {room}, align 8")
    code.group = outer
    code.do(f"store i64 {code.put(f'add nsw i64 {now}, {by}')}, ptr {room}, align 8")
    code.do(f"br label %{head}{mark}")
    code.alive = False
    code.label(after)
