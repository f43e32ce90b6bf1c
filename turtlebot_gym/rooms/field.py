"""Signed distance fields of maps: how far each place is from the nearest surface, which is what a localizer looks up.

A field is an array of distances at the centres of square cells, shape (rows, columns), float32, m, and a frame, shape (5,): its
lower left corner, cosine and sine of its rows' direction, side of a cell; m. NaN means unknown.

References:
    Felzenszwalb, Huttenlocher, "Distance transforms of sampled functions", *Theory of Computing* 8 (2012): one axis at a time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.kernel import in_loops, kernel, sqrt

REACH = 1.0
"""Greatest distance in a field, m: beams that end farther from a surface have no pull."""


class Sampled(NamedTuple):
    """A field at a point."""

    known: bool
    """Whether the field says anything there; if not, the rest is meaningless."""
    distance: float
    """Signed distance, m."""
    dx: float
    """Its derivatives by x and y in the world."""
    dy: float


@kernel
def _squares_each(marked: Any, value: bool, reach: int, nearest: Any) -> None:
    rows, columns = marked.shape
    squares = np.empty((rows, columns), np.int32)
    for row in range(rows):
        for column in range(columns):
            squares[row, column] = (reach + 1) * (marked[row, column] != value)
    for row in range(1, rows):
        _lower(squares[row], squares[row - 1], 1)
    for row in range(rows - 2, -1, -1):
        _lower(squares[row], squares[row + 1], 1)
    for row in range(rows):
        for column in range(columns):
            squares[row, column] *= squares[row, column]
            nearest[row, column] = squares[row, column]
    for shift in range(1, min(reach + 1, columns)):
        for row in range(rows):
            _lower(nearest[row, shift:], squares[row, : columns - shift], shift * shift)
            _lower(nearest[row, : columns - shift], squares[row, shift:], shift * shift)


@kernel
def _lower(row: Any, by: Any, more: int) -> None:
    """Lower each number of a row, shape (n,), to that of another one plus ``more``, where this is less."""
    for k in range(len(row)):
        row[k] = min(row[k], by[k] + more)


def _squares_to_nearest(marked: Any, value: bool, reach: int) -> Any:
    """Return the squared distance from each cell to the nearest with a value, in cells; (reach + 1)^2 or more beyond the reach.

    First along columns, then along rows: since only distances up to the reach count, the lower envelope of parabolas is the
    minimum over that many shifts, in whole numbers and a row at a time, which is fast with and without a compiler.
    """
    squares = np.where(marked == value, 0, reach + 1).astype(np.int32)
    for row in range(1, len(squares)):
        np.minimum(squares[row], squares[row - 1] + 1, out=squares[row])
    for row in range(len(squares) - 2, -1, -1):
        np.minimum(squares[row], squares[row + 1] + 1, out=squares[row])
    squares *= squares
    nearest = squares.copy()
    for shift in range(1, min(reach + 1, squares.shape[1])):
        for row, by in zip(nearest, squares, strict=True):
            np.minimum(row[shift:], by[:-shift] + shift * shift, out=row[shift:])
            np.minimum(row[:-shift], by[shift:] + shift * shift, out=row[:-shift])
    return nearest


def _field_each(occupied, side, out):
    reach = int(REACH / side) + 1
    outside, inside = np.empty(occupied.shape, np.int32), np.empty(occupied.shape, np.int32)
    _squares_each(occupied, True, reach, outside)
    _squares_each(occupied, False, reach, inside)
    for row in range(occupied.shape[0]):
        for column in range(occupied.shape[1]):
            away = occupied[row, column] - 0.5 + sqrt(outside[row, column]) - sqrt(inside[row, column])
            out[row, column] = min(max(away * side, -REACH), REACH)


@in_loops(_field_each)
def field_of_cells(occupied: Any, side: float, out: Any) -> None:
    """Write the distances to the border between occupied and other cells, negative inside: for maps drawn from plans.

    One of the two distances to the centre of the nearest cell is 0, and half a cell is from a centre to the border. All arrays
    have the shape (rows, columns): occupied is bool, out float32; cells have a side in m, like the distances.
    """
    reach = int(REACH / side) + 1
    outside, inside = _squares_to_nearest(occupied, True, reach), _squares_to_nearest(occupied, False, reach)
    out[:] = np.clip((occupied - 0.5 + np.sqrt(outside) - np.sqrt(inside)) * side, -REACH, REACH)


def field_of_hits(occupied: Any, side: float, out: Any) -> None:
    """Write the distances to the centre of the nearest occupied cell: for maps drawn from a LiDAR's hits, as by SLAM.

    There an occupied cell says that hits fell into it: the surface goes through its middle, and a wall is one or two cells
    thick whatever the wall is. `field_of_cells` would shift each wall by half a cell towards the robot. Arguments as there.
    """
    squares = _squares_to_nearest(occupied, True, int(REACH / side) + 1)
    for row, to_nearest in zip(out, squares, strict=True):  # all doubles at once would take 8 bytes for each cell of a map
        row[:] = np.minimum(np.sqrt(to_nearest) * side, REACH)


@kernel
def at_cell(field: Any, row: int, column: int) -> float:
    """Return a cell's distance in double precision."""
    return float(field[row, column])


@kernel
def _from_centres(frame: Any, x: float, y: float) -> tuple[float, float]:
    """Return the column and row of a point, in cells from the centre of the first one."""
    dx, dy, cosine, sine = x - float(frame[0]), y - float(frame[1]), float(frame[2]), float(frame[3])
    per_cell = 1.0 / float(frame[4])
    return (dx * cosine + dy * sine) * per_cell - 0.5, (dy * cosine - dx * sine) * per_cell - 0.5


@kernel
def sample(field: Any, frame: Any, x: float, y: float) -> Sampled:
    """Return a field at a point, bilinear between the cells' centres; unknown beside an unknown cell and outside of the map."""
    column, row = _from_centres(frame, x, y)
    rows, columns = field.shape
    inside = (column >= 0.0) & (row >= 0.0) & (column < columns - 1.0) & (row < rows - 1.0)
    j, i = int(column) if inside else 0, int(row) if inside else 0
    a, b, cosine, sine, per_cell = column - j, row - i, float(frame[2]), float(frame[3]), 1.0 / float(frame[4])
    near, far = at_cell(field, i, j), at_cell(field, i, j + 1)
    above, across = at_cell(field, i + 1, j), at_cell(field, i + 1, j + 1)
    low, high = near + a * (far - near), above + a * (across - above)
    distance = low + b * (high - low)
    along_row, along_column = ((1.0 - b) * (far - near) + b * (across - above)) * per_cell, (high - low) * per_cell
    return Sampled(
        inside & (distance == distance),
        distance,
        along_row * cosine - along_column * sine,
        along_row * sine + along_column * cosine,
    )
