"""A grid of what a robot has seen, and the path over it; unknown cells are free, but may cost more.

A scan is entered sector by sector: free along three lines, occupied at the sector's range. The functions are compiled where
llvmlite is, else plain Python, with the same bits. Places are in the grid's frame, m, with the origin in its middle.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.program import in_machine_code
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import TWO_PI, sincos
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym_agents.policies.cheapest_way import FREE, STRAIGHT, cheapest_way

CELL = 0.1
"""Side of a cell, m."""
SIDE = 160
"""Number of rows and of columns."""
OCCUPIED = 5
"""Least evidence of an occupied cell; an unknown one has 0."""
FREED, CERTAIN = -14, 21
"""Least and most evidence."""
_HIT, _BESIDE, _PASSED = 7, 3, 1
"""Evidence of a sector's range, of its neighbourhood within the sector, and of a line that goes on."""
_SHORT = 0.1
"""Free lines end this far before the range, m."""
_TOWARDS = 0.4
"""Where ranges rise from sector to sector, an obstacle is this share of a sector off the middle, towards the shorter range."""
_PAD = 8
"""Cells around the known area over which paths may lead."""
_VAIN = 200
"""Increase of a cell's weight by each failed attempt to enter it."""


@kernel
def _cell(at: float) -> int:
    """Return the row or column of a place, which may lie outside."""
    return math.floor(at / CELL) + SIDE // 2


@kernel
def _add(grid, y: float, x: float, evidence: int) -> None:
    i, j = _cell(y), _cell(x)
    if 0 <= i < SIDE and 0 <= j < SIDE:
        grid[i, j] = max(min(grid[i, j] + evidence, CERTAIN), FREED)


@kernel
def see(grid, pose, shares, reach: float) -> None:
    """Enter a scan into evidence for obstacles, shape (`SIDE`, `SIDE`), int8.

    ``pose`` is where it was measured, x, y and heading, m and rad; ``shares`` are ranges of sectors as shares of `SIGHT`,
    float64, which are ignored beyond ``reach``, m.
    """
    x, y, theta = pose[0], pose[1], pose[2]
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
def _line_costs(weights, row: float, column: float, to_row: float, to_column: float) -> float:
    """Return the cost of the straight line between two places, in cells."""
    down, along, total = to_row - row, to_column - column, 0
    points = int(max(abs(down), abs(along))) + 1
    for point in range(points):
        share = (point + 0.5) / points
        total += weights[math.floor(row + down * share), math.floor(column + along * share)]
    return STRAIGHT * total / points * sqrt(down * down + along * along)


@kernel
def _is_any(marks) -> bool:
    """Return whether any number of a table is not 0."""
    for a in range(marks.shape[0]):
        for b in range(marks.shape[1]):
            if marks[a, b] != 0:
                return True
    return False


