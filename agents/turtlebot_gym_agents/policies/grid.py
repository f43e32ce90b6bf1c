"""A grid of what a robot has seen, and the cheapest way over it, on which unknown cells are free.

A scan is entered sector by sector: free along three lines, occupied at the sector's range. Places that later beams pass become
free again. The functions are compiled where numba is; without it they run as plain Python, with the same results to the bit.
Places are in the grid's frame, m, with the origin in its middle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.cache import compiled
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import TWO_PI, sincos
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT

CELL = 0.1
"""Side of a cell, m."""
SIDE = 160
"""Number of rows and of columns."""
OCCUPIED = 5
"""Least evidence of an occupied cell; an unknown one has 0."""
_LEAST, _MOST = -14, 21
_HIT, _BESIDE, _PASSED = 7, 3, 1
"""Evidence of a sector's range, of its neighbourhood within the sector, and of a line that goes on."""
_SHORT = 0.1
"""Length by which free lines end before the range, m."""
_TOWARDS = 0.4
"""Share of a sector by which an obstacle lies off its middle, on the side of a shorter range, if the ranges rise."""
_PAD = 8
"""Cells around what is known over which ways may lead."""
FREE, _VAIN = 4.0, 200.0
"""Weight of a cell far from everything, and what each vain attempt to enter it adds."""
_STRAIGHT, _DIAGONAL, _NONE = np.float32(5.0), np.float32(7.0), np.float32(1e6)
"""Lengths of the steps, as in `turtlebot_gym.rooms.geodesic`; float32 holds their sums exactly."""


@kernel
def _cell(at: float) -> int:
    """Return the row or column of a place, which may lie outside."""
    return math.floor(at / CELL) + SIDE // 2


@kernel
def _add(grid, y: float, x: float, evidence: int) -> None:
    i, j = _cell(y), _cell(x)
    if 0 <= i < SIDE and 0 <= j < SIDE:
        grid[i, j] = max(min(grid[i, j] + evidence, _MOST), _LEAST)


@kernel
def see(grid, x: float, y: float, theta: float, shares, reach: float) -> None:
    """Enter a scan.

    Args:
        grid: Evidence for an obstacle, shape (`SIDE`, `SIDE`), int8; changed.
        x: Pose at which the scan was measured, m.
        y: m.
        theta: rad.
        shares: Range of each sector as a share of `SIGHT`, shape (`SECTORS`,), float64.
        reach: Distance beyond which it is ignored, m.
    """
    for sector in range(SECTORS):
        points = 2 * int(max(min(shares[sector] * SIGHT - _SHORT, reach), 0.0) / CELL)
        for line in range(-1, 2):
            sine, cosine = sincos(theta + (sector + line / 3.0) * TWO_PI / SECTORS)
            for point in range(points):
                away = 0.5 * CELL * point
                _add(grid, y + sine * away, x + cosine * away, -_PASSED)
    for sector in range(SECTORS):
        away = shares[sector] * SIGHT
        if shares[sector] < 1.0 and away < reach:
            right, left = shares[sector - 1], shares[(sector + 1) % SECTORS]
            side = -_TOWARDS if right < shares[sector] < left else _TOWARDS if left < shares[sector] < right else 0.0
            for line in range(-1, 2):
                sine, cosine = sincos(theta + (sector + side + line / 3.0) * TWO_PI / SECTORS)
                _add(grid, y + sine * away, x + cosine * away, _HIT if line == 0 else _BESIDE)


@kernel
def _sweep(lengths, weights, first: int, last: int, step: int) -> None:
    """Extend the ways of each row by a step to the next, row by row."""
    for row in range(first, last, step):
        behind, weight = lengths[row - step], weights[row]
        beside = np.minimum(behind[:-2], behind[2:]) + _DIAGONAL * weight
        lengths[row, 1:-1] = np.minimum(lengths[row, 1:-1], np.minimum(behind[1:-1] + _STRAIGHT * weight, beside))


@kernel
def spread(weights, row: int, column: int):
    """Return the cost of the cheapest way from each cell to one, float32, with a border of one cell.

    Args:
        weights: Cost of each cell, whole numbers, shape (rows + 2, columns), float32; the first and the last row are not used.
        row: The cell's.
        column: The cell's.

    References:
        Zhao, "A fast sweeping method for eikonal equations", *Mathematics of Computation* 74 (2005).
    """
    rows, columns = weights.shape[0] - 2, weights.shape[1]
    turned = np.zeros((columns + 2, rows), np.float32)
    turned[1:-1] = weights[1:-1].T
    lengths = np.full((rows + 2, columns + 2), _NONE)
    lengths[row + 1, column + 1] = np.float32(0.0)
    while True:
        before = lengths.copy()
        _sweep(lengths, weights, 1, rows + 1, 1)
        _sweep(lengths, weights, rows, 0, -1)
        across = np.ascontiguousarray(lengths.T)
        _sweep(across, turned, 1, columns + 1, 1)
        _sweep(across, turned, columns, 0, -1)
        lengths = np.ascontiguousarray(across.T)
        if np.array_equal(lengths, before):
            return lengths


@kernel
def _line_costs(weights, row: float, column: float, to_row: float, to_column: float) -> float:
    """Return the cost of the straight line between two places, in cells."""
    down, along, total = to_row - row, to_column - column, 0.0
    points = int(max(abs(down), abs(along))) + 1
    for point in range(points):
        share = (point + 0.5) / points
        total += weights[math.floor(row + down * share) + 1, math.floor(column + along * share)]
    return 5.0 * total / points * sqrt(down * down + along * along)


