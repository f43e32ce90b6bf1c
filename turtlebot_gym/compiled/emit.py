"""A graph as text for LLVM: straight-line code in which each number is a vector of the eight environments of a tile.

What an ``if`` statement makes stands in a block of its own, which runs only where some environment of the tile wants it.
Nothing is reordered or contracted: LLVM keeps the bits of each operation.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from turtlebot_gym.compiled.graph import Node, kind_of, live
from turtlebot_gym.compiled.packing import TILE
from turtlebot_gym.compiled.regions import BLOCKS, ROOT, Region, around, block_of, blocks_around, homes_of
from turtlebot_gym.compiled.values import HALF, LLVM, LOW, MAGIC, constant

_COMPARED = ("lt", "le", "eq", "ne")
_BINARY = {
    "f": {op: f"f{op}" for op in ("add", "sub", "mul", "div")}
    | dict(zip(_COMPARED, ("fcmp olt", "fcmp ole", "fcmp oeq", "fcmp une"), strict=True)),
    "i": {op: op for op in ("add", "sub", "mul", "and", "or", "xor")}
    | {"shr": "ashr"}
    | dict(zip(_COMPARED, ("icmp slt", "icmp sle", "icmp eq", "icmp ne"), strict=True)),
    "b": {op: op for op in ("and", "or", "xor")},
}


def vector(kind: str) -> str:
    """Return the type of a number of all lanes."""
    return f"<{TILE} x {LLVM.get(kind, kind)}>"


class Writer:
    """Writes the text of a function.

    Args:
        load: ``load(writer, node)`` writes a node of memory, "load" or "gather", and returns the name of its value.
    """

    def __init__(self, load: Callable[[Writer, Node], str]) -> None:
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self._load, self._count, self._names = load, itertools.count(), dict[int, str]()
        self.block = "entry"

    def put(self, text: str) -> str:
        """Write an instruction and return the name of its result."""
        name = f"%v{next(self._count)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def do(self, text: str) -> None:
        """Write an instruction without a result."""
        self.lines.append(f"  {text}")

    def label(self, name: str) -> None:
        """Begin a block."""
        self.lines.append(f"{name}:")
        self.block = name

    def fresh(self, name: str) -> str:
        """Return a label that no other block has."""
        return f"{name}{next(self._count)}"

    def call(self, kind: str, name: str, *arguments: str) -> str:
        """Write a call; arguments have their types before them."""
        self.declare(kind, name, arguments)
        return self.put(f"call {kind} @{name}({', '.join(arguments)})")

    def declare(self, kind: str, name: str, arguments: Iterable[str]) -> None:
        """Declare an external function."""
        kinds = [text[: text.index(">") + 1] if text.startswith("<") else text.split()[0] for text in arguments]
        self.declared.add(f"declare {kind} @{name}({', '.join(kinds)})")

    def constant(self, value: float, kind: str) -> str:
        """Return a constant in all lanes."""
        return f"<{', '.join([f'{LLVM[kind]} {constant(value, kind)}'] * TILE)}>"

    def value(self, value: Any) -> str:
        """Return the name of a node that has been written, or a constant."""
        return self._names[value.id] if isinstance(value, Node) else self.constant(value, kind_of(value))

    def any(self, name: str) -> str:
        """Return whether a truth holds in some lane."""
        return self.put(f"icmp ne i{TILE} {self.bits(name)}, 0")

    def bits(self, name: str) -> str:
        """Return a truth as an integer with a bit for each lane."""
        return self.put(f"bitcast {vector('b')} {name} to i{TILE}")

    def write(self, values: Sequence[Any], done: Callable[[Any], None]) -> None:
        """Write all nodes of some values; ``done(node)`` is called after each that always runs."""
        nodes = live(values)
        homes = homes_of(nodes, values)
        self._blocks: dict[Region, list[Node]] = {}
        self._outer: dict[Region, list[Node]] = {}
        for node in nodes:
            self._blocks.setdefault(homes[node.id], []).append(node)
            for at, value in enumerate(node.args):
                if isinstance(value, Node) and value.op == "load":
                    child = block_of(node, at, homes[node.id])
                    inner = child if child and (child in self._blocks or child == homes[value.id]) else homes[node.id]
                    for region in blocks_around(inner):
                        if around(region, homes[value.id]) != region:
                            self._outer.setdefault(region, []).append(value)
        self._write_block(ROOT, done)

    def _write_block(self, region: Region, done: Callable[[Any], None] | None) -> None:
        nodes = self._blocks.get(region, [])
        merges: dict[int, list[Node]] = {}
        for node in nodes:
            if node.op in BLOCKS:
                merges.setdefault(node.args[3], []).append(node)
        for node in nodes:
            if node.id in self._names or node.op == "load":
                continue  # memory is read where a number is wanted first
            child = block_of(node, BLOCKS.get(node.op, (0,))[0], region)
            if child in self._blocks:
                (self._merge if node.op == "if" else self._search)(child, merges[node.args[3]])
            else:
                self.wanted(*node.args)
                self._names[node.id] = self._load(self, node) if node.op == "gather" else self._operation(node)
            if done:
                for each in merges[node.args[3]] if child in self._blocks else (node,):
                    done(each)

    def wanted(self, *values: Any) -> None:
        """Read those numbers from memory that have not been read."""
        for value in values:
            if isinstance(value, Node) and value.id not in self._names:
                assert value.op == "load", f"{value.op} comes too late"
                self._names[value.id] = self._load(self, value)

    def _merge(self, region: Any, merges: list[Node]) -> None:
        """Write a block, and the choice between what it makes and what else there is."""
        self.wanted(*(value for node in merges for value in (node.args[0], node.args[2])), *self._outer.get(region, ()))
        then, after, before = self.fresh("then"), self.fresh("after"), self.block
        self.do(f"br i1 {self.any(self.value(merges[0].args[0]))}, label %{then}, label %{after}")
        self.label(then)
        self._write_block(region, None)
        self.wanted(*(node.args[1] for node in merges))
        chosen, end = [self._choice(node) for node in merges], self.block
        self.do(f"br label %{after}")
        self.label(after)
        for node, name in zip(merges, chosen, strict=True):
            other = self.value(node.args[2])
            self._names[node.id] = self.put(f"phi {vector(node.kind)} [ {name}, %{end} ], [ {other}, %{before} ]")

    def _search(self, region: Any, merges: list[Node]) -> None:
        """Write the loop of a search."""
        self.wanted(*(x for x in self._outer.get(region, ()) if x is not merges[0].args[4]))
        loop, after, before = self.fresh("search"), self.fresh("found"), self.block
        own, whole, truth = vector("f"), vector("i"), vector("b")
        self.do(f"br label %{loop}")
        self.label(loop)
        start = len(self.lines)
        first = self.put(f"insertelement {whole} poison, i64 %{loop}.i, i32 0")
        self._names[merges[0].args[4].id] = self.put(
            f"shufflevector {whole} {first}, {whole} poison, <{TILE} x i32> zeroinitializer"
        )
        self._write_block(region, None)
        accepted = self.put(f"or {truth} %{loop}.done, {self.value(merges[0].args[1])}")
        names = [
            self.put(f"select {truth} %{loop}.done, {own} %{loop}.{at}, {own} {self.value(node.args[0])}")
            for at, node in enumerate(merges)
        ]
        following, end = self.put(f"add i64 %{loop}.i, 1"), self.block
        is_last = self.put(f"icmp eq i64 {following}, {merges[0].args[2]}")
        is_done = self.put(f"icmp eq i{TILE} {self.bits(accepted)}, -1")
        self.do(f"br i1 {self.put(f'or i1 {is_last}, {is_done}')}, label %{after}, label %{loop}")
        phis = [("i", "i64", "0", following), ("done", truth, "zeroinitializer", accepted)]
        phis += [(str(at), own, "zeroinitializer", name) for at, name in enumerate(names)]
        self.lines[start:start] = [
            f"  %{loop}.{name} = phi {kind} [ {zero}, %{before} ], [ {value}, %{end} ]" for name, kind, zero, value in phis
        ]
        self.label(after)
        self._names.update((node.id, name) for node, name in zip(merges, names, strict=True))

    def _choice(self, node: Node) -> str:
        condition, a, b = map(self.value, node.args[:3])
        kind = vector(node.kind)
        return self.put(f"select {vector('b')} {condition}, {kind} {a}, {kind} {b}")

    def _operation(self, node: Node) -> str:
        op, kind = node.op, kind_of(node.args[0]) if not isinstance(node.args[0], str) else "f"
        if op in ("sel", "if"):
            return self._choice(node)
        names, own = [self.value(value) for value in node.args if not isinstance(value, str)], vector(node.kind)
        if op in _BINARY[kind] and len(names) == 2:
            return self.put(f"{_BINARY[kind][op]} {vector(kind)} {names[0]}, {names[1]}")
        if op in ("sqrt", "floor", "abs"):
            return self.call(own, f"llvm.{'fabs' if op == 'abs' else op}.v{TILE}f64", f"{own} {names[0]}")
        if op == "neg":
            return self.put(f"fneg {own} {names[0]}" if kind == "f" else f"sub {own} zeroinitializer, {names[0]}")
        if op == "not":
            return self.put(f"xor {own} {names[0]}, {self.constant(True, 'b')}")
        if op == "mod":
            return self._remainder(node.kind, own, *names)
        if op in ("tofloat", "toint"):
            return self._converted(node, kind, names[0])
        if op in ("mantissa", "exponent"):
            return self._part(op, names[0])
        assert op == "call", op
        return self._called(node.args[0], names)

    def _remainder(self, kind: str, own: str, a: str, b: str) -> str:
        rest = self.put(f"{'frem' if kind == 'f' else 'srem'} {own} {a}, {b}")
        is_below = self.put(f"{_BINARY[kind]['lt']} {own} {rest}, zeroinitializer")
        above = self.put(f"{_BINARY[kind]['add']} {own} {rest}, {b}")
        return self.put(f"select {vector('b')} {is_below}, {own} {above}, {own} {rest}")

    def _converted(self, node: Node, kind: str, name: str) -> str:
        own, given, source = vector(node.kind), vector(kind), node.args[0]
        if kind == "b":
            if node.kind == "i":
                return self.put(f"zext {given} {name} to {own}")
            return self.put(f"select {given} {name}, {own} {self.constant(1.0, 'f')}, {own} zeroinitializer")
        if kind == "f":
            return self.put(f"fptosi {given} {name} to {own}")
        masks = [x for x in source.args if isinstance(x, int)] if source.op == "and" else []
        if not (masks and 0 <= masks[0] <= LOW):
            return self.put(f"sitofp {given} {name} to {own}")
        bits = self.put(f"or {given} {name}, {self.constant(MAGIC, 'i')}")  # a whole number below 2^52: exact
        return self.put(f"fsub {own} {self.put(f'bitcast {given} {bits} to {own}')}, {self.constant(2.0**52, 'f')}")

    def _part(self, op: str, name: str) -> str:
        whole, own = vector("i"), vector("f")
        bits = self.put(f"bitcast {own} {name} to {whole}")
        if op == "mantissa":
            low = self.put(f"and {whole} {bits}, {self.constant(LOW, 'i')}")
            half = self.put(f"or {whole} {low}, {self.constant(HALF, 'i')}")
            return self.put(f"bitcast {whole} {half} to {own}")
        exponent = self.put(f"lshr {whole} {bits}, {self.constant(52, 'i')}")
        shown = self.put(f"or {whole} {exponent}, {self.constant(MAGIC, 'i')}")
        return self.put(f"fsub {own} {self.put(f'bitcast {whole} {shown} to {own}')}, {self.constant(2.0**52 + 1022.0, 'f')}")

    def _called(self, name: str, arguments: list[str]) -> str:
        own, result = vector("f"), "poison"
        for lane in range(TILE):
            each = [f"double {self.put(f'extractelement {own} {argument}, i32 {lane}')}" for argument in arguments]
            result = self.put(f"insertelement {own} {result}, double {self.call('double', name, *each)}, i32 {lane}")
        return result
