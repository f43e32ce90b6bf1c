"""The view: maps of the drives, plots over time, and variables for the page template. Made with Bokeh.

Bokeh zooms, pans, selects intervals and shows values under the pointer. `moment.js` draws a moment in the browser, from
the tables of `columns`: a file needs no server.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from bokeh.core.templates import get_env
from bokeh.document import Document
from bokeh.events import DoubleTap
from bokeh.models import ColumnDataSource, CustomJS

from turtlebot_gym.drive import Drive
from turtlebot_gym.plotting import ESTIMATE_WITHIN
from turtlebot_gym_view import style
from turtlebot_gym_view.columns import kept_of, require_number, tables_of
from turtlebot_gym_view.maps import Map, make_map, place_of
from turtlebot_gym_view.moving import ShownMoment, draw_drive, make_moment
from turtlebot_gym_view.plots import Plots, make_plots
from turtlebot_gym_view.style import Theme

SCRIPTS = ("moment.js", "player.js")
"""What runs in the browser, in this order."""
WORDS = (
    ("estimate off by", "error", 3, " m"),
    ("odometry off by", "odometry_error", 3, " m"),
    ("speed", "command_v", 2, " m/s"),
    ("turning", "command_omega", 2, " rad/s"),
    ("NIS", "nis", 1, ""),
    ("clearance", "clearance", 2, " m"),
)
"""Numbers below a map: name, column, digits and unit."""
DETAILS = ("estimate", "odometry", "scan", "tracks", "hypotheses")
"""Layers of a drive that are shown only if it is looked at alone."""


class _Run(NamedTuple):
    sources: dict[str, ColumnDataSource]
    """Its tables by name."""
    moment: ShownMoment


def fill(document: Document, drives: Sequence[Drive], *, title: str) -> None:
    """Put the view of some drives into an empty document; those in the same room are drawn over each other.

    Raises:
        ValueError: If there is no drive, one is empty, or there are too many.
    """
    require_number(len(drives))
    if not all(map(len, drives)):
        raise ValueError(f"drives must have rows, got {list(map(len, drives))} rows.")
    theme = Theme()
    tables = [tables_of(drive) for drive in drives]
    runs = [_Run({name: ColumnDataSource(table) for name, table in each.items()}, make_moment(each)) for each in tables]
    rows = [run.sources["rows"] for run in runs]
    rooms: dict[Any, list[int]] = {}
    for at, drive in enumerate(drives):
        rooms.setdefault(place_of(drive), []).append(at)
    groups = [*rooms.values()]
    maps, drawn = _make_maps(drives, runs, groups, theme)
    plots = make_plots(drives, rows, theme)
    with document.models.freeze():  # else Bokeh walks over all models for each root
        for root in (*(shown.figure for shown in maps), *plots.figures):
            document.add_root(root)
    client: dict[str, Any] = {
        "runs": [
            {
                **run.sources,
                "moment": run.moment._asdict(),
                "still": drive.around.room.circles if drive.around.room else [],
                "map": next(at for at, group in enumerate(groups) if number in group),
            }
            for number, (drive, run) in enumerate(zip(drives, runs, strict=True))
        ],
        "maps": [
            {"figure": shown.figure, "runs": group, "chart": shown.chart} for shown, group in zip(maps, groups, strict=True)
        ],
        "layers": drawn,
        "plots": [{"figure": drawn, "curves": curves} for drawn, curves in zip(plots.figures, plots.curves, strict=True)],
        "range": plots.range,
        "cursor": plots.cursor,
        "theme": theme.entries,
        "words": WORDS,
        "details": DETAILS,
    }
    for run in runs:
        run.sources["rows"].tags = [*run.sources.values()]  # no drawn model refers to all of them
    document.js_on_event("document_ready", CustomJS(args=client, code="".join(map(_text, SCRIPTS))))
    document.title = title
    document.template = get_env().from_string(_text("page.html"))  # an extension of Bokeh's own
    document.template_variables.update(_variables(drives, maps, groups, plots, title))


def _make_maps(
    drives: Sequence[Drive], runs: Sequence[_Run], groups: Sequence[Sequence[int]], theme: Theme
) -> tuple[list[Map], list[list[Any]]]:
    """Return the maps, and run, layer and renderer of all that is drawn of the drives."""
    maps: list[Map] = []
    drawn: list[list[Any]] = []
    for number, group in enumerate(groups):
        shown = make_map([drives[at] for at in group], theme, name=f"map{number}")
        for at in group:
            ink, dash = style.RUNS[at] if len(drives) > 1 else (style.TRUTH, [])
            run = runs[at]
            layers = draw_drive(shown.figure, drives[at], run.sources["rows"], run.moment, theme, ink, dash)
            drawn += [[at, layer, renderer] for renderer, layer in layers]
        shown.figure.js_on_event(DoubleTap, CustomJS(code="window.watch.reset()"))
        maps.append(shown)
    return maps, drawn


def _variables(
    drives: Sequence[Drive], maps: Sequence[Map], groups: Sequence[Sequence[int]], plots: Plots, title: str
) -> dict[str, Any]:
    """Return the variables of the page's template."""
    several = len(drives) > 1
    scans, has_truth = any(drive.scans for drive in drives), any(np.isfinite(drive.true_state).any() for drive in drives)
    people = any(len(row) for drive in drives for row in drive.circles)
    kept = max(map(kept_of, drives))
    symbols = [
        ("truth", "truth", style.TRUTH, "line", has_truth),
        ("estimate", ESTIMATE_WITHIN, style.ESTIMATE, "ring", True),
        ("odometry", "odometry", style.ODOMETRY, "dot", True),
        ("waypoint", "waypoint", style.GOAL, "ring", True),
        ("scan", f"scan (1 of {kept})" if kept > 1 else "scan", style.SCAN, "dots", scans),
        ("people", "people", style.PERSON, "person", people),
        ("tracks", "tracks", style.ESTIMATE, "ring", any((drive.tracks[:, :, -1] == 1.0).any() for drive in drives)),
        ("hypotheses", "hypotheses", style.ESTIMATE, "dots", any(len(row) for drive in drives for row in drive.hypotheses)),
        ("map", "localizer's map", style.CHART, "line", any(drive.around.chart for drive in drives)),
        ("command", "command", style.COMMAND, "line", not several),
    ]
    runs = [
        {
            "at": at,
            "label": drive.around.label or f"drive {at + 1}",
            "outcome": drive.outcome,
            "ink": style.RUNS[at][0] if several else None,
            "dash": " ".join(map(str, style.RUNS[at][1])) or "none",
        }
        for at, drive in enumerate(drives)
    ]
    return {
        "style_sheet": _text("page.css"),
        "heading": title,
        "legend": [symbol[:-1] for symbol in symbols if symbol[-1]],
        "details": DETAILS,
        "runs": runs,
        "maps": [
            {"name": shown.figure.name, "aspect": shown.aspect, "runs": [runs[at] for at in group]}
            for shown, group in zip(maps, groups, strict=True)
        ],
        "choice": len(maps) < len(drives),
        "plots": [str(figure.name) for figure in plots.figures],
    }


@cache
def _text(name: str) -> str:
    return files("turtlebot_gym_view").joinpath(name).read_text(encoding="utf-8")
