"""Shortest paths on a grid: the cells in which a robot's centre may be, and the distance from each to the goal.

A cell is free if the robot keeps `MARGIN` to everything there. Paths lead from a free cell to its eight neighbours; the margin
is more than half a diagonal, so a robot that follows a path stays clear all along it. Lengths are integer multiples of `UNIT`:
5 for a straight step and 7 for a diagonal one, which is 1 % short of the square root of 2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.kernel import in_loops, kernel, sqrt
from turtlebot_gym.rooms.rays import (
    distance_to_box,
    distance_to_cells,
    distance_to_circle,
    distance_to_walls,
    is_on_map,
    to_cells,
)
from turtlebot_gym.rooms.scene import RESOLUTION, UNREACHED, Scene, cells_along

MARGIN = 0.1
"""Clearance around the robot on a path, m."""
_HERE, _STRAIGHT, _DIAGONAL, _NONE = np.float32(0.0), np.float32(5.0), np.float32(7.0), np.float32(1e6)
UNIT = RESOLUTION / float(_STRAIGHT)
"""Unit of path lengths, m."""
UNKNOWN = -1.0
"""Remaining path length if there is no path."""
_BLOCKED = UNREACHED - 1


def _relax_each(row, behind, least):
    shorter = False
    for k in range(1, len(row) - 1):
        length = min(behind[k] + _STRAIGHT, min(behind[k - 1], behind[k + 1]) + _DIAGONAL)
        length = max(min(row[k], length), least[k])
        shorter = shorter | (length != row[k])
        row[k] = length
    return shorter


@in_loops(_relax_each)
def _relax(row: Any, behind: Any, least: Any) -> bool:
    """Shorten the paths of a row, shape (n,), by a step from the row behind it, but for the first and the last.

    No path becomes shorter than ``least``, by which cells are blocked. Returns whether any became shorter.
    """
    length = np.minimum(behind[1:-1] + _STRAIGHT, np.minimum(behind[:-2], behind[2:]) + _DIAGONAL)
    length = np.maximum(np.minimum(row[1:-1], length), least[1:-1])
    shorter = bool((length != row[1:-1]).any())
    row[1:-1] = length
    return shorter


@kernel
def extent(scene: Scene) -> tuple[int, int]:
    """Return the rows and columns of the grid over a room."""
    return cells_along(2.0 * scene.room.walls[3]), cells_along(2.0 * scene.room.walls[2])


@kernel
def cell_of(scene: Scene, x: float, y: float) -> tuple[int, int]:
    """Return row and column of the cell around a point, or of the nearest one."""
    rows, columns = extent(scene)
    row = int(min(max((y - scene.room.walls[1] + scene.room.walls[3]) / RESOLUTION, 0.0), rows - 1.0))
    column = int(min(max((x - scene.room.walls[0] + scene.room.walls[2]) / RESOLUTION, 0.0), columns - 1.0))
    return row, column


@kernel
def centre_of(scene: Scene, row: int, column: int) -> tuple[float, float]:
    """Return the centre of a cell, m."""
    x = scene.room.walls[0] - scene.room.walls[2] + (column + 0.5) * RESOLUTION
    y = scene.room.walls[1] - scene.room.walls[3] + (row + 0.5) * RESOLUTION
    return x, y


class Grid(NamedTuple):
    """Cells over a room."""

    cells: Any
    """Shape (rows, columns), or more."""
    rows: int
    columns: int
    x: float
    """Lower left corner, m."""
    y: float
    side: float
    """Side of a cell, m."""


@kernel
def _mark_around(grid: Grid, value: Any, shape: Any, reach_x: float, reach_y: float, clearance: float) -> None:
    """Mark the cells nearer than ``clearance`` to a circle or a box, a row of its array, all of which are within a reach."""
    cells, rows, columns, left, bottom, side = grid
    x, y, round_one = shape[0], shape[1], len(shape) == 5
    for row in range(max(int((y - reach_y - bottom) / side), 0), min(int((y + reach_y - bottom) / side) + 1, rows)):
        for column in range(max(int((x - reach_x - left) / side), 0), min(int((x + reach_x - left) / side) + 1, columns)):
            dx, dy = x - (left + (column + 0.5) * side), y - (bottom + (row + 0.5) * side)
            away = distance_to_circle(dx, dy, shape[2]) if round_one else distance_to_box(dx, dy, shape)
            if away < clearance:
                cells[row, column] = value


@kernel
def mark_obstacles(grid: Grid, value: Any, scene: Scene, clearance: float) -> None:
    """Write a value into the cells whose centres are nearer than ``clearance`` to a room's static obstacles."""
    for k in range(scene.room.counts[0]):
        circle = scene.room.circles[k]
        if circle[3] == 0.0 and circle[4] == 0.0:
            reach = circle[2] + clearance
            _mark_around(grid, value, circle, reach, reach, clearance)
    for k in range(scene.room.counts[1]):
        box = scene.room.boxes[k]
        cosine, sine = abs(box[4]), abs(box[5])
        reach_x, reach_y = cosine * box[2] + sine * box[3] + clearance, sine * box[2] + cosine * box[3] + clearance
        _mark_around(grid, value, box, reach_x, reach_y, clearance)


