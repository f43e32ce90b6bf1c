"""Plots over time: commands, errors, NIS against its 95 % line, clearance, and the guard's state.

They share a range of times: a drag in a plot or the wheel selects an interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from bokeh.events import DoubleTap, Tap
from bokeh.models import (
    BasicTicker,
    BoxZoomTool,
    ColumnDataSource,
    CustomJS,
    DataRange1d,
    FixedTicker,
    GlyphRenderer,
    HoverTool,
    Range1d,
    Span,
    WheelZoomTool,
)
from bokeh.plotting import figure as Figure
from scipy.stats import chi2

from turtlebot_gym.drive import Drive
from turtlebot_gym_view import style
from turtlebot_gym_view.style import Theme, ThemeColour

OK, WARNING, ERROR = 0.0, 1.0, 2.0
"""Levels of a report, as in ``diagnostic_msgs/DiagnosticStatus``."""
HEIGHT = 112
"""Height of a plot, pixels."""
MARGIN = 58
"""Space to the left of each frame, pixels, equal for all, so that times are aligned."""
SHORTEST = 0.5
"""Shortest interval that can be selected, s."""
CONFIDENCE = 0.95
"""Share of the NIS below its line for a consistent filter."""


class Plots(NamedTuple):
    """The plots, from top to bottom."""

    figures: list[Figure]
    curves: list[list[dict[str, Any]]]
    """Curves of each figure: the renderer, its run and column, and the layer of the column."""
    range: Range1d
    """Selected interval of times, shared by all, s."""
    cursor: Span
    """The moment that is shown."""


class _Curve(NamedTuple):
    """A column drawn over time; of several runs, only the last curve of a plot is drawn."""

    column: str
    layer: str
    ink: ThemeColour
    dash: str | list[int] = "solid"
    steps: bool = False
    width: float = 1.4


def make_plots(drives: Sequence[Drive], rows: Sequence[ColumnDataSource], theme: Theme) -> Plots:
    """Return the plots; the browser leaves out those without any data."""
    end = max(1.0, *(float(drive.time[-1] - drive.time[0]) for drive in drives))
    times = Range1d(start=0.0, end=end, bounds=(0.0, end), min_interval=min(SHORTEST, end))
    cursor = Span(location=0.0, dimension="height", line_width=1.5, level="overlay")
    theme.paint(cursor, style.TEXT, "line_color")
    plots = Plots([], [], times, cursor)
    several = len(drives) > 1

    def plot(title: str, curves: Sequence[_Curve], *, floor: float | None = None) -> Figure:
        figure = _figure(title, plots, theme, floor)
        for at, source in enumerate(rows):
            ink, dash = style.RUNS[at]
            shown = curves[-1:] if several else curves
            for curve in shown:
                drawn = _draw(figure, source, curve._replace(ink=ink, dash=dash) if several else curve, theme)
                layer = "" if several else curve.layer
                plots.curves[-1].append({"drawn": drawn, "layer": layer, "run": at, "column": curve.column})
            label = (drives[at].around.label or "drive") if several else "time"
            named = [(label, "@time{0.0} s"), *((curve.layer, f"@{curve.column}{{0.000}}") for curve in shown)]
            read = figure.line("time", shown[-1].column, source=source, line_alpha=0.0)  # Bokeh cannot hit steps
            mode = "mouse" if several else "vline"  # the values of six drives at one time would hide each other
            figure.add_tools(HoverTool(renderers=[read], tooltips=named, mode=mode))
        return figure

    command = _Curve("command_v", "command", style.COMMAND, steps=True, width=1.2)
    truth = _Curve("v", "truth", style.TRUTH, width=2.4)
    plot("speed (m/s)", [truth, command])
    plot("turning rate (rad/s)", [truth._replace(column="omega"), command._replace(column="command_omega")])
    believed = _Curve("error", "estimate", style.ESTIMATE, width=1.8)
    measured = _Curve("odometry_error", "odometry", style.ODOMETRY, width=1.0)
    plot("position error (m)", [measured, believed], floor=0.0)
    plot("heading error (rad)", [measured._replace(column="odometry_turn"), believed._replace(column="turn")], floor=0.0)
    limit = float(chi2.ppf(CONFIDENCE, drives[0].around.nis_degrees))
    title = f"NIS, and the {limit:.2f} that 95 % stay below"
    _line(plot(title, [_Curve("nis", "estimate", style.ESTIMATE)], floor=0.0), limit, theme)
    clearance = plot("clearance (m); contact below 0", [_Curve("clearance", "truth", style.TRUTH)])
    _line(clearance, 0.0, theme)
    clearance.scatter([0.0], [0.0], alpha=0.0)  # contact is always in the picture
    guard = plot("state of the guard", [_Curve("level", "guard", style.LEVELS[1], steps=True, width=2.4)])
    guard.y_range = Range1d(start=OK - 0.4, end=ERROR + 0.4)
    guard.yaxis.ticker = FixedTicker(ticks=[OK, WARNING, ERROR])
    guard.yaxis.major_label_overrides = {OK: "ok", WARNING: "warning", ERROR: "error"}
    return plots


def _figure(title: str, plots: Plots, theme: Theme, floor: float | None) -> Figure:
    """Return an empty plot."""
    values = DataRange1d(range_padding=0.12, only_visible=True)
    if floor is not None:
        values.start = floor
    figure = Figure(
        name=f"plot{len(plots.figures)}",
        title=title,
        height=HEIGHT,
        sizing_mode="stretch_both",
        x_range=plots.range,
        y_range=values,
        tools=[BoxZoomTool(dimensions="width"), (wheel := WheelZoomTool(dimensions="width", zoom_on_axis=False))],
        toolbar_location=None,
        min_border_left=MARGIN,
        min_border_right=8,
        min_border_top=2,
        min_border_bottom=2,
        output_backend="canvas",
    )
    theme.dress(figure)
    figure.yaxis.ticker = BasicTicker(desired_num_ticks=3)
    figure.xgrid.visible = False
    figure.toolbar.active_scroll = wheel
    figure.add_layout(plots.cursor)
    figure.js_on_event(Tap, CustomJS(code="window.watch.seek(cb_obj.x)"))
    figure.js_on_event(DoubleTap, CustomJS(code="window.watch.whole()"))
    plots.figures.append(figure)
    plots.curves.append([])
    return figure


def _draw(figure: Figure, source: ColumnDataSource, curve: _Curve, theme: Theme) -> GlyphRenderer[Any]:
    options: dict[str, Any] = {"muted_alpha": style.PALE, "line_width": curve.width, "line_dash": curve.dash, "source": source}
    if curve.steps:
        drawn = figure.step("time", curve.column, mode="after", **options)
    else:
        drawn = figure.line("time", curve.column, **options)
    for glyph in (drawn.glyph, drawn.muted_glyph):
        theme.paint(glyph, curve.ink, "line_color")
    return drawn


def _line(figure: Figure, value: float, theme: Theme) -> None:
    limit = Span(location=value, dimension="width", line_width=1.2, line_dash=[5, 3])
    theme.paint(limit, style.LIMIT, "line_color")
    figure.add_layout(limit)
