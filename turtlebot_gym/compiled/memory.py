"""The memory of open ground's code: where numbers come from, where they go, and the loop over the tiles.

A function takes the address of a `BLOCK` of 64-bit integers: addresses and sizes. A tile holds the numbers of eight
environments, one cache line after another, so that memory is read and written in one stream.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from turtlebot_gym.compiled.emit import Writer, vector
from turtlebot_gym.compiled.graph import Node, key_of, live
from turtlebot_gym.compiled.packing import TILE
from turtlebot_gym.systems import Outcome

BLOCK = (
    "actions", "tiles", "keys", "parameters", "stride", "waypoints", "observations", "outcomes", "first", "end", "environments",
    "shares", "flagged", "mask", "begins", "seeds", "episodes",
)  # fmt: skip
"""Addresses of arrays; the bytes from one tile's parameters to the next one's; the first tile, and the one after the last; the
number of environments; whether outcomes have rows for the shares of the reward; how many tiles have a flag, which the function
writes; and for resets the addresses of a mask and of the numbers of the episodes, and whether episodes begin."""
KEYS = TILE + 2
"""Integers of a tile among the keys."""
FIRST_SHARE = Outcome._fields.index("shares")
"""Row of the first share in an outcome."""
_FLAGS = ("is_success", "terminated", "truncated")
_F, _I, _B, _R = vector("f"), vector("i"), vector("b"), vector("float")
_ALL = ", ".join(f"i64 {lane}" for lane in range(TILE))


class Memory:
    """Writes the function of a loop over tiles.

    Args:
        name: Of the function.
        places: Place of each number of the world.
        own: Place of each parameter of an environment.
        shown: Column of each number in an observation.
        rows: Row of each number in an outcome.
        waypoints: Number of waypoints.
        size: Places in a tile.
        width: Columns of an observation.
    """

    def __init__(
        self,
        name: str,
        places: Mapping[str, int],
        own: Mapping[str, int],
        shown: Mapping[str, int],
        rows: Mapping[str, int],
        waypoints: int,
        size: int,
        width: int,
    ) -> None:
        self.name, self.places, self.own, self.shown, self.rows = name, places, own, shown, rows
        self.waypoints, self.size, self.width = waypoints, size, width
        self.writer, self.scratch = Writer(self.read), 0
        self.lanes, self.asked = "%lanes", ""

    def at(self, address: str, offset: int) -> str:
        """Return a pointer with its type."""
        put = self.writer.put
        place = put(f"add i64 {address}, {offset}") if offset else address
        return "ptr " + put(f"inttoptr i64 {place} to ptr")

    def load(self, kind: str, address: str, offset: int = 0, align: int = 8) -> str:
        return self.writer.put(f"load {kind}, {self.at(address, offset)}, align {align}")

    def store(self, kind: str, value: str, address: str, offset: int = 0, align: int = 8) -> None:
        self.writer.do(f"store {kind} {value}, {self.at(address, offset)}, align {align}")

    def masked(
        self, which: str, kind: str, address: str, offset: int, mask: str, value: str = "zeroinitializer", align: int = 8
    ) -> str:
        """Write a load or a store of those lanes that a mask has."""
        lanes, scalar = kind.strip("<>").split(" x ")
        short = f"v{lanes}" + {"double": "f64", "float": "f32", "i64": "i64"}[scalar]
        pointer = self.at(address, offset)
        name = f"llvm.masked.{which}.{short}.p0"
        bits = f"<{lanes} x i1> {mask}"
        result, arguments = (
            ("void", [f"{kind} {value}", pointer, f"i32 {align}", bits])
            if which == "store"
            else (kind, [pointer, f"i32 {align}", bits, f"{kind} {value}"])
        )
        self.writer.declare(result, name, arguments)
        call = f"call {result} @{name}({', '.join(arguments)})"
        if which == "store":
            self.writer.do(call)
            return ""
        return self.writer.put(call)

    def read(self, writer: Writer, node: Node) -> str:
        """Write the load of a number; see `Writer`."""
        if node.op == "gather":
            return self.gathered(writer.value(node.args[0]), node.args[1])
        name = node.args[0]
        part, _, rest = name.partition(".")
        if part == "action":
            return self.action(int(rest))
        if part == "goal":
            return self.gathered(writer.constant(0, "i"), "xyt".index(rest[0]))
        if name == "begins":
            flag = writer.put("icmp ne i64 %begins, 0")
            first = writer.put(f"insertelement {_B} poison, i1 {flag}, i32 0")
            return writer.put(f"shufflevector {_B} {first}, {_B} poison, <{TILE} x i32> zeroinitializer")
        if name in ("seed", "episode"):
            return self.masked("load", _I, "%own_" + name, 0, self.lanes)
        if name == "key":
            return self.load(_I, "%keyed")
        value = (
            self.load(_F, "%ahead", self.own[name] * TILE * 8, 64)
            if part == "p"
            else self.load(_F, "%tile", self.places[name] * TILE * 8, 64)
        )
        return writer.put(f"fcmp une {_F} {value}, zeroinitializer") if node.kind == "b" else value

    def action(self, axis: int) -> str:
        put = self.writer.put
        odd = ", ".join(f"i32 {2 * lane + axis}" for lane in range(TILE))
        some = put(f"shufflevector <{2 * TILE} x float> {self.asked}, <{2 * TILE} x float> poison, <{TILE} x i32> <{odd}>")
        return put(f"fpext {_R} {some} to {_F}")

    def spread(self, number: str) -> str:
        """Return an integer in all lanes."""
        first = self.writer.put(f"insertelement {_I} poison, i64 {number}, i32 0")
        return self.writer.put(f"shufflevector {_I} {first}, {_I} poison, <{TILE} x i32> zeroinitializer")

    def least(self, a: str, b: str) -> str:
        """Return the smaller one of two whole numbers without a sign."""
        is_less = self.writer.put(f"icmp ult {_I} {a}, {b}")
        return self.writer.put(f"select {_B} {is_less}, {_I} {a}, {_I} {b}")

    def places_of_waypoints(self, index: str, column: int) -> list[str]:
        """Return the addresses of a column of waypoints, whose index each environment has for itself."""
        put, number = self.writer.put, self.writer.constant
        # Environments that fill up the last tile have no row of their own, and may have any index.
        rows = self.least("%rows", self.spread(put("sub i64 %environments, 1")))
        index = self.least(index, number(self.waypoints - 1, "i"))
        row = put(f"mul {_I} {rows}, {number(self.waypoints, 'i')}")
        offsets = put(f"mul {_I} {put(f'add {_I} {row}, {index}')}, {number(24, 'i')}")
        each = [put(f"extractelement {_I} {offsets}, i32 {lane}") for lane in range(TILE)]
        start = put(f"add i64 %waypoints, {8 * column}")
        return [put(f"add i64 {start}, {offset}") for offset in each]

    def gathered(self, index: str, column: int) -> str:
        result = "poison"
        for lane, address in enumerate(self.places_of_waypoints(index, column)):
            result = self.writer.put(f"insertelement {_F} {result}, double {self.load('double', address)}, i32 {lane}")
        return result

    def show(self, name: str, value: Any) -> None:
        """Write a number of an observation to the scratch."""
        small = self.writer.put(f"fptrunc {_F} {self.writer.value(value)} to {_R}")
        self.store(_R, small, "%scratch", self.shown[name] * TILE * 4, 4)

    def tell(self, name: str, value: Any) -> None:
        """Write a number of an outcome to its row."""
        address = self.writer.put(f"add i64 %told, {self.writer.put(f'mul i64 %environments, {8 * self.rows[name]}')}")
        self.masked("store", _F, address, 0, self.lanes, self.writer.value(value))

    def copy_shown(self) -> None:
        """Copy the observations from the scratch to the rows of environments."""
        writer, put = self.writer, self.writer.put
        head, row, after, before = (writer.fresh(name) for name in ("lane", "row", "next", "shown"))
        bits = writer.bits(self.lanes)
        writer.do(f"br label %{before}")
        writer.label(before)
        writer.do(f"br label %{head}")
        writer.label(head)
        lane, following = f"%{head}.i", f"%{after}.i"
        writer.do(f"{lane} = phi i64 [ 0, %{before} ], [ {following}, %{after} ]")
        shifted = put(f"lshr i{TILE} {bits}, {put(f'trunc i64 {lane} to i{TILE}')}")
        writer.do(f"br i1 {put(f'trunc i{TILE} {shifted} to i1')}, label %{row}, label %{after}")
        writer.label(row)
        source = put(f"add i64 %scratch, {put(f'mul i64 {lane}, 4')}")
        environment = put(f"add i64 %origin, {lane}")
        target = put(f"add i64 %observations, {put(f'mul i64 {environment}, {4 * self.width}')}")
        for column in sorted(self.shown.values()):
            self.store("float", self.load("float", source, column * TILE * 4, 4), target, column * 4, 4)
        writer.do(f"br label %{after}")
        writer.label(after)
        writer.do(f"{following} = add i64 {lane}, 1")
        end = writer.fresh("end")
        writer.do(f"br i1 {put(f'icmp ult i64 {following}, {TILE}')}, label %{head}, label %{end}")
        writer.label(end)

    def function(self, body: Callable[[], str]) -> tuple[str, set[str]]:
        """Return the text of the function, and what it declares.

        Args:
            body: ``body()`` writes a tile, and returns whether it has a flag, an i64.
        """
        writer, put = self.writer, self.writer.put
        room = max(self.shown.values(), default=0) + 1
        writer.label("entry")
        writer.do(f"%room = alloca [{room * TILE} x float], align 64")
        writer.do("%scratch = ptrtoint ptr %room to i64")
        for index, name in enumerate(BLOCK):
            loaded = self.load("i64", "%block", 8 * index)
            writer.do(f"%{name} = add i64 {loaded}, 0")
        writer.do("%some = icmp slt i64 %first, %end")
        writer.do("br i1 %some, label %head, label %exit")
        writer.label("head")
        writer.do("%number = phi i64 [ %first, %entry ], [ %following, %latch ]")
        writer.do("%flags = phi i64 [ 0, %entry ], [ %more, %latch ]")
        writer.do(f"%origin = mul i64 %number, {TILE}")
        for name, array, step in (
            ("tile", "tiles", self.size * TILE * 8),
            ("keyed", "keys", KEYS * 8),
            ("told", "outcomes", TILE * 8),
        ):
            writer.do(f"%{name} = add i64 %{array}, {put(f'mul i64 %number, {step}')}")
        writer.do(f"%ahead = add i64 %parameters, {put('mul i64 %number, %stride')}")
        writer.do("%left = sub i64 %environments, %origin")
        writer.do(f"%rows = add {_I} {self.spread('%origin')}, <{_ALL}>")
        writer.do(f"%counts = add {_I} {self.spread('%left')}, zeroinitializer")
        writer.do(f"%lanes = icmp slt {_I} <{_ALL}>, %counts")
        flag = body()
        writer.do(f"%more = add i64 %flags, {flag}")
        writer.do("br label %latch")
        writer.label("latch")
        writer.do("%following = add i64 %number, 1")
        writer.do("%goes_on = icmp slt i64 %following, %end")
        writer.do("br i1 %goes_on, label %head, label %exit")
        writer.label("exit")
        writer.do("%told_flags = phi i64 [ 0, %entry ], [ %more, %latch ]")
        self.store("i64", "%told_flags", "%block", 8 * BLOCK.index("flagged"))
        writer.do("ret void")
        lines = "\n".join(writer.lines)
        wide = '"prefer-vector-width"="512" "min-legal-vector-width"="512"'
        return f"define void @{self.name}(i64 %block) {wide} nounwind {{\n{lines}\n}}\n", writer.declared

    def outputs(self, numbers: Mapping[str, Any], keep: Callable[[str, Any], None]) -> None:
        """Write all numbers of a tile, each to its memory as soon as it is there; ``keep(name, value)`` stores the world's."""
        wanted: dict[Any, list[tuple[str, Any]]] = {}
        shares = [name for name in self.rows if self.rows[name] >= FIRST_SHARE]
        for name, value in numbers.items():
            if name not in shares:
                wanted.setdefault(key_of(value), []).append((name, value))

        def done(value: Any) -> None:
            for name, it in wanted.pop(key_of(value), ()):
                if name in self.shown:
                    self.show(name, it)
                elif name in self.rows:
                    self.tell(name, it)
                else:
                    keep(name, it)

        self.writer.write(list(numbers.values()), done)
        for rest in list(wanted.values()):
            self.writer.wanted(rest[0][1])
            done(rest[0][1])
        if shares:
            writer = self.writer
            then, after = writer.fresh("shares"), writer.fresh("told")
            self.writer.wanted(*(numbers[name] for name in shares))
            writer.do(f"br i1 {writer.put('icmp ne i64 %shares, 0')}, label %{then}, label %{after}")
            writer.label(then)
            for name in shares:
                self.tell(name, numbers[name])
            writer.do(f"br label %{after}")
            writer.label(after)