@kernel
def block(scene: Scene, clearance: float) -> None:
    """Mark the cells whose centres are nearer than ``clearance`` to the walls or to static obstacles.

    On a map, also mark those whose centres are not known to be free.
    """
    (rows, columns), walls, squares, ways = extent(scene), scene.room.walls, scene.room.squares, scene.room.ways
    reach = clearance / scene.room.frame[4] if squares.shape[1] > 0 else 0.0
    for row in range(rows):
        for column in range(columns):
            x, y = centre_of(scene, row, column)
            blocked = distance_to_walls(walls[0] - x, walls[1] - y, walls[2], walls[3]) < clearance
            if squares.shape[1] > 0:
                across, along = to_cells(scene.room.frame, x, y)
                known = is_on_map(squares, across, along) and scene.room.known[int(along), int(across)] != 0
                blocked = blocked or not known or distance_to_cells(squares, across, along, reach) < reach
            ways[row, column] = _BLOCKED if blocked else UNREACHED
    mark_obstacles(Grid(ways, rows, columns, walls[0] - walls[2], walls[1] - walls[3], RESOLUTION), _BLOCKED, scene, clearance)


@kernel
def is_free(scene: Scene, x: float, y: float) -> bool:
    """Return whether the cell around a point is free."""
    row, column = cell_of(scene, x, y)
    return scene.room.ways[row, column] != _BLOCKED


@kernel
def _sweep(lengths, least, first: int, last: int, step: int) -> bool:
    """Extend the paths of each row by a step to the next, row by row, and return whether any length became shorter.

    A row depends only on the row before it, so LLVM vectorizes the inner loop.
    """
    shorter = False
    for row in range(first, last, step):
        shorter = _relax(lengths[row], lengths[row - step], least[row]) | shorter
    return shorter


@kernel
def spread(scene: Scene, x: float, y: float) -> None:
    """Find the shortest path from each cell to the one around (x, y), which must be free; call `block` first.

    The grid is swept up, down, right and left, a row or column at a time, until four sweeps in a row change nothing. A path
    takes as many sweeps as it has segments in one sweep direction, which are few. Paths longer than 1.3 km count as none.

    References:
        Zhao, "A fast sweeping method for eikonal equations", *Mathematics of Computation* 74 (2005).
    """
    rows, columns = extent(scene)
    ways = scene.room.ways
    # With a blocked border; float32 holds integers exactly up to 2^24 and makes long vectors.
    lengths, least = np.full((rows + 2, columns + 2), _NONE), np.full((rows + 2, columns + 2), _NONE)
    for row in range(rows):
        for column in range(columns):
            least[row + 1, column + 1] = _NONE if ways[row, column] == _BLOCKED else _HERE
    row, column = cell_of(scene, x, y)
    lengths[row + 1, column + 1] = _HERE
    sweep, unchanged = 0, 0
    while unchanged < 4:
        direction = sweep % 4
        if direction == 0:
            shorter = _sweep(lengths, least, 1, rows + 1, 1)
        elif direction == 1:
            shorter = _sweep(lengths, least, rows, 0, -1)
        elif direction == 2:
            shorter = _sweep(lengths.T, least.T, 1, columns + 1, 1)
        else:
            shorter = _sweep(lengths.T, least.T, columns, 0, -1)
        unchanged = 0 if shorter else unchanged + 1
        sweep += 1
    for row in range(rows):
        for column in range(columns):
            if ways[row, column] != _BLOCKED:
                length = lengths[row + 1, column + 1]
                ways[row, column] = int(length) if length < _BLOCKED else UNREACHED


@kernel
def way_left(scene: Scene, x: float, y: float) -> float:
    """Return the length of the shortest path to the goal, m; `UNKNOWN` without a free cell."""
    rows, columns = extent(scene)
    row, column = cell_of(scene, x, y)
    shortest = 1e9
    for near_row in range(max(row - 1, 0), min(row + 2, rows)):
        for near_column in range(max(column - 1, 0), min(column + 2, columns)):
            length = scene.room.ways[near_row, near_column]
            if length < _BLOCKED:
                to_x, to_y = centre_of(scene, near_row, near_column)
                dx, dy = to_x - x, to_y - y
                shortest = min(shortest, length * UNIT + sqrt(dx * dx + dy * dy))
    return shortest if shortest < 1e9 else UNKNOWN
