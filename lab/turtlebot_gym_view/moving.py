"""What moves on a map: a drive's robot, its paths so far, what it believes and sees, and the people around it.

Each glyph draws one of a few small tables, `ShownMoment`, which `moment.js` fills from the drive's tables (`columns`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.plotting import figure as Figure

from turtlebot_gym.drive import Drive
from turtlebot_gym_view import style
from turtlebot_gym_view.columns import Table
from turtlebot_gym_view.style import Theme, ThemeColour

PATH = ("time", "x", "y", "ex", "ey", "ox", "oy")
_AREAS = ("circle", "ellipse")


class ShownMoment(NamedTuple):
    """What is drawn of a drive at a time."""

    now: ColumnDataSource
    """The row."""
    trail: ColumnDataSource
    """Positions up to it."""
    points: ColumnDataSource
    """Ends of the beams of the newest scan."""
    people: ColumnDataSource
    """Circles: radius of a pillar, or of a person."""
    tracks: ColumnDataSource
    """The observed tracks."""
    places: ColumnDataSource
    """The localizer's hypotheses."""


def make_moment(tables: dict[str, Table]) -> ShownMoment:
    """Return an empty moment of a drive with some tables."""

    def empty(names: Sequence[str]) -> ColumnDataSource:
        return ColumnDataSource({name: np.empty(0, np.float32) for name in names})

    people = ("x", "y", "pillar", "person")
    now, tracks, places = (empty([*tables[name]]) for name in ("rows", "tracks", "places"))
    return ShownMoment(now, empty(PATH), empty(("x", "y")), empty(people), tracks, places)


def draw_drive(
    figure: Figure, drive: Drive, rows: ColumnDataSource, moment: ShownMoment, theme: Theme, ink: ThemeColour, dash: list[int]
) -> list[tuple[Any, str]]:
    """Draw a drive on a map, its true path with an ink and dashes, and return each renderer with the name of its layer."""
    drawn: list[tuple[Any, str]] = []
    robot, goal = drive.around.robot_radius, drive.around.goal_radius

    def add(layer: str, kind: str, source: ColumnDataSource, ink: ThemeColour, *, filled: bool = False, **options: Any) -> Any:
        pale = {"muted_alpha": style.PALE} if layer == "robot" else {}
        renderer = getattr(figure, kind)(source=source, **options, **pale)
        paints = ("fill_color",) if filled else ("fill_color", "line_color") if kind in _AREAS else ("line_color",)
        for glyph in (renderer.glyph, renderer.muted_glyph) if pale else (renderer.glyph,):
            theme.paint(glyph, ink, *paints)
        drawn.append((renderer, layer))
        return renderer

    now, trail, points, people, tracks, places = moment
    body: dict[str, Any] = {"x": "x", "y": "y"}
    whole = add("ghost", "line", rows, ink, **body, line_dash=dash, line_width=1.6, line_alpha=style.PALE)
    add("pillars", "circle", people, style.SOLID, filled=True, **body, radius="pillar", line_color=None)
    add("people", "circle", people, style.PERSON, **body, radius="person", fill_alpha=0.5, line_alpha=0.8)
    add("waypoint", "circle", now, style.GOAL, x="gx", y="gy", radius=goal, fill_alpha=0.15, line_width=2)
    add("waypoint", "ray", now, style.GOAL, x="gx", y="gy", length=goal, angle="gtheta", line_width=2)
    add("hypotheses", "circle", places, style.ESTIMATE, **body, radius=robot, fill_alpha="alpha", line_width=1)
    add("hypotheses", "ray", places, style.ESTIMATE, **body, length=1.8 * robot, angle="theta", line_width=1.5)
    add("tracks", "circle", tracks, style.ESTIMATE, **body, radius="radius", fill_alpha=0.0, line_width=1.5)
    add("tracks", "segment", tracks, style.ESTIMATE, x0="x", y0="y", x1="next_x", y1="next_y", line_width=2)
    add("scan", "scatter", points, style.SCAN, filled=True, **body, size=3, line_color=None)
    add("odometry", "scatter", trail, style.ODOMETRY, filled=True, x="ox", y="oy", size=2.5, alpha=0.7, line_color=None)
    path = add("truth", "line", trail, ink, **body, line_dash=dash, line_width=2.4)
    add("estimate", "line", trail, style.ESTIMATE, x="ex", y="ey", line_dash=[6, 3], line_width=1.5)
    add("robot", "circle", now, ink, **body, radius=robot, fill_alpha=0.25, line_width=2)
    add("robot", "ray", now, ink, **body, length=robot, angle="theta", line_width=3)
    add("odometry", "scatter", now, style.ODOMETRY, filled=True, x="ox", y="oy", size=7, line_color=None)
    add("odometry", "ray", now, style.ODOMETRY, x="ox", y="oy", length=robot, angle="otheta", line_width=2)
    ellipse: dict[str, Any] = {"width": "width", "height": "height", "angle": "tilt"}
    add("estimate", "ellipse", now, style.ESTIMATE, x="ex", y="ey", **ellipse, fill_alpha=0.15, line_width=1.5)
    add("estimate", "ray", now, style.ESTIMATE, x="ex", y="ey", length=1.5 * robot, angle="etheta", line_width=2)
    place = [(drive.around.label or "robot", "@time{0.0} s"), ("x, y", "@x{0.00}, @y{0.00} m")]
    figure.add_tools(HoverTool(renderers=[whole, path], line_policy="nearest", tooltips=place))
    return drawn
