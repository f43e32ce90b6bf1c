"""A graph as C++ for one environment, as NVIDIA Warp compiles it for a GPU and for this processor.

Each operation of the graph is one of C++ on doubles, 64-bit integers and truths, whose bits both compilers keep if they fuse no
products with sums.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

from turtlebot_gym.compiled.graph import Node, Untraceable, kind_of, live
from turtlebot_gym.compiled.regions import BLOCKS, ROOT, Region, block_of, homes_of
from turtlebot_gym.compiled.values import signed

_TYPES = {"f": "double", "i": "long long", "b": "bool"}
_SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/", "and": "&", "or": "|", "xor": "^", "shr": ">>"}
_SIGNS |= {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_NAMES = {"sqrt": "sqrt", "floor": "floor", "abs": "fabs", "mod": "modulo", "mantissa": "mantissa", "exponent": "exponent"}
HELPERS = """
union Bits { double number; long long whole; };
auto of_bits = [](long long whole) { Bits bits; bits.whole = whole; return bits.number; };
auto mantissa = [](double x) {
    Bits bits; bits.number = x;
    bits.whole = (bits.whole & 0x000FFFFFFFFFFFFFLL) | 0x3FE0000000000000LL;
    return bits.number;
};
auto exponent = [](double x) { Bits bits; bits.number = x; return (double)(bits.whole >> 52) - 1022.0; };
struct Modulo {
    double operator()(double a, double b) const { double rest = fmod(a, b); return rest < 0.0 ? rest + b : rest; }
    long long operator()(long long a, long long b) const { long long rest = a % b; return rest < 0 ? rest + b : rest; }
} modulo;
"""
"""What the text of a graph calls."""


def constant(value: float, kind: str) -> str:
    """Return a constant."""
    if kind == "b":
        return str(bool(value)).lower()
    if kind == "f" and math.isfinite(value):
        return f"({value!r})"
    bits = struct.unpack("<q", struct.pack("<d", value))[0] if kind == "f" else signed(int(value))
    text = "(-0x7FFFFFFFFFFFFFFFLL - 1)" if bits == -(2**63) else f"({bits}LL)"
    return f"of_bits({text})" if kind == "f" else text


def value_of(value: Any) -> str:
    """Return the name of a node, or a constant."""
    return f"n{value.id}" if isinstance(value, Node) else constant(value, kind_of(value))


def text_of(values: Sequence[Any], load: Callable[[Node], str]) -> list[str]:
    """Return lines that define all nodes of some values, by the names of `value_of`; `HELPERS` stand before them.

    Args:
        values: Nodes and constants.
        load: ``load(node)`` returns the expression of a node of memory, "load" or "gather".

    Raises:
        Untraceable: If a kernel calls a function of the C library, whose last bits differ from one processor to another.
    """
    nodes = live(values)
    homes, blocks = homes_of(nodes, values), dict[Region, list[Node]]()
    for node in nodes:
        blocks.setdefault(homes[node.id], []).append(node)
    lines: list[str] = []

    def write(region: Region) -> None:
        inside = blocks[region]
        written = set[int]()
        for node in sorted(inside, key=lambda node: node.op != "load"):  # merges may want loads that were made later
            if node.id in written or (node.op == "load" and node.args[0].startswith("attempt.")):
                continue
            child = block_of(node, BLOCKS.get(node.op, (0,))[0], region)
            if child is None or child not in blocks:
                text = load(node) if node.op in ("load", "gather") else _operation(node)
                lines.append(f"const {_TYPES[node.kind]} n{node.id} = {text};")
                continue
            merges = [other for other in inside if other.op == node.op and other.args[3] == node.args[3]]
            written |= {each.id for each in merges}
            (write_if if node.op == "if" else write_search)(child, merges)

    def write_if(child: Region, merges: list[Node]) -> None:
        lines.extend(f"{_TYPES[each.kind]} n{each.id} = {value_of(each.args[2])};" for each in merges)
        lines.append(f"if ({value_of(merges[0].args[0])}) {{")
        write(child)
        lines.extend(f"n{each.id} = {value_of(each.args[1])};" for each in merges)
        lines.append("}")

    def write_search(child: Region, merges: list[Node]) -> None:
        _, accepted, most, _, attempt = map(value_of, merges[0].args)
        lines.extend(f"double n{each.id} = 0.0;" for each in merges)
        lines.append(f"for (long long {attempt} = 0; {attempt} < {most}; ++{attempt}) {{")
        write(child)
        lines.extend(f"n{each.id} = {value_of(each.args[0])};" for each in merges)
        lines.extend([f"if ({accepted}) break;", "}"])

    if nodes:
        write(ROOT)
    return lines


def _operation(node: Node) -> str:
    op, args = node.op, [value_of(value) for value in node.args if not isinstance(value, str)]
    kind = kind_of(node.args[0]) if not isinstance(node.args[0], str) else "f"
    if op in ("sel", "if"):
        return f"{args[0]} ? {args[1]} : {args[2]}"
    if op in ("add", "sub", "mul") and kind == "i":  # modulo 2^64
        return f"(long long)((unsigned long long){args[0]} {_SIGNS[op]} (unsigned long long){args[1]})"
    if op in _SIGNS:
        return f"{args[0]} {_SIGNS[op]} {args[1]}"
    if op in _NAMES:
        return f"{_NAMES[op]}({', '.join(args)})"
    if op == "neg":
        return f"-{args[0]}" if kind == "f" else f"(long long)(0ULL - (unsigned long long){args[0]})"
    if op == "not":
        return f"!{args[0]}"
    if op in ("tofloat", "toint"):
        return f"({_TYPES[node.kind]}){args[0]}"
    raise Untraceable(f"a kernel calls math.{node.args[0]}, whose last bits differ from one processor to another")