@kernel
def plan(
    grid, vain, stuck: bool, x: float, y: float, goal_x: float, goal_y: float, stamp, preview: float, detour: float, target
) -> None:
    """Write the point to steer to: the farthest one of the way to which a straight line is hardly dearer; NaN for the goal.

    Args:
        grid: Evidence, as for `see`.
        vain: Number of vain attempts to enter each cell, shape (`SIDE`, `SIDE`), int8; changed.
        stuck: Whether the robot does not get on.
        x: The robot's place, m.
        y: m.
        goal_x: The goal's, m; outside of the grid, the nearest place inside counts.
        goal_y: m.
        stamp: Weights around an occupied cell, a square with it in the middle, of at most `_PAD` cells to each side.
        preview: Length of the way that is looked at, m.
        detour: The straight line may cost so many times what the way costs, and a cell's more.
        target: Output, x and y, m.
    """
    i, j = min(max(_cell(y), 0), SIDE - 1), min(max(_cell(x), 0), SIDE - 1)
    goal_i, goal_j = min(max(_cell(goal_y), 0), SIDE - 1), min(max(_cell(goal_x), 0), SIDE - 1)
    down, along = np.nonzero(grid >= OCCUPIED)
    top, left, bottom, right = min(i, goal_i), min(j, goal_j), max(i, goal_i), max(j, goal_j)
    if len(down) > 0:
        top, bottom = min(top, down.min()), max(bottom, down.max())
        left, right = min(left, along.min()), max(right, along.max())
    top, left = top - _PAD, left - _PAD
    rows, columns = bottom - top + _PAD + 1, right - left + _PAD + 1
    weights = np.full((rows + 2, columns), np.float32(FREE))
    side = len(stamp)
    for n in range(len(down)):
        a, b = down[n] - top + 1 - side // 2, along[n] - left - side // 2
        weights[a : a + side, b : b + side] = np.maximum(weights[a : a + side, b : b + side], stamp)
    i, j, goal_i, goal_j = i - top, j - left, goal_i - top, goal_j - left
    for a, b in np.argwhere(vain > 0):
        if top <= a < top + rows and left <= b < left + columns:
            weights[a - top + 1, b - left] += np.float32(_VAIN * vain[a, b])
    lengths = spread(weights, goal_i, goal_j)
    here, cells = lengths[i + 1, j + 1], int(preview / CELL) + 1
    row, column = y / CELL + SIDE // 2 - top, x / CELL + SIDE // 2 - left
    way = np.empty((cells, 2), np.int64)
    n = 0
    while n < cells and not (i == goal_i and j == goal_j):
        least, weight, next_i, next_j = _NONE + _NONE, weights[i + 1, j], i, j
        for a in range(max(i - 1, 0), min(i + 2, rows)):
            for b in range(max(j - 1, 0), min(j + 2, columns)):
                cost = lengths[a + 1, b + 1] + (_DIAGONAL if a != i and b != j else _STRAIGHT) * weight
                if (a != i or b != j) and cost < least:
                    least, next_i, next_j = cost, a, b
        i, j = next_i, next_j
        way[n, 0], way[n, 1] = i, j
        n += 1
    if stuck and n > 3:
        a, b = way[2, 0] + top, way[2, 1] + left
        for down_to in range(max(a - 1, 0), min(a + 2, SIDE)):
            for along_to in range(max(b - 1, 0), min(b + 2, SIDE)):
                vain[down_to, along_to] = min(vain[down_to, along_to] + 1, 100)
    arrives = i == goal_i and j == goal_j
    target[0], target[1] = math.nan, math.nan
    for k in range(n - 1, -1, -1):
        a, b = way[k, 0], way[k, 1]
        allowed = detour * float(here - lengths[a + 1, b + 1]) + 5.0 * FREE
        if k <= 2 or _line_costs(weights, row, column, a + 0.5, b + 0.5) <= allowed:
            if not (arrives and k == n - 1):
                target[0], target[1] = (b + left - SIDE // 2 + 0.5) * CELL, (a + top - SIDE // 2 + 0.5) * CELL
            break


def _advance(grids, vain, scans, reaches, shares, new, places, goals, due, stuck, stamp, preview, detour, targets) -> None:
    for n in range(len(grids)):
        if new[n]:
            see(grids[n], scans[n, 0], scans[n, 1], scans[n, 2], shares[n], reaches[n])
        if due[n]:
            x, y, goal_x, goal_y = places[n, 0], places[n, 1], goals[n, 0], goals[n, 1]
            plan(grids[n], vain[n], stuck[n], x, y, goal_x, goal_y, stamp, preview, detour, targets[n])


@cache
def advance() -> Callable[..., None]:
    """Return the compiled function that lets several robots `see` where ``new`` and `plan` where ``due``."""
    return compiled(_advance, "ways of the planner")


def shifted(grid: NDArray[Any], rows: int, columns: int) -> NDArray[Any]:
    """Return a grid whose middle is elsewhere; what comes into it is unknown."""
    i, j = np.arange(SIDE) + rows, np.arange(SIDE) + columns
    known = ((i >= 0) & (i < SIDE))[:, None] & ((j >= 0) & (j < SIDE))
    return np.where(known, grid[np.clip(i, 0, SIDE - 1)[:, None], np.clip(j, 0, SIDE - 1)], 0)
