"""Tables of results in Markdown, and of figures with their limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

from rich.table import Table


class Figure(NamedTuple):
    """A result."""

    name: str
    value: float
    unit: str
    limit: float | None = None
    """Limit that it must keep; None if it is only reported."""


def markdown(titles: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    head = "".join(f" {title} |" if title else " |" for title in titles)
    return "\n".join([f"|{head}", f"{'|---' * len(titles)}|", *(f"| {' | '.join(row)} |" for row in rows)])


def figures_table(
    figures: Iterable[Figure], kept: Literal["below", "at most", "at least"], *, title: str | None = None
) -> Table:
    """Return a table that says whether each figure keeps its limit.

    Args:
        figures: What was measured.
        kept: On which side of its limit a figure must stay.
        title: Title of the table.
    """
    table = Table("figure", "", kept, "met", title=title)
    for name, value, unit, limit in figures:
        if limit is None:
            table.add_row(name, f"{value:.3g} {unit}")
            continue
        is_met = {"below": value < limit, "at most": value <= limit, "at least": value >= limit}[kept]
        table.add_row(name, f"{value:.3g} {unit}", f"{limit:g}", "yes" if is_met else "NO")
    return table
