"""The view: a map per run, plots over time for all runs, and variables for the page template. Made with Bokeh.

`present.js` and `client.js` draw each moment in the browser, from the columns of `columns`: a file needs no server. A live view
is the same page, whose columns grow.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from bokeh.document import Document
from bokeh.models import ColumnDataSource, CustomJS
from jinja2 import Template

from turtlebot_gym.drive import Drive
from turtlebot_gym.plotting import ESTIMATE_WITHIN
from turtlebot_gym_view import style
from turtlebot_gym_view.columns import apart, rows_of, scans_of
from turtlebot_gym_view.maps import Map, make_map
from turtlebot_gym_view.plots import make_plots
from turtlebot_gym_view.style import Theme

SCRIPTS = ("client.js", "present.js", "camera.js", "timeline.js", "begin.js")
"""What runs in the browser, in this order."""
MOST_RUNS = 6
"""Most runs side by side."""


class _Run(NamedTuple):
    rows: ColumnDataSource
    scans: ColumnDataSource
    start: float
    """Time that is shown as 0, s."""

    def add(self, piece: Drive) -> None:
        if len(piece):
            before = len(self.scans.data["x"])
            self.scans.stream(scans_of(piece.scans))
            self.rows.stream(rows_of(piece, scans_before=before, start=self.start))


class View(NamedTuple):
    """A view in a document."""

    runs: list[_Run]
    again: ColumnDataSource
    """Model whose change reloads the page."""

    def reload(self) -> None:
        """Let the browser reload the page."""
        self.again.data = {"times": [len(self.again.data["times"]) + 1.0]}


def fill(document: Document, drives: Sequence[Drive], *, title: str, live: bool = False) -> View:
    """Put the view of some drives into a document.

    Args:
        document: An empty document.
        drives: The drives, of the same world where there are several.
        title: Title of the page.
        live: Whether the drives grow: the view then follows their end.

    Raises:
        ValueError: If there is no drive, one is empty, or there are more than `MOST_RUNS`.
    """
    if not 0 < len(drives) <= MOST_RUNS or not all(map(len, drives)):
        raise ValueError(f"drives must hold 1 to {MOST_RUNS} drives with rows, got {list(map(len, drives))}.")
    theme = Theme()
    runs = []
    for drive in drives:
        start = float(drive.time[0])
        runs.append(_Run(ColumnDataSource(rows_of(drive, start=start)), ColumnDataSource(scans_of(drive.scans)), start))
    if len(drives) == 2 and not live:
        for at, run in enumerate(runs):
            run.rows.data["apart"] = apart(drives[at], drives[1 - at])
    maps: list[Map] = []
    for at, drive in enumerate(drives):  # they are panned and zoomed together
        maps.append(make_map(drive, drives, theme, name=f"map{at}", beside=maps[0].figure if maps else None))
    plots = make_plots(drives, [run.rows for run in runs], theme, live=live)
    for root in (*(shown.figure for shown in maps), *plots.figures):
        document.add_root(root)
    client: dict[str, Any] = {
        "runs": [
            {"rows": run.rows, "scans": run.scans, "label": drive.around.label, "ended": _ended(drive), **shown.models()}
            for drive, run, shown in zip(drives, runs, maps, strict=True)
        ],
        "plots": plots.models(),
        "inks": style.PRESENT,
        "time_range": plots.range,
        "theme": theme.entries,
        "live": live,
    }
    again = ColumnDataSource({"times": [0.0]})
    again.js_on_change("data", CustomJS(code="window.location.reload()"))
    for run in runs:
        run.rows.tags = [run.scans, again]  # no drawn model refers to them, and only referenced models are synchronized
    document.js_on_event("document_ready", CustomJS(args=client, code="".join(map(_text, SCRIPTS))))
    document.title = title
    document.template = _template()
    document.template_variables.update(_variables(drives, maps, [str(figure.name) for figure in plots.figures], title, live))
    return View(runs, again)


def _variables(drives: Sequence[Drive], maps: Sequence[Map], plots: Sequence[str], title: str, live: bool) -> dict[str, Any]:
    """Return the variables of the page's template."""
    several = len(drives) > 1
    scans, has_truth = any(drive.scans for drive in drives), any(np.isfinite(drive.true_state).any() for drive in drives)
    symbols = [
        ("truth", "truth", style.TRUTH, "line", has_truth),
        ("estimate", ESTIMATE_WITHIN, style.ESTIMATE, "ring", True),
        ("odometry", "odometry", style.ODOMETRY, "dot", True),
        ("waypoint", "waypoint", style.GOAL, "ring", True),
        ("scan", "scan", style.SCAN, "dots", scans or live),
        ("hypotheses", "hypotheses", style.ESTIMATE, "dots", any(len(row) for drive in drives for row in drive.hypotheses)),
        ("map", "localizer's map", style.CHART, "line", any(drive.around.chart for drive in drives)),
        ("other", "the other robot", style.TEXT, "ring", len(drives) == 2),
        ("command", "command", style.COMMAND, "line", not several),
    ]
    return {
        "style_sheet": _text("page.css"),
        "heading": title,
        "live": live,
        "legend": [symbol[:-1] for symbol in symbols if symbol[-1]],
        "runs": [
            {
                "map": shown.figure.name,
                "label": drive.around.label,
                "outcome": drive.outcome,
                "aspect": shown.aspect,
                "ink": style.run_style(at)[0] if several else None,
                "dash": _svg_dash(style.run_style(at)[1]),
            }
            for at, (drive, shown) in enumerate(zip(drives, maps, strict=True))
        ],
        "plots": plots,
        "several": several,
    }


def _ended(drive: Drive) -> str:
    """Return the event with which a drive ended; nothing if it simply ended."""
    return {"success": "arrival", "collision": "contact"}.get(drive.outcome.partition(" ")[0], "")


def _svg_dash(dashes: str | list[int]) -> str:
    named = {"solid": "none", "dashed": "6 4", "dotted": "2 3", "dashdot": "6 3 2 3"}
    return named[dashes] if isinstance(dashes, str) else " ".join(map(str, dashes))


@cache
def _text(name: str) -> str:
    return files("turtlebot_gym_view").joinpath(name).read_text(encoding="utf-8")


@cache
def _template() -> Template:
    """Return the page, an extension of Bokeh's own."""
    from bokeh.core.templates import get_env

    return get_env().from_string(_text("page.html"))