def step_text(numbers: Mapping[str, Any], places: Mapping[str, int], kept: list[str], *arguments: Any) -> Any:
    """Return the text of the function "step"."""
    memory = Memory("step", places, *arguments)
    writer = memory.writer
    loads = {}

    def keep(name: str, value: Any) -> None:
        loads_now = loads.get(name)
        if loads_now is not None:
            writer.wanted(loads_now)
        memory.store(_F, writer.value(value), "%tile", places[name] * TILE * 8, 64)

    def body() -> str:
        both = ", ".join(f"i32 {at // 2}" for at in range(2 * TILE))
        mask = writer.put(f"shufflevector {_B} %lanes, {_B} poison, <{2 * TILE} x i32> <{both}>")
        address = writer.put(f"add i64 %actions, {writer.put(f'mul i64 %number, {TILE * 8}')}")
        memory.asked = memory.masked("load", f"<{2 * TILE} x float>", address, 0, mask, align=4)
        out = {name: value for name, value in numbers.items() if name in kept or not name.startswith("world.")}
        out = {name: value for name, value in out.items() if not (isinstance(value, Node) and is_load(value, name))}
        loads.update({node.args[0]: node for node in live(out.values()) if node.op == "load"})
        memory.outputs(out, keep)
        memory.copy_shown()
        flags = [writer.put(f"fcmp une {_F} {writer.value(out[f'outcome.{name}'])}, zeroinitializer") for name in _FLAGS]
        some = writer.put(f"or {_B} {writer.put(f'or {_B} {flags[0]}, {flags[1]}')}, {flags[2]}")
        return writer.put(f"zext i1 {writer.any(writer.put(f'and {_B} {some}, %lanes'))} to i64")

    return memory.function(body)


