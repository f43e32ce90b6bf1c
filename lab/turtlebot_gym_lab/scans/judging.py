"""Whether wheels found by scans are better than those assumed: fitted to one half of a drive, and driven over the other."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from turtlebot_gym_lab.scans.calibrating import ByScans
from turtlebot_gym_lab.scans.fit import Array, Motions, compose, errors_of, fit

PIECE = 2.0
"""Way of the pieces at whose ends drift is measured, m ..."""
TURNS = 6.0
"""... or turn that counts as much, rad."""
WORSE = 1.05
"""Ratio to the drift of the wheels as assumed from which those found are worse."""
FEWEST = 6
"""Fewest pairs of a half."""


class HeldOut(NamedTuple):
    """Drift at the ends of pieces of the half that a fit has not seen."""

    before: float
    """Root mean square of the position's error with the wheels as assumed, m ..."""
    after: float
    """... and with those fitted to the other half."""
    pieces: int
    is_good: bool
    """Whether there are pieces, and the wheels found are not worse."""

    @property
    def text(self) -> str:
        """One line for the user."""
        if not self.pieces:
            return "The drive is too short to fit to one half of it and to try the other."
        better = "is" if self.is_good else "is not"
        return (
            f"Fitted to one half and driven over pieces of {PIECE:g} m of the other, odometry drifts by {self.after:.4f} m "
            f"instead of {self.before:.4f} m: it {better} as good or better."
        )


def _part(m: Motions, chosen: slice) -> Motions:
    return m._replace(
        first=m.first[chosen], second=m.second[chosen], motion=m.motion[chosen], information=m.information[chosen]
    )


def _pieces(m: Motions) -> Motions:
    """Return pairs that follow one another joined to pieces."""
    first, second, motions, begin, way = [], [], [], 0, 0.0
    motion: Array = np.zeros(3)
    for k in range(len(m.first)):
        if k > begin and m.first[k] != m.second[k - 1]:
            begin, motion, way = k, np.zeros(3), 0.0
        motion = compose(motion, m.motion[k])
        way += math.hypot(*m.motion[k, :2]) + abs(m.motion[k, 2]) * PIECE / TURNS
        if way >= PIECE:
            first.append(m.first[begin])
            second.append(m.second[k])
            motions.append(motion)
            begin, motion, way = k + 1, np.zeros(3), 0.0
    count = len(first)
    ends = np.array(first, np.int64), np.array(second, np.int64)
    return Motions(m.time, m.odometry, *ends, np.reshape(motions, (count, 3)), np.zeros((count, 3, 3)), m.mount)


def held_out(found: ByScans) -> HeldOut:
    """Return how much the wheels drift, as assumed and as found, where they were not fitted."""
    m, x = found.motions, found.fit.x
    half = len(m.first) // 2
    assumed = np.array([1.0, 1.0, 0.0, *x[3:]])
    before, after, pieces = 0.0, 0.0, 0
    for seen, unseen in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
        joined = _pieces(_part(m, unseen))
        if half < FEWEST or not len(joined.first):
            continue
        fitted = fit(_part(m, seen), x, found.fit.variances, found.determined).x
        before += float((errors_of(joined, assumed)[:, :2] ** 2).sum())
        after += float((errors_of(joined, fitted)[:, :2] ** 2).sum())
        pieces += len(joined.first)
    count = max(pieces, 1)
    before, after = math.sqrt(before / count), math.sqrt(after / count)
    return HeldOut(before, after, pieces, pieces > 0 and after <= WORSE * before)
