"""Shapes in the plane as cells, and the ground that they enclose."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.rooms.charting import SIDE
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, UNKNOWN, GridMap
from turtlebot_gym.rooms.scene import MAX_CELLS, RESOLUTION, Walls
from turtlebot_gym.rooms.solids import Cut
from turtlebot_gym.values import Pose

FINEST = 0.01
"""Least side of a cell where shapes are there that are neither circles nor boxes, m; elsewhere `charting.SIDE`."""
CELLS = 2_000_000
"""Cells of a raster; larger worlds have larger ones."""
NARROW = 0.2
"""Width of a gap through which no robot passes, m: a Burger is 0.18 m wide."""
ENOUGH = 1.0
"""Least enclosed ground in which starts and goals are drawn, m^2."""


class Raster(NamedTuple):
    """Cells over a room."""

    walls: Walls
    side: float
    """Side of a cell, m."""
    cells: NDArray[np.bool_]
    """Shape (rows, columns); the first row is the lowest."""

    def map(self, cells: NDArray[Any]) -> GridMap:
        """Return a map of cells with values."""
        x, y, half_length, half_width = self.walls
        return GridMap(cells=cells, resolution=self.side, origin=Pose(x - half_length, y - half_width, 0.0))


def side_of(walls: Walls, finest: float) -> float:
    """Return the side of the cells of a room, m."""
    return max(finest, math.sqrt(4.0 * walls.half_length * walls.half_width / CELLS))


def raster(walls: Walls, cut: Cut, side: float) -> Raster:
    """Return the cells that shapes occupy.

    Args:
        walls: The room's walls.
        cut: The shapes. Cells count as occupied whose centre is in a solid shape, or which an outline or a thin shape touches.
        side: Side of a cell, m.
    """
    size = (math.ceil(2.0 * extent / side - 1e-9) for extent in (walls.half_width, walls.half_length))
    cells = np.zeros(tuple(size), np.bool_)
    corner = np.array((walls.x - walls.half_length, walls.y - walls.half_width))
    angles = np.linspace(0.0, 2.0 * math.pi, 97)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    rings = [(circle * radius + (x, y), 2.0 * radius) for x, y, radius in cut.circles]
    rings += [(_ring(box), min(box[2:4])) for box in cut.boxes]
    for ring, width in rings:
        placed = (np.stack((ring[:-1], ring[1:]), axis=1) - corner) / side
        _fill(cells, placed)
        if width < 2.0 * side:
            _draw(cells, placed)
    for segments, is_solid in cut.outlines:
        placed = (segments - corner) / side
        if is_solid:
            _fill(cells, placed)
        _draw(cells, placed)
    return Raster(walls, side, cells)


def _ring(box: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the corners of a box, the first one again at the end."""
    x, y, length, width, heading = box
    cosine, sine = math.cos(heading), math.sin(heading)
    corners = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * (length, width)
    return corners @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)


def _draw(cells: NDArray[np.bool_], segments: NDArray[np.float64]) -> None:
    """Mark the cells that segments, shape (n, 2, 2), touch; in cells."""
    steps = np.ceil(np.abs(segments[:, 1] - segments[:, 0]).max(axis=1) * 2.0).astype(int) + 1
    of = np.repeat(np.arange(len(segments)), steps + 1)
    share = (np.arange(len(of)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)) / steps[of]
    points = segments[of, 0] + share[:, None] * (segments[of, 1] - segments[of, 0])
    column, row = np.floor(points).astype(int).T
    inside = (row >= 0) & (column >= 0) & (row < cells.shape[0]) & (column < cells.shape[1])
    cells[row[inside], column[inside]] = True


def _fill(cells: NDArray[np.bool_], segments: NDArray[np.float64]) -> None:
    """Mark the cells from whose centre an odd number of segments lies to the left; in cells."""
    rows, columns = cells.shape
    y = segments[..., 1]
    low, high = np.minimum(y[:, 0], y[:, 1]), np.maximum(y[:, 0], y[:, 1])
    first, last = max(math.floor(low.min()), 0), min(math.ceil(high.max()) + 1, rows)
    left = min(max(math.floor(segments[..., 0].min()), 0), columns)
    right = min(max(math.ceil(segments[..., 0].max()) + 1, left), columns)
    if last <= first or right <= left:
        return
    begin = np.clip(np.ceil(low - 0.5), first, last).astype(int)
    count = np.maximum(np.clip(np.ceil(high - 0.5), first, last).astype(int) - begin, 0)
    of = np.repeat(np.arange(len(segments)), count)
    row = begin[of] + np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    (x0, y0), (x1, y1) = segments[of, 0].T, segments[of, 1].T
    x = x0 + (row + 0.5 - y0) * (x1 - x0) / (y1 - y0)
    turns = np.zeros((last - first, right - left + 1), np.int32)
    np.add.at(turns, (row - first, np.clip(np.ceil(x - 0.5), left, right).astype(int) - left), 1)
    cells[first:last, left:right] |= np.cumsum(turns, axis=1)[:, :-1] % 2 == 1


