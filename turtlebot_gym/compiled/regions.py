"""Blocks of a graph: what only an ``if`` statement or a search wants stands in a block of its own, which runs only for it."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from typing import Any, NamedTuple

from turtlebot_gym.compiled.graph import Node

FEWEST = 12
"""Fewest operations of an ``if`` that have a block of their own; fewer are faster than the branch."""


class Region(NamedTuple):
    """What runs only where an ``if`` wants it."""

    parent: Any
    tag: int
    depth: int


ROOT = Region(None, 0, 0)
"""What always runs."""
BLOCKS = {"if": (1,), "search": (0, 1, 4)}
"""Operations with a block of their own, and which of their arguments belong there."""


def block_of(node: Node, at: int, home: Region, flat: Container[int] = ()) -> Region | None:
    """Return the block of an argument of a node that stands in a block; None if it has none of its own."""
    is_inside = at in BLOCKS.get(node.op, ()) and node.args[3] not in flat
    return Region(home, node.args[3], home.depth + 1) if is_inside else None


def homes_of(nodes: list[Node], values: Iterable[Any]) -> dict[int, Region]:
    """Return for each node the innermost block that all who want it are in; small blocks belong to what is around them."""
    flat, loops = set[int](), {node.args[3] for node in nodes if node.op == "search"}
    while True:
        homes: dict[int, Region] = {value.id: ROOT for value in values if isinstance(value, Node)}
        sizes: dict[int, int] = {}
        for node in reversed(nodes):
            home = homes[node.id]
            for at, value in enumerate(node.args):
                if isinstance(value, Node):
                    place = block_of(node, at, home, flat) or home
                    homes[value.id] = around(homes[value.id], place) if value.id in homes else place
            if home is not ROOT and node.op not in ("load", "gather"):
                for region in blocks_around(home):
                    sizes[region.tag] = sizes.get(region.tag, 0) + 1
        small = {tag for tag, size in sizes.items() if size < FEWEST} - loops
        if not small:
            return homes
        flat |= small


def blocks_around(region: Region) -> Iterator[Region]:
    """Yield a block and those around it, but not the outermost one."""
    while region is not ROOT and region.parent is not None:
        yield region
        region = region.parent


def around(one: Region, other: Region) -> Region:
    """Return the innermost block around two."""
    while one != other:
        if one.depth >= other.depth:
            one = one.parent
        else:
            other = other.parent
    return one