@kernel
def plan(grid, failed_attempts, ways, stuck, place, goal, stamp, preview, detour, unknown, habit, target) -> None:
    """Write the point to steer to: the farthest of the path to which a straight line costs little more; NaN for the goal.

    ``grid`` is evidence, as for `see`, ``failed_attempts`` counts those to enter each cell, and ``ways`` marks the cells of the
    last path and their neighbours, all of shape (`SIDE`, `SIDE`), int8; the latter two are changed. ``place`` and ``goal`` are
    x and y, m; outside of the grid, the nearest place inside counts. ``stamp`` are weights around an occupied cell, a square of
    at most `_PAD` cells to each side. Weights are ``unknown`` where nothing was seen, and grow by ``habit`` sixteenths off the
    last path, unless the robot is ``stuck``. The path is considered up to the length ``preview``, m; a straight line may cost
    ``detour`` times as much, not counting one cell.
    """
    i, j = min(max(_cell(place[1]), 0), SIDE - 1), min(max(_cell(place[0]), 0), SIDE - 1)
    goal_i, goal_j = min(max(_cell(goal[1]), 0), SIDE - 1), min(max(_cell(goal[0]), 0), SIDE - 1)
    top, left, bottom, right = min(i, goal_i), min(j, goal_j), max(i, goal_i), max(j, goal_j)
    for a in range(SIDE):
        for b in range(SIDE):
            if grid[a, b] >= OCCUPIED:
                top, left, bottom, right = min(top, a), min(left, b), max(bottom, a), max(right, b)
    top, left = top - _PAD, left - _PAD
    height, width = bottom - top + _PAD + 1, right - left + _PAD + 1
    cells = np.full(height * width, unknown, np.int32)
    weights = cells.reshape((height, width))
    first_a, first_b, end_a, end_b = max(top, 0), max(left, 0), min(bottom + _PAD + 1, SIDE), min(right + _PAD + 1, SIDE)
    for a in range(first_a, end_a):
        for b in range(first_b, end_b):
            if grid[a, b] != 0:
                weights[a - top, b - left] = FREE
    side = len(stamp)
    for a in range(first_a, end_a):
        for b in range(first_b, end_b):
            if grid[a, b] >= OCCUPIED:
                around = weights[a - top - side // 2 :, b - left - side // 2 :]
                for down in range(side):
                    for along in range(side):
                        around[down, along] = max(around[down, along], stamp[down, along])
    for a in range(first_a, bottom + 1):
        for b in range(first_b, right + 1):
            weights[a - top, b - left] += _VAIN * int(failed_attempts[a, b])
    # Cells off the last path cost more, unless it has led nowhere.
    if not stuck and _is_any(ways):
        for a in range(top, bottom + _PAD + 1):
            for b in range(left, right + _PAD + 1):
                if not (0 <= a < SIDE and 0 <= b < SIDE and ways[a, b] > 0):
                    weights[a - top, b - left] += weights[a - top, b - left] * habit // 16
    ways[:] = 0
    # A closed border, so that the search need not check where rows end.
    weights[0], weights[-1], weights[:, 0], weights[:, -1] = 0, 0, 0, 0
    longest = int(preview / CELL) + 1
    start, end = (i - top) * width + j - left, (goal_i - top) * width + goal_j - left
    costs, following = np.empty(len(cells), np.int64), np.empty(len(cells), np.int64)
    cheapest_way(cells, width, start, end, costs, following)
    way, cell, n = np.empty(longest, np.int64), start, 0
    while cell != end:
        cell = following[cell]
        if n < longest:
            way[n] = cell
            n += 1
        a, b = cell // width + top, cell % width + left
        ways[max(a - 1, 0) : a + 2, max(b - 1, 0) : b + 2] = 1
    # The third cell of a stuck robot's path, and its neighbours, have been tried in vain.
    if stuck and n > 3:
        a, b = way[2] // width + top, way[2] % width + left
        for near_a in range(max(a - 1, 0), min(a + 2, SIDE)):
            for near_b in range(max(b - 1, 0), min(b + 2, SIDE)):
                failed_attempts[near_a, near_b] = min(failed_attempts[near_a, near_b], 99) + 1
    row, column = place[1] / CELL + SIDE // 2 - top, place[0] / CELL + SIDE // 2 - left
    target[0], target[1] = math.nan, math.nan
    # From the farthest cell back, until a straight line costs little more than the path.
    for k in range(n - 1, -1, -1):
        a, b = way[k] // width, way[k] % width
        allowed = detour * (costs[start] - costs[way[k]]) + STRAIGHT * FREE
        if k <= 2 or _line_costs(weights, row, column, a + 0.5, b + 0.5) <= allowed:
            if way[k] != end:
                target[0], target[1] = (b + left - SIDE // 2 + 0.5) * CELL, (a + top - SIDE // 2 + 0.5) * CELL
            break


@in_machine_code("ways of the planner")
def advance(
    grids, failed, ways, scans, reaches, shares, new, places, goals, due, stuck, stamp, preview, detour, unknown, habit, targets
) -> None:
    """Let several robots `see` where ``new`` and `plan` where ``due``."""
    for n in range(len(grids)):
        if new[n]:
            see(grids[n], scans[n], shares[n], reaches[n])
        if due[n]:
            at, to = places[n], goals[n]
            plan(grids[n], failed[n], ways[n], stuck[n], at, to, stamp, preview, detour, unknown, habit, targets[n])


def shifted(grid: NDArray[Any], rows: int, columns: int) -> NDArray[Any]:
    """Return a grid whose middle has moved by rows and columns; cells that come in are unknown."""
    i, j = np.arange(SIDE) + rows, np.arange(SIDE) + columns
    known = ((i >= 0) & (i < SIDE))[:, None] & ((j >= 0) & (j < SIDE))
    return np.where(known, grid[np.clip(i, 0, SIDE - 1)[:, None], np.clip(j, 0, SIDE - 1)], 0)
