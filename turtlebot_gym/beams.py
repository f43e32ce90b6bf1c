"""What each beam of a LiDAR's scan says: defined once, for policies, the collision monitor and recorded drives.

By the definition of ``sensor_msgs/LaserScan`` and ROS's REP 117 each beam is judged by itself:

====================================  ==================================  ==========
range                                 meaning                             becomes
====================================  ==================================  ==========
from ``range_min`` to ``range_max``   measured                            itself
+inf, 0, above ``range_max``          nothing returned: free              +inf
-inf                                  something is nearer than that       range_min
NaN, negative, below ``range_min``    missing: it says nothing            NaN
====================================  ==================================  ==========

The number of beams, their increment, its sign and the first direction may differ from scan to scan, and a scan may cover a part
of the circle. It is refused only if it cannot be read at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

TURN = 2.0 * math.pi
SLACK = 2.5  # beams by which a scan may exceed a full turn: drivers count both ends, and a motor's speed varies
NEAREST, FARTHEST, UNLIMITED = 1.5, 300.0, 1e6  # largest range_min and range_max, m; a larger one than the last is none
TOUCHING = 0.001  # range of something nearer than a ``range_min`` of 0, m; 0 itself means that nothing returned


class Beams(NamedTuple):
    """The beams of a scan."""

    directions: NDArray[np.float64]
    """Directions in the LiDAR's frame, shape (B,), rad; they rise or fall."""
    ranges: NDArray[np.float32]
    """Ranges, shape (B,), m: infinite where nothing returned, NaN where a beam is missing."""
    spacing: float
    """Angle between two beams, rad; positive."""


def beams_of(ranges: ArrayLike, *, first: float, increment: float, range_min: float, range_max: float) -> Beams:
    """Return the beams of a scan, by the fields of its ``sensor_msgs/LaserScan``; a ``ValueError`` says why none can be."""
    lengths = np.array(ranges, np.float32).reshape(-1)
    number, step = len(lengths), abs(increment)
    unit = "inches" if 0.0 < range_min < 8.0 else "cm" if 0.0 < range_min < 40.0 or range_max < 3000.0 else "mm"
    limits = f"{range_min:g} to {range_max:g} m"
    for holds, rule in (
        (number > 0, "the scan has no ranges"),
        (math.isfinite(first), f"the scan's angle_min must be finite, got {first:g}"),
        (0.0 < step < math.inf, f"the scan's angle_increment must be finite and not 0, got {increment:g}"),
        ((number - SLACK) * step <= TURN, f"the scan's {number} beams, {step:g} rad apart, are more than a whole turn"),
        (0.0 <= range_min < range_max, f"the scan's range_min must be in [0, range_max), got {limits}"),
        (
            range_min <= NEAREST and not FARTHEST < range_max < UNLIMITED,
            f"no LiDAR measures from {limits}: are the scan's range_min and range_max in {unit}? They must be in m",
        ),
    ):
        if not holds:
            raise ValueError(rule)
    least, most = np.float32(range_min), np.float32(range_max)
    lengths[lengths == -np.inf] = max(least, np.float32(TOUCHING))
    finite = np.unique(lengths[np.isfinite(lengths) & (lengths > 0.0)])
    beyond, far = (finite > share * min(range_max, FARTHEST / share) for share in (1.5, 10.0))
    if far.sum() > 2 or (beyond.sum() > 2 and not ((finite >= least) & (finite <= most)).any()):
        # A single number may be a driver's sign for nothing.
        raise ValueError(f"the scan's ranges reach {finite[-1]:g} m, not {range_max:g} m: are they in mm, cm or inches?")
    free = (lengths > most) | (lengths == 0.0)
    lengths[~(lengths >= least) & ~free] = np.nan  # also NaN itself
    lengths[free] = np.inf
    if np.isnan(lengths).all():
        raise ValueError(f"none of the scan's {number} beams says anything")
    return Beams(first + increment * np.arange(number, dtype=np.float64), lengths, step)


def narrow_gap(radius: float, ahead: float) -> float:
    """Return the angle of a gap as wide as a robot, of a radius, at the distance ``ahead`` in which it stops; m, rad."""
    return 2.0 * math.asin(radius / (radius + ahead))


def gaps_of(beams: Beams, widest: float = math.inf) -> NDArray[np.float64]:
    """Return the gaps of a scan: where beams are missing or farther apart than ``widest``, rad, or the LiDAR does not look.

    Returns:
        Shape (n, 4): the direction of the first and of the last missing beam, counter-clockwise from one to the other, the
        angle between the beams around them, rad, and the shorter of these beams' ranges, m.
    """
    present = np.flatnonzero(~np.isnan(beams.ranges))
    around = beams.directions[present] % TURN
    order = np.argsort(around, kind="stable")
    around, ranges = around[order], beams.ranges[present][order].astype(np.float64)
    widths = np.diff(around, append=around[0] + TURN)
    at = np.flatnonzero(widths > min(1.5 * beams.spacing, widest))
    inside = np.minimum(min(beams.spacing, 0.5 * widest), 0.5 * widths[at])
    shorter = np.minimum(ranges, np.roll(ranges, -1))[at]
    return np.stack((around[at] + inside, around[at] + widths[at] - inside, widths[at], shorter), axis=1)
