"""The places at which a lost robot may be: the search of the whole map for its scan, and the bank that keeps what it found.

Each free place of a lattice is tried in each direction, a beam at a time for all places at once. Of many beams a part is tried
first, and the others only at places that fit it nearly as well as the best so far. A localizer follows the best places in its
bank while its own is in doubt.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import in_loops, kernel
from turtlebot_gym.localization.descent import APART, TURNED, WIDTH, keep
from turtlebot_gym.localization.information import ScanPoints
from turtlebot_gym.localization.localizer import Located
from turtlebot_gym.localization.points import X, Y, pose_of
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import TWO_PI, sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.rooms.field import at_cell
from turtlebot_gym.values import Pose

MOST = 16  # most hypotheses
LAST, RIGHT, OFF = MOST + 1, 4, 5
"""Row of a bank with the position of the odometry at the last scan; whether the last search found only places that look alike;
and in columns of their own whether the last scan that says anything about the belief agrees, beams in the unknown then do, too;
and the evidence, in scans, that has come since the belief has left the map, 0 for one that has not."""
TRIAL = MOST + 2
"""Row of a bank with the evidence, in scans, for which a place that is believed anew is on trial yet; the share of beams that
usually fit where the robot is right; and that of the last scans."""
ROWS, COLUMNS = MOST + 3, 7
"""Rows and columns of a bank of hypotheses, see `LOG_WEIGHT`."""
UNLIKELY = -10.0  # logarithm of a weight, relative to the best, below which a hypothesis is dropped
NONE = -1e300  # logarithm of the weight where there is no hypothesis
MEMORY = 10.0  # scans over which the share of agreeing beams of a hypothesis is averaged
LOG_WEIGHT, AGREES, AGE, FITS = 3, 4, 5, 6
"""Columns of a bank of hypotheses, shape (`ROWS`, `COLUMNS`): x, y and heading of the odometry's origin in the map; the
logarithm of the weight, of which the best is 0; the mean share of agreeing beams; the evidence since it was found, in scans;
the mean share of fitting beams. In row `MOST` those of a belief in doubt; and the share of fitting beams that another place
needs, and the sums since the search of what the belief and the best other place leave unexplained."""
SPACING, DIRECTIONS = 0.2, 72
"""Distance between two places, m, and number of directions: a beam still ends within `WIDTH` of the surface that it hit."""
CLEARANCE = 0.1  # least distance of a place from a surface, m
MANY, PART, NEARLY = 40, 3, 0.2
"""Number of beams from which on one of so many is tried first, and by how much less a place may then agree than the last of the
best."""
FAR_APART, FAR_TURNED = 0.5, 0.35  # distance and turn from which on two poses are different hypotheses; m, rad


@kernel
def exp(x: float) -> float:
    """Return the exponential of a number from `UNLIKELY` to 0, to 5 %: by products, the same compiled and plain."""
    y = 1.0 + x / 1024.0
    for _ in range(10):
        y = y * y
    return y


@kernel
def put(bank: Any, k: int, pose: Pose, wheels: Pose, log_weight: float, agrees: float, age: float) -> None:
    """Write a hypothesis at which the odometry is ``wheels`` into a bank."""
    seat = increment(pose, wheels, Pose(0.0, 0.0, 0.0), sincos(pose.theta - wheels.theta))
    bank[k, 0], bank[k, 1], bank[k, 2], bank[k, LOG_WEIGHT] = seat.x, seat.y, seat.theta, log_weight
    bank[k, AGREES], bank[k, AGE] = agrees, age


@kernel
def place(bank: Any, k: int, wheels: Pose) -> Pose:
    """Return where a hypothesis is now."""
    seat = pose_of(bank[k])
    return increment(seat, Pose(0.0, 0.0, 0.0), wheels, sincos(seat.theta))


@kernel
def insert(bank: Any, pose: Pose, wheels: Pose, log_weight: float) -> None:
    """Put a pose into a bank in the place of the least likely one, unless that is likelier, or it is there."""
    slot, least = 0, log_weight
    for k in range(MOST):
        if bank[k, LOG_WEIGHT] > NONE:
            there = place(bank, k, wheels)
            dx, dy = there.x - pose.x, there.y - pose.y
            if dx * dx + dy * dy < APART * APART and abs(wrap(there.theta - pose.theta)) < TURNED:
                return
        if bank[k, LOG_WEIGHT] < least:
            slot, least = k, float(bank[k, LOG_WEIGHT])
    if least < log_weight:
        put(bank, slot, pose, wheels, log_weight, 0.0, 0.0)


@kernel
def averaged(mean: float, age: float, value: float) -> float:
    """Return a mean over some scans with that of one more."""
    return mean + (value - mean) / min(age + 1.0, MEMORY)


def followed(located: Located, bank: NDArray[np.float64], wheels: Pose, q: LocalizerTuning) -> NDArray[np.float64]:
    """Return the other places that a localizer follows: x, y, heading and share of the weight, shape (0 to `MOST`, 4).

    There are none while it does not doubt its belief; ``wheels`` is the odometry at the present pose.
    """
    chosen = np.flatnonzero(bank[:MOST, LOG_WEIGHT] > NONE) if located.misfits > q.patience else np.empty(0, np.int64)
    places = np.array([place(bank, k, wheels) for k in chosen.tolist()]).reshape(-1, 3)
    weights = np.exp(bank[chosen, LOG_WEIGHT])
    return np.column_stack((places, weights / (weights.sum() + np.exp(bank[MOST, LOG_WEIGHT]))))


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
        for j in range(columns):
            d = at_cell(field, i, j) / WIDTH
            agrees[i + 1, j + 1] = 1.0 / (1.0 + d * d) if d == d else 0.0
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
                count = keep(poses, values, count, (x, y, wrap(theta + yaw)), value, FAR_APART, FAR_TURNED)
    return count