def enclosed_ground(occupied: Raster) -> NDArray[np.bool_] | None:
    """Return the largest ground that shapes enclose, but for gaps of less than `NARROW`; None if it is less than `ENOUGH`."""
    from scipy.ndimage import distance_transform_edt, label  # worlds from files alone need it

    half, cells, side = 0.5 * NARROW, occupied.cells, occupied.side
    wide: Any = distance_transform_edt(~cells)
    labelled: Any = label(wide * side > half)
    labels = labelled[0]
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        sizes[edge] = 0
    largest = int(sizes.argmax())
    if sizes[largest] * side * side < ENOUGH:
        return None
    near: Any = distance_transform_edt(labels != largest)
    return (near * side <= half) & ~cells


def ground_between(occupied: Raster) -> NDArray[np.bool_] | None:
    """Return the ground in the convex hull of shapes; None if it is less than `ENOUGH`."""
    from scipy.spatial import ConvexHull

    row, column = np.nonzero(occupied.cells)
    points = np.column_stack((column, row)).astype(float) + 0.5
    corners = points[ConvexHull(points).vertices] if np.ptp(row) and np.ptp(column) else points[:1]
    inside = np.zeros_like(occupied.cells)
    _fill(inside, np.stack((corners, np.roll(corners, -1, axis=0)), axis=1))
    ground = inside & ~occupied.cells
    return ground if ground.sum() * occupied.side**2 >= ENOUGH else None


def maps_of(
    walls: Walls, shapes: Cut, start: Pose | None, goal: Pose | None, *, is_whole: bool
) -> tuple[GridMap | None, GridMap | None]:
    """Return the map of a plan, and that of its localizer; None for both if the plan needs none.

    The first one holds what neither circles nor boxes can, and as unknown what is not enclosed, so that neither starts, goals
    nor paths are there; the second one holds all shapes.

    Args:
        walls: The room's walls.
        shapes: What stands in it.
        start: A given start.
        goal: A given goal: all ground counts if one of the two is not in what is enclosed.
        is_whole: Whether no shape is missing, which might enclose the others; if one is, the ground between these counts.
    """
    if walls.half_length * walls.half_width > MAX_CELLS * RESOLUTION**2:
        return None, None  # no paths are found in a room of that size
    side = side_of(walls, FINEST if shapes.outlines else SIDE)
    occupied, solid = raster(walls, shapes, side), raster(walls, Cut([], [], shapes.outlines), side)
    ground = enclosed_ground(occupied)
    ground = ground_between(occupied) if ground is None and not is_whole else ground
    given = [pose for pose in (start, goal) if pose is not None]
    if ground is not None and not all(ground[_cell(occupied, pose.x, pose.y)] for pose in given):
        ground = None
    if ground is None and not shapes.outlines:
        return None, None
    free = ~occupied.cells if ground is None else ground
    seen = np.where(solid.cells, OCCUPIED, np.where(free | occupied.cells, FREE, UNKNOWN))
    chart = raster(walls, shapes, max(side, SIDE))
    row, column = (
        np.minimum((np.arange(n) + 0.5) * chart.side // side, m - 1).astype(int)
        for n, m in zip(chart.cells.shape, free.shape, strict=True)
    )
    known = np.where(chart.cells, OCCUPIED, np.where(free[np.ix_(row, column)], FREE, UNKNOWN))
    return occupied.map(seen), chart.map(known)


def _cell(of: Raster, x: float, y: float) -> tuple[int, int]:
    """Return the row and column of a place in the room."""
    row = int((y - of.walls.y + of.walls.half_width) // of.side)
    column = int((x - of.walls.x + of.walls.half_length) // of.side)
    return min(row, of.cells.shape[0] - 1), min(column, of.cells.shape[1] - 1)
