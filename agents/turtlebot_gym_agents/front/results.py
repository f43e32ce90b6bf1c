"""Results as objects: they print as tables and a verdict, show in a notebook with a figure, and can be written to files."""

from __future__ import annotations

import base64
import csv
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import BASE, did_you_mean
from turtlebot_gym.files import write_text
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table

WIDTH = 120
"""Width of printed tables, characters."""
DPI = 80
"""Resolution of the figure in a notebook, pixels per inch."""


class Result:
    """A result; subclasses say what its tables, its verdict, its numbers and its plot are."""

    __slots__ = ()

    def tables(self) -> tuple[Table, ...]:
        """Return what it prints as."""
        raise NotImplementedError

    def verdict(self) -> str:
        """Return it in words; empty for none."""
        return ""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its numbers, by name."""
        raise NotImplementedError

    def rows(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """Return the columns of its CSV file, by name: of one length each."""
        return dict(self.arrays)

    def content(self) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return what its JSON file holds, and the configuration that it depends on."""
        raise NotImplementedError

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw it into axes, by default new ones of pyplot's, and return them."""
        raise NotImplementedError

    def to_csv(self, path: str | Path) -> None:
        """Write its numbers as a table with a header; an existing file is replaced."""
        columns, text = self.rows(), io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*map(_cells, columns.values()), strict=True))
        write_text(Path(path), text.getvalue())

    def to_json(self, path: str | Path) -> None:
        """Write it with its configuration, and the versions of the libraries; an existing file is replaced."""
        result, config = self.content()
        write_json(Path(path), result, config=config)

    def __getitem__(self, name: str) -> Any:
        """Return an array by its name; the refusal of another one names those that there are."""
        arrays = self.arrays
        if name not in arrays:
            raise KeyError(f"there is no {name!r}: there are {', '.join(arrays)}.{did_you_mean(name, arrays)}")
        return arrays[name]

    def __str__(self) -> str:
        return "\n".join(part for part in (text_of(self.tables()), self.verdict()) if part)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the tables, the verdict and the figure."""
        from matplotlib.figure import Figure

        figure, picture = Figure(figsize=(7.0, 4.2), layout="constrained"), io.BytesIO()
        self.plot(figure.subplots())
        figure.savefig(picture, format="png", dpi=DPI)
        encoded = base64.b64encode(picture.getvalue()).decode()
        shown = f"<pre>{html.escape(text_of(self.tables()))}</pre><p>{html.escape(self.verdict())}</p>"
        return "".join((shown, f'<img alt="the figure of plot()" src="data:image/png;base64,{encoded}">'))


def axes_or_new(axes: Axes | None) -> Axes:
    """Return axes, new ones of pyplot's if there are none: a notebook shows these."""
    if axes is not None:
        return axes
    from matplotlib import pyplot as plt  # slow to import

    return plt.subplots(layout="constrained")[1]


def with_legend(axes: Axes) -> Axes:
    """Add a legend to axes, and return them."""
    axes.legend(fontsize="small")
    return axes


def text_of(tables: Sequence[Table]) -> str:
    """Return tables as text."""
    from rich.console import Console

    console = Console(file=io.StringIO(), width=WIDTH, color_system=None, force_terminal=False, force_jupyter=False)
    console.print(*tables)
    return "\n".join(line.rstrip() for line in console.file.getvalue().splitlines())  # type: ignore[attr-defined]


def _cells(column: Sequence[Any] | NDArray[Any]) -> list[Any]:
    values = np.asarray(column)
    return (values.astype(int) if values.dtype == np.bool_ else values).tolist()


def name_of(value: Any) -> str:
    """Return a short name of a policy, a filter or another option, for labels and titles."""
    if isinstance(value, (str, int, float, Path)):
        return str(value)
    if isinstance(value, Mapping) and BASE in value:
        return name_of(value[BASE])
    if isinstance(value, Mapping):
        return " ".join(f"{name_of(key)} {name_of(item)}" for key, item in value.items())
    if isinstance(value, (list, tuple)) and not hasattr(value, "_fields"):
        return ",".join(map(name_of, value))
    named = getattr(value, "name", None) or getattr(value, "__name__", None)
    return named if isinstance(named, str) else type(value).__name__
