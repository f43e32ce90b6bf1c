"""Which beams without a return say "free": those of a run that does not contradict what was seen before.

"Nothing returned" is sent for free space, and for a beam that is covered, dirty or dead. So a run of such beams in which a
robot could not pass unseen is *unknown* in three cases:

* **Vanished.** Near surfaces that the last scan showed in it are gone at once, over more than the angle that hides a robot.
  Somebody who steps away from beside the robot looks like that, too. The run is free again when its edges move as still
  surfaces do: the edges of a cover keep their directions. The robot may turn, and look.
* **Kept.** One of its edges, nearer than the LiDAR's reach, has kept its direction although a still surface there would have
  left it by `LEFT`.
* **Proved.** Its beams were unknown by an edge, and have not returned anything in `HEALED` scans in a row since.

A cover whose edges show nothing within the reach cannot be told from a hall. A surface that only returns what hits it steeply
(glass, black gloss), and somebody who walks beside the robot in a hall, cannot be told from a cover: there the robot stops.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import TURN, Beams

SHARE, FARTHEST = 0.8, 6.0  # share of ``range_max``, and range, m, from which an edge may be that of the LiDAR's reach
KEPT, LEFT = 0.035, 0.25  # angle within which an edge keeps its direction, and by which a still surface would have left it, rad
SCANS = 6  # least number of scans in which it has kept it
HEALED = 10  # scans in a row in which an unknown direction must return something
AT_LIMIT = 0.99  # share of ``range_max`` from which a range says that nothing returned
TIGHT, LOOSE, FEW, BINS = 0.9, 1.5, 100, 360
"""Directions that are told apart, as a share of the beams around; beams for each from which more are told apart; most of which
each single one counts; and most that are told apart."""

Mount = tuple[float, float, float]  # pose of a LiDAR on its robot, or of a robot; m, m, rad
Place = tuple[complex, complex]  # place of a LiDAR, m, and its direction, a unit vector


class _Edge(NamedTuple):
    """An edge of a silent run, as it was when it was first seen, in the LiDAR's frame."""

    side: int  # 1 if the run is to the left of it, -1 if to the right
    direction: float
    point: complex
    origins: tuple[Place, Place]  # where the LiDAR may have been then
    scans: int  # number of scans in which it has kept its direction


