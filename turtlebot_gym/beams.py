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

An LDS-01 sends 0 where nothing returned, an LDS-02 NaN where a beam is missing. The number of beams, their increment, its sign
and the first direction may differ from scan to scan, and a scan may cover a part of the circle. It is refused only if it cannot
be read at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

TURN = 2.0 * math.pi
SLACK = 2.5
"""Beams by which a scan may exceed a full turn: drivers count both ends, and the speed of a motor varies within a turn."""
NEAREST, FARTHEST, UNLIMITED = 1.5, 300.0, 1e6
"""Largest range_min, and largest range_max of a LiDAR, m; a larger one than the last is none."""
TOUCHING = 0.001
"""Range of something nearer than a ``range_min`` of 0, m; 0 itself means that nothing returned."""


class Beams(NamedTuple):
    """The beams of a scan."""

    directions: NDArray[np.float64]
    """Directions in the LiDAR's frame, shape (B,), rad; they rise or fall."""
    ranges: NDArray[np.float32]
    """Ranges, shape (B,), m: infinite where nothing returned, NaN where a beam is missing."""
    spacing: float
    """Angle between two beams, rad; positive."""


def beams_of(ranges: ArrayLike, *, first: float, increment: float, range_min: float, range_max: float) -> Beams:
    """Return the beams of a scan.

    Args:
        ranges: As sent, shape (B,), m.
        first: Direction of the first beam in the LiDAR's frame, rad.
        increment: Angle from one beam to the next, rad; negative if clockwise.
        range_min: Least range that the LiDAR measures, m.
        range_max: Greatest range that it measures, m.

    Raises:
        ValueError: With one line, if the scan cannot be read.
    """
    lengths = np.array(ranges, np.float32).reshape(-1)
    if not len(lengths):
        raise ValueError("the scan has no ranges")
    if not math.isfinite(first):
        raise ValueError(f"the scan's angle_min must be finite, got {first:g}")
    if not 0.0 < abs(increment) < math.inf:
        raise ValueError(f"the scan's angle_increment must be finite and not 0, got {increment:g}")
    if (len(lengths) - SLACK) * abs(increment) > TURN:
        raise ValueError(f"the scan's {len(lengths)} beams, {abs(increment):g} rad apart, are more than a whole turn")
    if not 0.0 <= range_min < range_max:
        raise ValueError(f"the scan's range_min must be in [0, range_max), got {range_min:g} and {range_max:g}")
    if range_min > NEAREST or FARTHEST < range_max < UNLIMITED:
        unit = "inches" if 0.0 < range_min < 8.0 else "cm" if 0.0 < range_min < 40.0 or range_max < 3000.0 else "mm"
        raise ValueError(
            f"no LiDAR measures from {range_min:g} to {range_max:g} m: are the scan's range_min and range_max in {unit}? "
            f"They must be in m"
        )
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
        raise ValueError(f"none of the scan's {len(lengths)} beams says anything")
    return Beams(first + increment * np.arange(len(lengths), dtype=np.float64), lengths, abs(increment))


def narrow_gap(radius: float, ahead: float) -> float:
    """Return the angle of a gap that is as wide as a robot at the distance from where it must brake, rad.

    Args:
        radius: The robot's radius, m.
        ahead: The way that it makes and the room that it leaves until it stands, at full speed, m.
    """
    return 2.0 * math.asin(radius / (radius + ahead))


def gaps_of(beams: Beams, widest: float = math.inf) -> NDArray[np.float64]:
    """Return the gaps of a scan: where beams are missing or too far apart, or the LiDAR does not look.

    Args:
        beams: The scan.
        widest: Angle between two beams above which what is between them is a gap too, rad.

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