def is_load(value: Node, name: str) -> bool:
    """Return whether a number is what it was, also as a truth."""
    while value.op == "tofloat":
        value = value.args[0]
    return value.op == "load" and value.args[0] == name


def reset_text(numbers: Mapping[str, Any], places: Mapping[str, int], kept: list[str], *arguments: Any) -> Any:
    """Return the text of the function "reset"."""
    memory = Memory("reset", places, *arguments)
    writer = memory.writer
    memory.lanes = "%chosen"

    def body() -> str:
        marks = writer.put("add i64 %mask, %origin")
        marked = memory.load(f"<{TILE} x i8>", marks, 0, 1)
        chosen = writer.put(f"icmp ne <{TILE} x i8> {marked}, zeroinitializer")
        writer.do(f"%chosen = and {_B} {chosen}, %lanes")
        for name in ("seed", "episode"):
            writer.do(f"%own_{name} = add i64 %{name}s, {writer.put('mul i64 %origin, 8')}")
        writer.do(f"br i1 {writer.any('%chosen')}, label %visit, label %visited")
        writer.label("visit")
        out = {name: value for name, value in numbers.items() if name in kept or not name.startswith("world.")}
        late: list[tuple[str, Any]] = []
        memory.outputs(out, lambda name, value: late.append((name, value)))
        for name, value in late:
            if name == "key":
                memory.masked("store", _I, "%keyed", 0, "%chosen", writer.value(value))
            elif name.startswith("goal."):
                _put_goal(memory, "xyt".index(name[5]), writer.value(value))
            else:
                memory.masked("store", _F, "%tile", places[name] * TILE * 8, "%chosen", writer.value(value), 64)
        memory.copy_shown()
        writer.do("br label %visited")
        writer.label("visited")
        return "0"

    return memory.function(body)


def _put_goal(memory: Memory, column: int, name: str) -> None:
    """Write the goal of the chosen environments as their first waypoint."""
    writer = memory.writer
    for lane, address in enumerate(memory.places_of_waypoints(writer.constant(0, "i"), column)):
        then, after = writer.fresh("put"), writer.fresh("on")
        is_chosen = writer.put(f"extractelement {_B} %chosen, i32 {lane}")
        number = writer.put(f"extractelement {_F} {name}, i32 {lane}")
        writer.do(f"br i1 {is_chosen}, label %{then}, label %{after}")
        writer.label(then)
        memory.store("double", number, address)
        writer.do(f"br label %{after}")
        writer.label(after)
