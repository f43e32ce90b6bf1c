"""The cheapest path over a grid of cells, A* with a binary heap, as kernels: Hart, Nilsson, Raphael, "A formal basis for the
heuristic determination of minimum cost paths" (1968).
"""

from __future__ import annotations

import numpy as np

from turtlebot_gym.kernel import kernel

FREE = 4
"""Weight of a free cell far from obstacles: the least of all."""
STRAIGHT, DIAGONAL = 5, 7
"""Lengths of the steps, as in `turtlebot_gym.rooms.geodesic`."""


@kernel
def _steps(here: int, there: int, width: int) -> int:
    """Return the length of the shortest path between two cells if all are free, in fifths of a cell."""
    down, along = abs(here // width - there // width), abs(here % width - there % width)
    return STRAIGHT * max(down, along) + (DIAGONAL - STRAIGHT) * min(down, along)


@kernel
def _push(heap, size: int, item: int) -> None:
    """Add an item to the first ``size`` items of a binary heap."""
    at = size
    while at > 0 and heap[(at - 1) // 2] > item:
        heap[at] = heap[(at - 1) // 2]
        at = (at - 1) // 2
    heap[at] = item


@kernel
def _pop(heap, size: int) -> int:
    """Take the least of the first ``size + 1`` items of a binary heap."""
    least, item, at, below = heap[0], heap[size], 0, 1
    while below < size:
        if below + 1 < size and heap[below + 1] < heap[below]:
            below += 1
        if heap[below] >= item:
            break
        heap[at] = heap[below]
        at, below = below, 2 * below + 1
    heap[at] = item
    return least


@kernel
def cheapest_way(weights, width: int, start: int, goal: int, costs, following) -> None:
    """Write the cost from each visited cell to the goal, and the cell that follows it.

    ``weights`` are costs of cells, at least `FREE`, row by row, shape (cells,), int32; 0 for the cells of a closed border.
    ``costs`` and ``following`` are outputs, shape (cells,), int64.
    """
    cells = len(weights)
    costs[:], following[:] = 2**30, goal
    costs[goal] = 0
    queue, queued = np.empty(8 * cells + 1, np.int64), 1  # a cell is left once, to eight neighbours
    queue[0] = FREE * _steps(goal, start, width) * cells + goal  # the least cost first, and then the first cell
    while True:
        queued -= 1
        least = _pop(queue, queued)
        cell = least % cells
        if cell == start:
            return
        cost = costs[cell]
        if least // cells == cost + FREE * _steps(cell, start, width):  # otherwise a cheaper path to it was found since
            for k in range(9):
                neighbour = cell + (k // 3 - 1) * width + k % 3 - 1
                new = cost + (DIAGONAL if k % 2 == 0 else STRAIGHT) * weights[neighbour]
                if weights[neighbour] > 0 and new < costs[neighbour]:
                    costs[neighbour], following[neighbour] = new, cell
                    _push(queue, queued, (new + FREE * _steps(neighbour, start, width)) * cells + neighbour)
                    queued += 1
