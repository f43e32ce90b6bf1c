"""The map of a run: the room. What moves in it is drawn by `present.js`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import GlyphRenderer, LinearColorMapper, Range1d
from bokeh.plotting import figure as Figure
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.rooms.cells import to_cells
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap
from turtlebot_gym_view import style
from turtlebot_gym_view.style import Theme, ThemeColour

PAD = 0.3
"""Margin around the visible contents, m."""
MARGIN = 56
"""Space to the left of each frame, pixels, so that its size does not depend on the labels of the ticks."""
PIXELS = 800
"""Longest side of a map's picture."""


class Map(NamedTuple):
    """A map, and what the client needs to draw in it."""

    figure: Figure
    aspect: float
    """Ratio of width to height of the visible area."""
    still: list[float]
    """x, y and radius of each static circle in sequence."""
    sizes: list[float]
    """Radii of the robot and of a waypoint, m."""
    seen: list[float]
    """Visible area: least x and y, greatest x and y, m."""
    chart: list[GlyphRenderer[Any]]
    """The picture of a localizer's own map, if there is one."""

    def models(self) -> dict[str, Any]:
        """Return the models that the client needs, by name."""
        return {name: getattr(self, name) for name in ("figure", "still", "sizes", "seen", "chart")}


def make_map(drive: Drive, drives: Sequence[Drive], theme: Theme, *, name: str, beside: Figure | None) -> Map:
    """Return the map of a run.

    Args:
        drive: The run.
        drives: All runs; each map covers the area of all of them.
        theme: Registry of the colours.
        name: Name of the figure.
        beside: Another run's map, panned and zoomed together with this one.
    """
    low, high = _extent(drives)
    x_range, y_range = (
        (beside.x_range, beside.y_range) if beside else (Range1d(start=low[0], end=high[0]), Range1d(start=low[1], end=high[1]))
    )
    figure = Figure(
        name=name,
        x_range=x_range,
        y_range=y_range,
        sizing_mode="stretch_both",
        min_border=4,
        min_border_left=MARGIN,
        tools="",
        toolbar_location=None,
        x_axis_label="x (m)",
        y_axis_label="y (m)",
    )
    theme.dress(figure)
    _draw_room(figure, drive, theme)
    chart = [_draw_cells(figure, drive.around.chart, 2, style.CHART, theme)] if drive.around.chart else []
    figure.scatter([], [])  # Bokeh warns of a figure that has nothing to draw
    room, around = drive.around.room, drive.around
    still = [number for circle in (room.circles if room else ()) for number in circle]
    width, height = high - low
    aspect = float(np.clip(width / height, 0.7, 2.0))
    return Map(figure, aspect, still=still, sizes=[around.robot_radius, around.goal_radius], seen=[*low, *high], chart=chart)


def _extent(drives: Sequence[Drive]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower left and the upper right corner of the visible area, m."""
    points = []
    for drive in drives:
        room = drive.around.room
        points += [drive.true_state[:, :2], drive.estimate[:, :2], drive.reference[:, :2]]
        if not np.isfinite(drive.true_state[:, :2]).any():
            points.append(drive.odometry[:, :2])
        if room:
            x, y, a, b = room.walls
            points.append(np.array([[x - a, y - b], [x + a, y + b]]))
        elif drive.around.grid is not None:
            points.append(_corners(drive.around.grid))
    places = np.concatenate(points)
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        places = np.zeros((1, 2))
    low, high = places.min(axis=0) - PAD, places.max(axis=0) + PAD
    short = np.maximum(1.0 - 0.5 * (high - low), 0.0)  # at least 2 m wide and high
    return low - short, high + short


def _picture(grid: GridMap) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
    """Return a map as an axis-aligned picture: 0 free or outside, 1 unknown, 2 occupied; the first row is the lowest.

    Returns:
        The picture, and its lower left corner, width and height, m.
    """
    corners = _corners(grid)
    low, high = corners.min(axis=0), corners.max(axis=0)
    side = max(float(grid.resolution), float(np.max(high - low)) / PIXELS)
    columns, rows = np.maximum(np.round((high - low) / side), 1).astype(int)
    shades = np.where(grid.cells == OCCUPIED, 2, np.where(grid.cells == FREE, 0, 1)).astype(np.uint8)
    shown = np.zeros((rows, columns), np.uint8)
    fine = max(1, int(np.ceil(side / grid.resolution)))  # several cells per pixel: the darkest counts, to keep thin walls
    for du in range(fine):
        for dv in range(fine):
            x = low[0] + (np.arange(columns)[None, :] + (du + 0.5) / fine) * side
            y = low[1] + (np.arange(rows)[:, None] + (dv + 0.5) / fine) * side
            column, row = (np.floor(at).astype(np.intp) - 1 for at in to_cells(grid.frame, x, y))
            inside = (column >= 0) & (column < shades.shape[1]) & (row >= 0) & (row < shades.shape[0])
            sampled = shades[np.where(inside, row, 0), np.where(inside, column, 0)]
            shown = np.maximum(shown, np.where(inside, sampled, 0).astype(np.uint8))
    return shown, (float(low[0]), float(low[1]), float(columns * side), float(rows * side))


def _corners(grid: GridMap) -> NDArray[np.float64]:
    x, y, cosine, sine, resolution = grid.frame.tolist()
    height, width = (size * resolution for size in grid.cells.shape)
    return np.array([[x + cosine * u - sine * v, y + sine * u + cosine * v] for u in (0.0, width) for v in (0.0, height)])


def _draw_cells(figure: Figure, grid: GridMap, value: int, ink: ThemeColour, theme: Theme) -> GlyphRenderer[Any]:
    """Draw the cells of a map that have a value in its picture."""
    shown, (x, y, width, height) = _picture(grid)
    mapper = LinearColorMapper(palette=["#00000000", ink.light], low=0, high=1)
    theme.entries.append([mapper, "palette", ["#00000000", ink.light], ["#00000000", ink.dark]])
    place: dict[str, Any] = {"x": x, "y": y, "dw": width, "dh": height, "color_mapper": mapper}
    return figure.image([(shown == value).astype(np.uint8)], **place)


def _draw_room(figure: Figure, drive: Drive, theme: Theme) -> None:
    """Draw what is static; circles are left to the client, since they may move."""
    room, grid = drive.around.room, drive.around.grid
    if grid is not None:
        for value, ink in ((1, style.UNKNOWN), (2, style.SOLID)):
            _draw_cells(figure, grid, value, ink, theme)
    if room:
        x, y, a, b = room.walls
        walls = figure.rect([x], [y], [2.0 * a], [2.0 * b], fill_color=None, line_width=3)
        theme.paint(walls.glyph, style.SOLID, "line_color")
        if room.boxes:
            cx, cy, length, width, heading = np.array(room.boxes).T
            boxes = figure.rect(cx, cy, length, width, angle=heading, line_color=None)
            theme.paint(boxes.glyph, style.SOLID, "fill_color")
