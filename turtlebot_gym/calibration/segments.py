"""Segments of a drive whose true poses are known: where the wheels are begun anew at the truth, and then held against it.

Row by row the likelihood is the environment's own. Real wheels' errors are alike from row to row, and add up faster than white
noise does: over longer segments, from end to end, white noise stands for what is left of them after that distance.
"""

from __future__ import annotations

import numpy as np

from turtlebot_gym.calibration.likelihood import Rows
from turtlebot_gym.calibration.log import Log, known

LEVER = 0.2
"""Distance that turning by 1 rad counts as, m: segments end when a robot turns on the spot, too."""


def segment_rows(log: Log, length: float) -> Rows:
    """Return a log's true poses at the ends of segments, at each of which the wheels are begun anew.

    Args:
        log: With truth.
        length: Of the segments, m by the twist, of which a turn by 1 rad counts `LEVER`; 0 for every row.
    """
    there = known(log.truth)
    truth = np.where(there[:, None], log.truth, 0.0)
    # by the twist: where segments end must not depend on the errors
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
    """Return how many segments there are."""
    running, found = False, 0
    for due, joined in zip(rows.due.tolist(), rows.joined.tolist(), strict=True):
        running = running and joined
        found += bool(due and running)
        running = running or due
    return found
