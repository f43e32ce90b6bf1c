"""The bank in which a localizer keeps the places that it follows while its own is in doubt."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.descent import APART, TURNED
from turtlebot_gym.localization.localizer import Located
from turtlebot_gym.localization.points import pose_of
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
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
