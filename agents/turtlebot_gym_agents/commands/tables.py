"""Tables that fit a terminal: a wide one becomes several, and no number is ever cut."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from rich.cells import cell_len
from rich.table import Column, Table
from rich.text import Text

LONG = 24
"""Longest word that a column makes room for; a longer one, such as a path, is broken."""
SHORTER = (16, 12, 8, 4)
"""The same for key columns that leave too little room for the others."""
BORDER, BETWEEN = 1, 3
"""Characters of a table's left border, and around each column, in Rich's default box."""
_NUMBERS = re.compile(r"(?:[-+±?*%.,():\d\s]|e(?=[-+\d])|\b(?:to|of|times)\b|\b[xkM]\b|inf|nan)*")


class _Need(NamedTuple):
    least: int
    """Width in which its numbers fit on one line, and words are not broken."""
    whole: int
    """Width in which nothing is wrapped."""


def fitted(table: Table, width: int, *, keys: int | None = None) -> list[Table]:
    """Return a table as it is if it fits, otherwise with wrapped headings and texts, and if need be in several parts.

    Each part repeats the key columns. Cells of numbers, intervals among them, stay on one line; headings and texts are wrapped
    between words.

    Args:
        table: A table with the default box.
        width: Width of the terminal, characters.
        keys: Number of columns that identify a row; by default the first one, and the texts that follow it.
    """
    needs = [_need(column) for column in table.columns]
    if not needs or _total([need.whole for need in needs]) <= width:
        return [table]
    if keys is None:
        cells = [[Text.from_markup(str(cell)).plain for cell in column.cells] for column in table.columns[1:]]
        keys = 1 + next((at for at, texts in enumerate(cells) if all(map(_is_number, texts))), 0)
    needs[:keys] = _key_needs(table.columns[:keys], width - max((need.least + BETWEEN for need in needs[keys:]), default=0))
    groups = _groups([need.least for need in needs], keys, width)
    parts = []
    for number, group in enumerate(groups):
        shown = [*range(keys), *group]
        widths = _widths([needs[at] for at in shown], width)
        title, caption = table.title if number == 0 else None, table.caption if number == len(groups) - 1 else None
        parts.append(_part(table, shown, widths, Table(title=title, caption=caption)))
    return parts


def _need(column: Column, *, long: int = LONG) -> _Need:
    header, *cells = (Text.from_markup(str(text)).plain for text in (column.header, *column.cells))
    words = (word for text in (header, *cells) if text is header or not _is_number(text) for word in text.split())
    numbers = (cell_len(cell) for cell in cells if _is_number(cell))
    least = max([1, *(min(cell_len(word), long) for word in words), *numbers])
    return _Need(least, max([least, *(cell_len(line) for text in (header, *cells) for line in text.splitlines())]))


def _key_needs(columns: Sequence[Column], width: int) -> list[_Need]:
    """Return the widths of key columns: unwrapped if they take less than half the width."""
    needs = [_need(column) for column in columns]
    unwrapped = [need._replace(least=min(need.whole, LONG)) for need in needs]
    if _total([need.least for need in unwrapped]) <= width / 2:
        return unwrapped
    for long in SHORTER:
        if _total([need.least for need in needs]) <= width:
            break
        needs = [_need(column, long=long) for column in columns]
    return needs


def _is_number(text: str) -> bool:
    return _NUMBERS.fullmatch(text) is not None


def _total(widths: Sequence[int]) -> int:
    return BORDER + sum(widths) + BETWEEN * len(widths)


def _groups(least: Sequence[int], keys: int, width: int) -> list[list[int]]:
    """Return the columns of each part: as few parts as possible, of even widths."""
    best = _filled(least, keys, width)
    # The least width that needs no more parts makes them even.
    for narrower in range(width - 1, 0, -1):
        groups = _filled(least, keys, narrower)
        if len(groups) > len(best):
            break
        best = groups
    return best


def _filled(least: Sequence[int], keys: int, width: int) -> list[list[int]]:
    """Return parts that are filled one after another, each with at least one column besides the keys."""
    groups: list[list[int]] = [[]]
    for at in range(keys, len(least)):
        if groups[-1] and _total([*least[:keys], *(least[column] for column in (*groups[-1], at))]) > width:
            groups.append([])
        groups[-1].append(at)
    return groups


def _widths(needs: Sequence[_Need], width: int) -> list[int]:
    """Return the widths of a part's columns: spare width goes to those that wrap most."""
    widths = [need.least for need in needs]
    for _ in range(width - _total(widths)):
        at = max(range(len(needs)), key=lambda column: needs[column].whole - widths[column])
        if widths[at] >= needs[at].whole:
            break
        widths[at] += 1
    return widths


def _part(table: Table, shown: Sequence[int], widths: Sequence[int], part: Table) -> Table:
    for at, width in zip(shown, widths, strict=True):
        column = table.columns[at]
        part.add_column(column.header, width=width, overflow="fold", justify=column.justify)
    for row, *cells in zip(table.rows, *(table.columns[at].cells for at in shown), strict=True):
        part.add_row(*cells, end_section=row.end_section)
    return part
