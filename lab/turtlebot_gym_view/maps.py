"""The map of a room. The drives in it are drawn by `moving`."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np
from bokeh.models import DataRange1d, GlyphRenderer, LinearColorMapper, PanTool, WheelZoomTool
from bokeh.plotting import figure as Figure
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap
from turtlebot_gym.rooms.rays import to_cells
from turtlebot_gym_view import style
from turtlebot_gym_view.style import Theme, ThemeColour

PAD = 0.3
"""Margin around the visible contents, m."""
PIXELS = 800
"""Longest side of a map's picture."""


class Map(NamedTuple):
    """A map of one drive, or of several over each other."""

    figure: Figure
    aspect: float
    """Ratio of width to height of the visible area."""
    chart: list[GlyphRenderer[Any]]
    """The picture of a localizer's own map, if there is one."""


def make_map(drives: Sequence[Drive], theme: Theme, *, name: str) -> Map:
    """Return a map of drives in the same room, without the drives."""
    low, high = _extent(drives)
    ranges: dict[str, Any] = {name: DataRange1d(range_padding=0.0) for name in ("x_range", "y_range")}
    figure = Figure(
        name=name,
        **ranges,
        match_aspect=True,
        sizing_mode="stretch_both",
        min_border=4,
        tools=[PanTool(), (wheel := WheelZoomTool(zoom_on_axis=False))],
        active_drag="auto",
        toolbar_location=None,
        x_axis_label="x (m)",
        y_axis_label="y (m)",
    )
    figure.toolbar.active_scroll = wheel
    theme.dress(figure)
    area = figure.scatter([low[0], high[0]], [low[1], high[1]], alpha=0.0)
    for axis in ranges.values():
        axis.renderers = [area]
    chart = drives[0].around.chart
    charts = [_draw_cells(figure, chart, 2, style.CHART, theme)] if chart else []
    _draw_room(figure, drives[0], theme)
    width, height = high - low
    return Map(figure, float(np.clip(width / height, 0.7, 2.0)), charts)


def place_of(drive: Drive) -> Hashable:
    """Return what drives in the same room have in common: walls, boxes and map."""
    room, grid = drive.around.room, drive.around.grid
    return room and (room.walls, room.boxes), grid and (grid.cells.tobytes(), grid.cells.shape, grid.origin)


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
    """Draw walls, boxes and cells; circles may move, and belong to the drive."""
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
