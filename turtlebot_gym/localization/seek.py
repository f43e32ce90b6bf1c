"""The whole map: where a scan fits best, for a robot that is lost or does not know where it starts.

Each free place of a lattice is tried in each direction. All places are looked up at once, beam by beam, in whole arrays, which
a robot without numba can do too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.around import WIDTH, keep
from turtlebot_gym.localization.localizer import LEAST_BEAMS, Located, locate, scan
from turtlebot_gym.localization.points import X, Y
from turtlebot_gym.models.angles import TWO_PI, sincos, wrap
from turtlebot_gym.values import Belief, Pose, State

SPACING, DIRECTIONS = 0.2, 72
"""Distance between two places, m, and number of directions: a beam still ends within `WIDTH` of the surface that it hit."""
CLEARANCE = 0.1
"""Least distance of a place from a surface, m."""
APART, TURNED = 0.5, 0.35
"""Distance and turn from which on two poses are different hypotheses; m, rad."""
DEVIATIONS = (0.15, 0.1)
"""Standard deviations of a pose that was found, m and rad: the next scan descends from there."""
HYPOTHESES = 16
RETRY = 4.0
"""Scans from one search of the whole map to the next."""
FAR = 1e4
"""Variance of a pose of which nothing is known, m^2 and rad^2."""
MARGIN = 0.05
"""By how much the best pose's agreement must exceed that of any other: otherwise the robot does not know which it is."""


@kernel
def seek(field: Any, frame: Any, points: Any, number: int, poses: Any, values: Any) -> int:
    """Write the poses of a map that fit a scan best, best first and each another hypothesis, and return their number.

    Args:
        field: Distances, see `rooms.field`.
        frame: Their frame.
        points: The scan, see `points.to_points`.
        number: Number of points.
        poses: Output, shape (K, 3): x, y and heading; m, m, rad.
        values: Output, shape (K,): their agreement, see `around.agreement`, from 0 to 1.
    """
    rows, columns = field.shape
    side, step, width, yaw = float(frame[4]), max(int(SPACING / frame[4]), 1), columns + 2, math.atan2(frame[3], frame[2])
    # A border of cells, and the unknown, agree with nothing.
    agrees, inner = np.zeros((rows + 2, width)), field.astype(np.float64) / WIDTH
    agrees[1:-1, 1:-1] = np.where(np.isnan(inner), 0.0, 1.0 / (1.0 + inner * inner))
    worth = agrees.ravel()
    lattice = field[::step, ::step].copy()
    across = lattice.shape[1]
    free = np.flatnonzero(lattice.ravel() > CLEARANCE)
    column, row, count = (free % across) * step + 0.5, (free // across) * step + 0.5, 0
    for direction in range(DIRECTIONS):
        theta = TWO_PI * direction / DIRECTIONS
        sine, cosine = sincos(theta)
        total = np.zeros(len(free))
        for k in range(number):
            x, y = points[X, k] / side, points[Y, k] / side
            j = np.minimum(np.maximum(column + (cosine * x - sine * y + 1.0), 0.0), columns + 1.0).astype(np.int64)
            i = np.minimum(np.maximum(row + (sine * x + cosine * y + 1.0), 0.0), rows + 1.0).astype(np.int64)
            total += worth[i * width + j]
        total /= max(number, 1)
        least = values[count - 1] if count == len(poses) else -1.0
        for at in np.flatnonzero(total > least):
            along, up = column[at] * side, row[at] * side
            pose = (
                frame[0] + along * frame[2] - up * frame[3], frame[1] + along * frame[3] + up * frame[2],
                wrap(theta + yaw),
            )  # fmt: skip
            count = keep(poses, values, count, pose, total[at], APART, TURNED)
    return count


@kernel
def recover(located: Located, field: Any, frame: Any, points: Any, number: int, q: Any) -> Located:
    """Return a lost robot at the one pose of the map that explains a scan; as lost as before where there is none, or several.

    Args:
        located: The localizer.
        field: Distances, see `rooms.field`.
        frame: Their frame.
        points: The scan, see `points.to_points`.
        number: Number of points.
        q: A `LocalizerTuning`.
    """
    poses, values = np.empty((HYPOTHESES, 3)), np.zeros(HYPOTHESES)
    count = seek(field, frame, points, number, poses, values)
    best, second = float(values[0]), float(values[1]) if count > 1 else 0.0
    if count == 0 or best < q.doubt or best < second + MARGIN:
        return located
    mean, (position, turn) = located.belief.mean, DEVIATIONS
    pose, R = Pose(float(poses[0, 0]), float(poses[0, 1]), float(poses[0, 2])), position * position
    new = locate(pose, (R, R, turn * turn), q)
    belief = Belief(State(pose.x, pose.y, pose.theta, mean.v, mean.omega), new.belief.covariance)
    return Located(belief, 0.0, new.scale, best, 0.0, 0.0, 1.0, located.scans + 1.0, located.moves)


@kernel
def look(located: Located, field: Any, frame: Any, points: Any, number: int, q: Any) -> Located:
    """Condition the belief on a scan; a lost robot looks for it in the whole map instead, every `RETRY` scans.

    Args:
        located: The localizer.
        field: Distances, see `rooms.field`.
        frame: Their frame.
        points: The scan, see `points.to_points`, as seen from the present pose.
        number: Number of points.
        q: A `LocalizerTuning`.
    """
    if located.misfits < q.patience:
        return scan(located, field, frame, points, number, q)
    if number >= LEAST_BEAMS and (located.misfits - q.patience) % RETRY == 0.0:
        other = recover(located, field, frame, points, number, q)
        if other.misfits == 0.0:
            return other
    belief, nis, scale, fits, misfits, taken, slack, scans, moves = located
    return Located(belief, nis, scale, fits, misfits + 1.0, taken, slack, scans + 1.0, moves)


@kernel
def nowhere(pose: Pose, q: Any) -> Located:
    """Return a localizer that does not know where it starts: the first scan is sought in the whole map."""
    belief, nis, scale, _, _, taken, slack, scans, moves = locate(pose, (FAR, FAR, FAR), q)
    return Located(belief, nis, scale, 0.0, 1.0 * q.patience, taken, slack, scans, moves)
