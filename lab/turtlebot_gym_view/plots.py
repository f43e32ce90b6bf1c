"""Plots over time: commands, errors, NIS against its 95 % line, clearance, and the guard's state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import BasicTicker, ColumnDataSource, DataRange1d, FixedTicker, GlyphRenderer, Range1d, Span
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
CONFIDENCE = 0.95
"""Share of the NIS below its line for a consistent filter."""


class _Plots(NamedTuple):
    figures: list[Figure]
    curves: list[list[dict[str, Any]]]
    """Curves of each figure: the renderer, its run and column, and the layer and the label of the column."""
    range: Range1d
    """Times, shared by all, s."""

    def models(self) -> list[dict[str, Any]]:
        """Return what the client needs of each plot."""
        return [{"figure": figure, "curves": curves} for figure, curves in zip(self.figures, self.curves, strict=True)]


class _Curve(NamedTuple):
    """A column drawn over time; of several runs, only the last curve of a plot is drawn."""

    column: str
    layer: str
    ink: ThemeColour
    dash: str | list[int] = "solid"
    steps: bool = False
    width: float = 1.4


def make_plots(drives: Sequence[Drive], rows: Sequence[ColumnDataSource], theme: Theme, *, live: bool) -> _Plots:
    """Return the plots; those without any data are left out, unless drives still grow."""
    end = max(float(drive.time[-1] - drive.time[0]) for drive in drives)
    plots = _Plots([], [], Range1d(start=0.0, end=max(end, 1.0)))
    several = len(drives) > 1

    def plot(
        title: str, curves: Sequence[_Curve], *, floor: float | None = None, has_data: bool = True, of_both: bool = False
    ) -> Figure | None:
        if not (has_data or live):
            return None
        figure = _figure(title, plots, theme, floor)
        for at, source in enumerate(rows[:1] if of_both else rows):
            ink, dash = style.run_style(at)
            by_run = several and not of_both
            for curve in curves[-1:] if several else curves:
                drawn = _draw(figure, source, curve._replace(ink=ink, dash=dash) if by_run else curve, theme)
                label = drives[at].around.label if by_run else curve.layer
                beside = {"layer": "" if several else curve.layer, "label": label, "run": at, "column": curve.column}
                plots.curves[-1].append({"drawn": drawn, **beside})
        return figure

    command = _Curve("command_v", "command", style.COMMAND, steps=True, width=1.2)
    truth = _Curve("v", "truth", style.TRUTH, width=2.4)
    plot("speed (m/s)", [truth, command])
    plot("turning rate (rad/s)", [truth._replace(column="omega"), command._replace(column="command_omega")])
    believed = _Curve("error", "estimate", style.ESTIMATE, width=1.8)
    measured = _Curve("odometry_error", "odometry", style.ODOMETRY, width=1.0)
    has_truth = any(np.isfinite(drive.true_state[:, :2]).any() for drive in drives)
    plot("position error (m)", [measured, believed], floor=0.0, has_data=has_truth)
    turns = [measured._replace(column="odometry_turn"), believed._replace(column="turn")]
    plot("heading error (rad)", turns, floor=0.0, has_data=has_truth)
    if "apart" in rows[0].column_names:
        plot("between the two robots (m)", [_Curve("apart", "distance", style.TEXT)], floor=0.0, of_both=True)
    degrees = drives[0].around.nis_degrees
    limit = float(chi2.ppf(CONFIDENCE, degrees))
    title = f"NIS, and the {limit:.2f} that 95 % stay below"
    nis = plot(
        title,
        [_Curve("nis", "estimate", style.ESTIMATE)],
        floor=0.0,
        has_data=any(np.isfinite(drive.nis).any() for drive in drives),
    )
    if nis:
        _line(nis, limit, theme)
    clear = any(np.isfinite(drive.clearance).any() for drive in drives)
    clearance = plot("clearance (m); contact below 0", [_Curve("clearance", "truth", style.TRUTH)], has_data=clear)
    if clearance:
        _line(clearance, 0.0, theme)
        clearance.scatter([0.0], [0.0], alpha=0.0)  # contact is always in the picture
    reported = any(np.isfinite(drive.level).any() for drive in drives)
    guard = plot("state of the guard", [_Curve("level", "guard", style.LEVELS[1], steps=True, width=2.4)], has_data=reported)
    if guard:
        guard.y_range = Range1d(start=OK - 0.4, end=ERROR + 0.4)
        guard.yaxis.ticker = FixedTicker(ticks=[OK, WARNING, ERROR])
        guard.yaxis.major_label_overrides = {OK: "ok", WARNING: "warning", ERROR: "error"}
    return plots


def _figure(title: str, plots: _Plots, theme: Theme, floor: float | None) -> Figure:
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
        tools="",
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
    plots.figures.append(figure)
    plots.curves.append([])
    return figure


def _draw(figure: Figure, source: ColumnDataSource, curve: _Curve, theme: Theme) -> GlyphRenderer[Any]:
    options: dict[str, Any] = {"line_width": curve.width, "line_dash": curve.dash, "source": source}
    if curve.steps:
        drawn = figure.step("time", curve.column, mode="after", **options)
    else:
        drawn = figure.line("time", curve.column, **options)
    theme.paint(drawn.glyph, curve.ink, "line_color")
    drawn.nonselection_glyph = drawn.muted_glyph = None
    return drawn


def _line(figure: Figure, value: float, theme: Theme) -> None:
    limit = Span(location=value, dimension="width", line_width=1.2, line_dash=[5, 3])
    theme.paint(limit, style.LIMIT, "line_color")
    figure.add_layout(limit)
