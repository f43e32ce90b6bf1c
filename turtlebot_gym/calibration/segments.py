"""Segments of a drive with truth: wheel odometry restarts at the true pose of each start, and is compared with it at the end.

Row by row, the likelihood is the environment's own. Errors of real wheels are correlated from row to row and add up
faster than white noise. Over longer segments, from end to end, white noise represents the error that is left after that
distance.
"""

from __future__ import annotations

import numpy as np

from turtlebot_gym.calibration.likelihood import Rows
from turtlebot_gym.calibration.log import Log, known

LEVER = 0.2
"""Distance as which a turn by 1 rad counts, m, so that segments also end while a robot turns on the spot."""


def segment_rows(log: Log, length: float) -> Rows:
    """Return a log's true poses at the ends of segments; wheel odometry restarts at each.

    Args:
        log: With truth.
        length: Length of the segments by the twist, m, where a turn by 1 rad counts as `LEVER`; 0 for every row.
    """
    there = known(log.truth)
    truth = np.where(there[:, None], log.truth, 0.0)
    # by the twist: the ends of segments must not depend on the errors
    motion = np.abs(log.twist[1:]) @ np.array([1.0, LEVER]) * np.diff(log.time)
    driven = np.concatenate([[0.0], np.cumsum(motion)])
    ends = there.copy()
    if length > 0.0:
        ends[:] = False
        reached, running = -np.inf, False
        for row in range(len(driven)):
            running = running and bool(log.joined[row])
            if there[row] and (not running or driven[row] >= reached):
                ends[row], running, reached = True, True, driven[row] + length
    return Rows(log.time, log.twist, truth, ends, ends.copy(), log.joined)


def count(rows: Rows) -> int:
    """Return the number of segments."""
    running, found = False, 0
    for due, joined in zip(rows.due.tolist(), rows.joined.tolist(), strict=True):
        running = running and joined
        found += bool(due and running)
        running = running or due
    return found
