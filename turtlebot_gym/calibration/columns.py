"""Text tables with named columns: a header line, then numbers separated by commas, semicolons, tabs or blanks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_BINARY = "the file is binary; a text table with named columns, or a bag, is needed."


class TextTable(NamedTuple):
    """Contents of a table file, as text."""

    path: Path
    names: tuple[str, ...]
    """Column names from left to right, without duplicates."""
    rows: tuple[tuple[str, ...], ...]
    """The cells of each row."""
    lines: tuple[int, ...]
    """Line number of each row in the file, from 1."""

    def numbers(self, names: Sequence[str], *, cut: bool = False) -> NDArray[np.float64]:
        """Return some columns as numbers, shape (T, n); NaN for empty cells.

        Args:
            names: The columns.
            cut: Leave out a last line that was cut short, as by a recording that broke off, instead of refusing it.

        Raises:
            ValueError: If a row has more or fewer cells than the header, or a cell is not a number; the message names the line.
        """
        places = [self.names.index(name) for name in names]
        found = []
        for line, cells in zip(self.lines, self.rows, strict=True):
            try:
                if len(cells) != len(self.names):
                    raise ValueError(f"{len(cells)} cells instead of {len(self.names)}")
                found.append([float(cells[place] or "nan") for place in places])
            except ValueError as error:
                if cut and line == self.lines[-1] and len(cells) <= len(self.names) and found:
                    break
                raise ValueError(f"{self.path}: line {line}: {error}.") from None
        return np.array(found, np.float64).reshape(-1, len(places))


def read_text_table(path: str | Path) -> TextTable:
    """Read a table as text.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file is binary or empty, or a column name occurs twice.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: {_BINARY}") from None
    if "\0" in text:
        raise ValueError(f"{path}: {_BINARY}")
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not numbered:
        raise ValueError(f"{path}: the file is empty.")
    header = numbered[0][1].lstrip("#").strip()
    mark = next((mark for mark in ",;\t" if mark in header), None)
    names = _cells(header, mark)
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise ValueError(f"{path}: column {', '.join(map(repr, twice))} is there more than once; rename one of them.")
    rows = tuple(_cells(line, mark) for _, line in numbered[1:])
    return TextTable(path, names, rows, tuple(number for number, _ in numbered[1:]))


def _cells(line: str, mark: str | None) -> tuple[str, ...]:
    return tuple(cell.strip().strip('"') for cell in line.split(mark))


def some_of(names: Sequence[str], most: int = 12) -> str:
    """Return names for a message: the first few, and how many more there are."""
    told = ", ".join(map(repr, names[:most]))
    return told + (f" and {len(names) - most} more" if len(names) > most else "")
