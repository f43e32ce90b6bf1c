"""Ranges pooled for a policy: the shortest in each sector around the robot, in the step and for scans of any LiDAR."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose

NARROW = 2
"""Most neighbouring sectors without a beam that take the range beside them: 20 degrees at 0.4 m, from where a Burger at full
speed stops, are narrower than the robot."""
NEAR = 1.0
"""Greatest range of more of them, m. A blind sector is unknown, never free; but shorter ranges look like a wall that was not
there in training: of five choices `ppo-rooms` collided least with this one when it was blind to the back."""
EDGE = 1e-5
"""Share of a sector by which a beam on its edge may miss it: directions travel in single precision."""
_NEAREST, _FARTHEST = np.float32(0.0), np.float32(SIGHT)
UNKNOWN = -1.0
"""Marks a sector without data, until it is filled."""


@kernel
def divide(spans, beams, first_angle: float, number: int) -> None:
    """Assign the beams of a scan to the sectors of a policy; a sector without a beam takes the one nearest to its middle.

    Beams, by `lidar.aim`, are evenly spaced counter-clockwise from ``first_angle`` in the robot's frame, rad. ``spans``, shape
    (`SECTORS`, 2), receives each sector's first beam, from -number on, and the one after its last; the same twice for a sector
    in which all beams are blind, which is thus unknown.
    """
    for sector in range(SECTORS):
        turns = sector / SECTORS - first_angle / TWO_PI
        middle = (turns - math.floor(turns)) * number
        first = math.ceil(middle - 0.5 * number / SECTORS - 1e-9)
        last = math.ceil(middle + 0.5 * number / SECTORS - 1e-9)
        first = first if last > first else math.floor(middle + 0.5)
        last = max(last, first + 1)
        around = number if last > number else 0
        sees = False
        for beam in range(first - around, last - around):
            sees = sees | (beams[2, beam if beam >= 0 else beam + number] < math.inf)
        spans[sector, 0], spans[sector, 1] = first - around, last - around if sees else first - around


@kernel
def _fill(sectors) -> None:
    """Fill the `UNKNOWN` sectors, of which one at least must be known.

    Each takes the shorter of the ranges beside its run of unknown sectors; in a run of more than `NARROW` at most `NEAR`.
    """
    known = sectors.copy()
    for sector in range(SECTORS):
        if known[sector] < 0.0:
            right, left = 1, 1
            while known[(sector - right) % SECTORS] < 0.0 and right < SECTORS:
                right += 1
            while known[(sector + left) % SECTORS] < 0.0 and left < SECTORS:
                left += 1
            beside = min(known[(sector - right) % SECTORS], known[(sector + left) % SECTORS])
            sectors[sector] = beside if right + left - 1 <= NARROW else min(beside, np.float32(NEAR / SIGHT))


@kernel
def pool(ranges, spans, beams: int, sectors) -> None:
    """Pool the first ``beams`` ranges, m, into the sectors of a policy: the shortest in each, as a share of `SIGHT`.

    NaN, negative and infinite ranges count as free, sectors without beams in ``spans``, see `divide`, as unknown, see `_fill`.
    """
    unknown = 0
    for sector in range(SECTORS):
        shortest = _FARTHEST  # in single precision, as ranges are: each conversion would take as long as the comparison
        for beam in range(spans[sector, 0], spans[sector, 1]):
            length = ranges[beam if beam >= 0 else beam + beams]
            length = length if length >= _NEAREST else _FARTHEST
            shortest = length if length < shortest else shortest  # alone in the chain from beam to beam: one instruction
        sectors[sector] = np.float32(float(shortest) / SIGHT)
        if spans[sector, 1] <= spans[sector, 0]:
            sectors[sector] = np.float32(UNKNOWN)
            unknown += 1
    if unknown > 0:
        _fill(sectors)


class Pooling:
    """Pools scans into the sectors of a policy, as the environment does.

    Each beam counts where it points, so the number of beams, their increment and its sign may differ from scan to scan. Sectors
    without a beam are unknown, see `_fill`.

    Args:
        yaw: Direction of the LiDAR's frame in the robot's frame, rad.
        beams: Number of beams that a scan must have; 0 for any.
    """

    def __init__(self, *, yaw: float = 0.0, beams: int = 0) -> None:
        self._yaw, self._beams = yaw, beams
        self.seen: NDArray[np.float64] | None = None
        """Ranges of the last scan by sector, shape (`SECTORS`,), m; 0 in runs of more than `NARROW` sectors without a beam."""

    def __call__(self, scan: Scan, mount: Pose | None = None) -> list[float]:
        """Return the shortest range in each sector, as shares of `lidar.SIGHT`; refuse another number of beams than ``beams``.

        Args:
            scan: The scan.
            mount: Pose of its frame in a frame that is level with the robot's, at the place from which the policy is to see;
                None for that place, turned by ``yaw``.
        """
        beams = len(scan.ranges)
        if self._beams not in (0, beams):
            raise ValueError(f"the scan has {beams} beams, but lidar_beams says {self._beams}")
        measured = np.flatnonzero(~np.isnan(scan.ranges))
        ranges = scan.ranges[measured]
        directions = (mount.theta if mount else self._yaw) + scan.first + scan.increment * measured
        if mount and (mount.x or mount.y):
            returned = np.isfinite(ranges)
            points = mount.x + 1j * mount.y + np.where(returned, ranges, 0.0) * np.exp(1j * directions)
            ranges, directions = np.where(returned, abs(points), ranges), np.where(returned, np.angle(points), directions)
        at = np.floor(directions / TWO_PI * SECTORS + 0.5 + EDGE).astype(np.int64) % SECTORS
        shortest = np.full(SECTORS, np.inf)
        np.minimum.at(shortest, at, ranges)
        sectors = (np.minimum(shortest, SIGHT) / SIGHT).astype(np.float32)
        unknown = np.bincount(at, minlength=SECTORS) == 0
        sectors[unknown] = UNKNOWN
        _fill(sectors)
        self.seen = SIGHT * sectors.astype(np.float64)
        if unknown.any():
            inner = unknown & np.roll(unknown, 1) & np.roll(unknown, -1)  # not at the edge of its run, which is thus not narrow
            self.seen[inner | np.roll(inner, 1) | np.roll(inner, -1)] = 0.0
        return sectors.tolist()
