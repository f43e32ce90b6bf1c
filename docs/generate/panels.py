"""How the pages draw measured results: dots with their intervals, one line for each case."""

import io
import math
import textwrap
from typing import NamedTuple

from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from turtlebot_gym.plotting import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILLION

COLORS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY_BLUE, BLACK)
MARKERS = "osD^vPX"
WIDTH = 5.5  # in; a phone shows two thirds of it
ROW = 0.27  # in, height of a case
LONGEST = 26  # characters in a line of a case's name
TICKS = [step * 10.0**power for power in range(-2, 4) for step in (1, 2, 5)]
"""Where a logarithmic axis may have its ticks."""


class Series(NamedTuple):
    """Values of the cases of a figure that belong together."""

    name: str
    """In the legend; empty for none."""
    values: list
    """One for each case: a number, an interval of value, low and high, or None."""


class Panel(NamedTuple):
    """What one axis shows of all cases."""

    label: str
    """With the unit."""
    series: list[Series]
    factor: float = 1.0
    """From the file's unit to the label's."""
    line: float | None = None
    """Where a line marks an aim or no difference."""
    scale: str = "linear"


def dots(cases, *panels):
    """Return a figure with a line for each case and the panels beside each other."""
    several = max(len(panel.series) for panel in panels)
    names = [textwrap.fill(case, LONGEST) for case in cases]
    row = ROW * (0.5 + 0.5 * max(name.count("\n") + 1 for name in names))
    height = len(cases) * max(row, 0.11 * several) + (1.0 if several > 1 else 0.6)
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, panel in zip(axes, panels, strict=True):
        for at, series in enumerate(panel.series):
            offset = 0.62 * ((at + 0.5) / len(panel.series) - 0.5)
            rows = [(k + offset, *bounds(value)) for k, value in enumerate(series.values) if value is not None]
            heights, middle, low, high = (list(column) for column in zip(*rows, strict=True))
            color = COLORS[at]
            scaled = [panel.factor * value for value in middle]
            ax.hlines(heights, [panel.factor * x for x in low], [panel.factor * x for x in high], color=color, linewidth=1.6)
            ax.plot(scaled, heights, MARKERS[at], color=color, markersize=4.5, label=series.name)
        if panel.line is not None:
            ax.axvline(panel.line, color="0.4", linestyle="--", linewidth=1.0)
        ax.set(xlabel=panel.label, xscale=panel.scale)
        if panel.scale == "log":
            low, high = ax.get_xlim()
            inside = [tick for tick in TICKS if low <= tick <= high]
            ax.xaxis.set_major_locator(FixedLocator(inside if len(inside) < 5 else inside[:: len(inside) // 3]))
            ax.xaxis.set_minor_locator(NullLocator())
            ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        ax.grid(axis="x", color="0.88")
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set(yticks=range(len(cases)), yticklabels=names, ylim=(len(cases) - 0.5, -0.5))
    if several > 1:
        handles = max((ax.get_legend_handles_labels() for ax in axes), key=lambda found: len(found[0]))
        figure.legend(*handles, loc="outside upper center", ncols=min(several, 4), frameon=False)
    return figure


def pick(rows, **wanted):
    """Return the row with the wanted values, or nothing."""
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    return found[0] if found else {}


def series(rows, name, cases, case, part, **wanted):
    """Return a part of the rows of each case."""
    return Series(name, [pick(rows, **{case: key}, **wanted).get(part) for key in cases])


def bounds(value):
    """Return a value and its interval; a number has none."""
    if isinstance(value, dict):
        return value["value"], value["low"], value["high"]
    return value, math.nan, math.nan


def svg(figure):
    """Return the bytes of a figure, the same at each build."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="svg", bbox_inches="tight", facecolor="white", metadata={"Date": None})
    return drawn.getvalue()