class Silence:
    """Judge beams without a return by earlier scans; a run up to the angle ``narrow``, rad, hides nothing."""

    def __init__(self, narrow: float) -> None:
        self._narrow = narrow
        self.forget()

    def forget(self) -> None:
        """Forget what was learned."""
        self._count, self._edges = 0, list[_Edge]()
        self._near, self._origins = np.zeros(0, np.complex128), ((0j, 1 + 0j), (0j, 1 + 0j))
        self.covered = 0.0
        """Angle of the last scan over which the LiDAR is covered, by what it has kept or proved, rad."""

    def hear(self, beams: Beams, range_max: float, places: tuple[Place, Place]) -> Beams:
        """Return a scan in which unknown beams are missing.

        ``places`` are where the LiDAR was at the latest and at the earliest time at which the scan may have been measured.
        """
        around = TURN / beams.spacing
        if not (self._count <= around and (self._count == BINS or around < LOOSE * self._count)):  # drivers vary it a little
            self.forget()
            self._count = count = min(max(int(TIGHT * around), 1), BINS)
            self._doubt, self._suspect = np.zeros(count, np.int64), np.zeros(count, np.bool_)
        count, step = self._count, TURN / self._count
        at = np.round(beams.directions / step).astype(np.int64) % count
        nearest, silent, gone = np.full(count, np.inf), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        measured = beams.ranges < AT_LIMIT * range_max
        np.minimum.at(nearest, at[measured], beams.ranges[measured])
        silent[at[~np.isnan(beams.ranges)]] = True
        returned, reach = np.isfinite(nearest), min(SHARE * range_max, FARTHEST)
        silent, near, origins = silent & ~returned, nearest < reach, zip(self._origins, places, strict=True)
        vanished = np.logical_and.reduce([_covers(_seen(self._near, before, now), count) for before, now in origins])
        for run in _runs(~(vanished & silent), self._narrow / step):
            gone[run] = True
        edges = []
        for run in _runs(returned, self._narrow / step):
            self._suspect[run] |= bool(gone[run].any())
            evidence, stays, left = 0.0, 0, []  # angles by which a still surface would have left the edges
            for side, first in ((1, int(run[0])), (-1, int(run[-1]))):
                at_edge = (first - side) % count
                if not (returned[at_edge] and silent[first]):
                    continue  # beyond where the LiDAR looks, the edge is its own
                point = cmath.rect(float(nearest[at_edge]), at_edge * step)
                edge, moved = self._follow(_Edge(side, at_edge * step, point, places, 1), max(KEPT, 1.5 * step))
                edges.append(edge)
                left.append(moved)
                is_kept = edge.scans >= SCANS and near[at_edge] and abs(edge.point) < reach
                evidence += moved if is_kept else 0.0
                stays += edge.scans > 1
            if evidence >= max(LEFT, 4.0 * step):
                self._doubt[run] = HEALED
            if left and max(left) < 0.0:
                self._suspect[run] = False
            if left and min(left) < 0.0 and stays == 0:
                self._doubt[run] = 0
        self._edges = edges
        self._near, self._origins = nearest[near] * np.exp(1j * step * np.flatnonzero(near)), places
        self._doubt[returned] = np.maximum(self._doubt[returned] - 1, 0)
        self._doubt[silent & (self._doubt > 0)] = HEALED
        self._suspect[returned] = False
        self.covered = step * int((silent & (self._doubt > 0)).sum())
        unknown = (silent & (self._suspect | (self._doubt > 0)))[at] & ~measured
        return beams._replace(ranges=np.where(unknown, np.float32(np.nan), beams.ranges)) if unknown.any() else beams

    def _follow(self, new: _Edge, kept: float) -> tuple[_Edge, float]:
        """Return an edge with its history, and the angle by which a still surface would have left it, rad; -1 if it did."""
        for old in self._edges:
            if old.side != new.side:
                continue
            seen = [_seen(old.point, before, now) for before, now in zip(old.origins, new.origins, strict=True)]
            moves = [cmath.phase(point * cmath.rect(1.0, -old.direction)) for point in seen]
            turn = math.remainder(new.direction - old.direction, TURN)
            if abs(turn) <= kept:
                return old._replace(scans=old.scans + 1), min(map(abs, moves)) if moves[0] * moves[1] > 0.0 else 0.0
            if min(moves) - kept <= turn <= max(moves) + kept:
                return new, -1.0
        return new, 0.0


def place_of(pose: Mount, mount: Mount) -> Place:
    """Return the place of a LiDAR on a robot at a pose."""
    heading = cmath.rect(1.0, pose[2])
    return complex(pose[0], pose[1]) + complex(mount[0], mount[1]) * heading, heading * cmath.rect(1.0, mount[2])


def _seen(points: Any, before: Place, now: Place) -> Any:
    """Return points of a LiDAR's frame in its frame at another place."""
    return (before[0] + points * before[1] - now[0]) * now[1].conjugate()


def _covers(points: NDArray[np.complex128], count: int) -> NDArray[np.bool_]:
    """Return the directions, of a number, in which points lie; with many, also those beside."""
    covered = np.zeros(count, np.bool_)
    covered[np.round(np.angle(points) * (count / TURN)).astype(np.int64) % count] = True
    return covered | np.roll(covered, 1) | np.roll(covered, -1) if count > FEW else covered


def _runs(solid: NDArray[np.bool_], least: float) -> list[NDArray[np.int64]]:
    """Return the runs of more than ``least`` directions that are not solid; single ones do not end them."""
    count = len(solid)
    around = sum(np.roll(solid, k).astype(np.int64) for k in range(-2, 3)) if count > FEW else 5 * solid
    firm = np.flatnonzero(solid & (around >= 3))
    if not len(firm):
        return [np.arange(count)]
    widths = np.diff(firm, append=firm[0] + count) - 1
    return [(firm[k] + 1 + np.arange(widths[k])) % count for k in np.flatnonzero(widths > least)]
