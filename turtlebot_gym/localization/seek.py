"""Search of the whole map for a scan's pose, for a robot that is lost or does not know where it starts.

Each free place of a lattice is tried in each direction, a beam at a time for all places at once. Of many beams a part is tried
first, and the others only at places that fit it nearly as well as the best so far.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from turtlebot_gym.kernel import in_loops, kernel
from turtlebot_gym.localization.descent import WIDTH, keep
from turtlebot_gym.localization.information import ScanPoints
from turtlebot_gym.localization.points import X, Y
from turtlebot_gym.models.angles import TWO_PI, sincos, wrap
from turtlebot_gym.rooms.field import at_cell

SPACING, DIRECTIONS = 0.2, 72
"""Distance between two places, m, and number of directions: a beam still ends within `WIDTH` of the surface that it hit."""
CLEARANCE = 0.1  # least distance of a place from a surface, m
MANY, PART, NEARLY = 40, 3, 0.2
"""Number of beams from which on one of so many is tried first, and by how much less a place may then agree than the last of the
best."""
APART, TURNED = 0.5, 0.35  # distance and turn from which on two poses are different hypotheses; m, rad


def _rate_each(row, agrees):
    for k in range(len(row)):
        d = 1.0 * row[k] / WIDTH
        agrees[k] = 1.0 / (1.0 + d * d) if d == d else 0.0


@in_loops(_rate_each)
def _rate(row: Any, agrees: Any) -> None:
    """Write how well an end in each cell of a row agrees with its distance, shape (n,), see `descent.agreement`."""
    d = row.astype(np.float64) / WIDTH
    agrees[:] = np.where(np.isnan(d), 0.0, 1.0 / (1.0 + d * d))


def _add_each(total, column, row, x, y, agrees):
    rows, columns = agrees.shape
    for k in range(len(total)):
        j, i = min(max(column[k] + x, 0.0), columns - 1.0), min(max(row[k] + y, 0.0), rows - 1.0)
        total[k] += agrees[int(i), int(j)]


@in_loops(_add_each)
def _add(total: Any, column: Any, row: Any, x: float, y: float, agrees: Any) -> None:
    """Add to each place's total, shape (n,), how well a beam agrees that ends so many columns and rows from it."""
    rows, columns = agrees.shape
    j, i = np.clip(column + x, 0.0, columns - 1.0).astype(np.int64), np.clip(row + y, 0.0, rows - 1.0).astype(np.int64)
    total += agrees.ravel()[i * columns + j]


def _select_each(total, least, column, row, out):
    number = 0
    for k in range(len(total)):
        out[0, number], out[1, number], out[2, number] = total[k], column[k], row[k]
        number += 1 if total[k] >= least else 0
    return number


@in_loops(_select_each)
def _select(total: Any, least: float, column: Any, row: Any, out: Any) -> int:
    """Write total, column and row of the places whose total is at least so much, shape (3, n or more); return their number."""
    chosen = np.flatnonzero(total >= least)
    out[:, : len(chosen)] = total[chosen], column[chosen], row[chosen]
    return len(chosen)


@kernel
def seek(sight: ScanPoints, poses: Any, values: Any) -> int:
    """Write the poses of a map that fit a scan best, best first and each another hypothesis, and return their number.

    ``poses`` has shape (K, 3): x, y and heading; m, m, rad; ``values`` shape (K,): their agreement, see `descent.agreement`.
    """
    field, frame, points, number = sight
    rows, columns = field.shape
    side, yaw, places, count = float(frame[4]), math.atan2(float(frame[3]), float(frame[2])), 0, 0
    step = max(int(SPACING / side), 1)
    agrees = np.zeros((rows + 2, columns + 2))  # a border of cells, and the unknown, agree with nothing
    for i in range(rows):
        _rate(field[i], agrees[i + 1, 1 : columns + 1])
    column, row = np.empty((rows // step + 1) * (columns // step + 1)), np.empty((rows // step + 1) * (columns // step + 1))
    for i in range(0, rows, step):
        for j in range(0, columns, step):
            if at_cell(field, i, j) > CLEARANCE:
                column[places], row[places] = j + 0.5, i + 0.5
                places += 1
    column, row, chosen = column[:places], row[:places], np.empty((3, places + 1))
    part = PART if number >= MANY else 1
    for direction in range(DIRECTIONS):
        theta = TWO_PI * direction / DIRECTIONS
        sine, cosine = sincos(theta)
        total, tried = np.zeros(places), -(-number // part)
        for k in range(0, number, part):
            x, y = float(points[X, k]) / side, float(points[Y, k]) / side
            _add(total, column, row, cosine * x - sine * y + 1.0, sine * x + cosine * y + 1.0, agrees)
        least = (float(values[count - 1]) - NEARLY) * tried if count == len(poses) and part > 1 else -1.0
        some = _select(total, least, column, row, chosen)
        for k in range(number if part > 1 else 0):
            if k % part != 0:
                x, y = float(points[X, k]) / side, float(points[Y, k]) / side
                x, y = cosine * x - sine * y + 1.0, sine * x + cosine * y + 1.0
                _add(chosen[0, :some], chosen[1, :some], chosen[2, :some], x, y, agrees)
        for at in range(some):
            value = float(chosen[0, at]) / max(number, 1)
            if count < len(poses) or value > values[count - 1]:
                along, up = float(chosen[1, at]) * side, float(chosen[2, at]) * side
                x = float(frame[0]) + along * float(frame[2]) - up * float(frame[3])
                y = float(frame[1]) + along * float(frame[3]) + up * float(frame[2])
                count = keep(poses, values, count, (x, y, wrap(theta + yaw)), value, APART, TURNED)
    return count
