"""The motions of a drive from row to row, by its truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.angles import wrap_all

Array = NDArray[np.float64]


class Motions(NamedTuple):
    """The n motions from one row of a drive to the next at which the truth is known."""

    row: NDArray[np.intp]
    """Row at which each motion ends, shape (n,)."""
    dt: Array
    """Shape (n,), s."""
    twist: Array
    """Shape (n, 2); m/s, rad/s."""
    step: Array
    """Motion of the truth in the world, shape (n, 3); m, m, rad."""
    heading: Array
    """True heading at the start, shape (n,), rad."""
    follows: NDArray[np.bool_]
    """Whether a motion begins where the one before it ends, shape (n,)."""

    def without(self, left_out: NDArray[np.bool_]) -> Motions:
        """Return the motions that are not left out."""
        kept = ~left_out
        follows = self.follows.copy()
        follows[1:] &= kept[:-1]
        return Motions(self.row[kept], self.dt[kept], self.twist[kept], self.step[kept], self.heading[kept], follows[kept])


def motions_of(drive: Drive) -> Motions:
    """Return the motions of a drive."""
    are_known = known(drive.truth)
    good = np.zeros(len(drive), np.bool_)
    good[1:] = are_known[1:] & are_known[:-1] & drive.joined[1:] & (np.diff(drive.time) > 0.0)
    good &= known(drive.twist)
    row = np.flatnonzero(good)
    step = drive.truth[row] - drive.truth[row - 1]
    step[:, 2] = wrap_all(step[:, 2])
    follows = good[row - 1]
    return Motions(row, drive.time[row] - drive.time[row - 1], drive.twist[row], step, drive.truth[row - 1, 2], follows)
