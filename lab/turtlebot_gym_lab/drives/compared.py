"""The motion of a drive over windows, by its twist and by its poses, and how that of one compares with that of another."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.angles import wrap_all

Array = NDArray[np.float64]
Motion = NDArray[np.complex128]

WINDOW = 1.0
"""Length of the windows, s."""
FEWEST = 12
"""Fewest windows from which something is said."""
WITHIN = 0.25
"""Relative difference up to which a factor is that of a unit or a sign."""
SURE = 6.0
"""Standard deviations by which a factor must differ from 0."""


class Source(NamedTuple):
    """The motion of n windows, by one of the three."""

    name: str
    """What messages call its turn, or its heading."""
    turn: Array
    """Shape (n,), rad."""
    moved: Motion
    """Motion in the world as a complex number, shape (n,), m; of a twist in the robot's frame, so that it is real."""
    heading: Array
    """Shape (n,), rad; zeros for a twist."""

    @property
    def ahead(self) -> Motion:
        """Motion in the robot's frame."""
        return self.moved * np.exp(-1j * self.heading)


def sources_of(drive: Drive) -> list[Source]:
    """Return the motion over windows, by the twist, and by the poses of which enough are known."""
    every = max(round(WINDOW / drive.period), 1)
    first = np.arange(0, len(drive) - every, every)
    last = first + every
    breaks = np.cumsum(~drive.joined)
    moved = np.nan_to_num(drive.twist[1:] * np.diff(drive.time)[:, None])
    sums = np.vstack([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    good = (breaks[first] == breaks[last]) & (np.abs(sums[last]) < 1e12).all(axis=1)
    poses = [(name, each) for name, each in (("measured heading", drive.odometry), ("true heading", drive.truth))]
    poses = [(name, each) for name, each in poses if (good & known(each[first]) & known(each[last])).sum() >= FEWEST]
    for _, each in poses:
        good &= known(each[first]) & known(each[last])
    if good.sum() < FEWEST:
        return []
    first, last = first[good], last[good]
    told = sums[last] - sums[first]
    sources = [Source("turning rate", told[:, 1], told[:, 0].astype(np.complex128), np.zeros(len(first)))]
    for name, each in poses:
        turns = np.nancumsum(np.concatenate([[0.0], wrap_all(np.diff(_filled(each[:, 2])))]))
        at = first[:, None] + np.arange(every + 1)
        heading = np.angle(np.nanmean(np.exp(1j * each[at, 2]), axis=1))
        step = each[last, 0] - each[first, 0] + 1j * (each[last, 1] - each[first, 1])
        sources.append(Source(name, turns[last] - turns[first], step, heading))
    return sources


def _filled(values: Array) -> Array:
    """Return values with the last known one where one is missing."""
    at = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return values[at]


def factor_of(y: Array, x: Array) -> tuple[float, float]:
    """Return by what x must be multiplied to be y, and the standard deviation of that."""
    power = max(float((x**2).sum()), 1e-300)
    factor = float((x * y).sum()) / power
    rest = float(((y - factor * x) ** 2).sum()) / max(len(x) - 1, 1)
    return factor, math.sqrt(rest / power)


def matches(factor: tuple[float, float], wanted: float) -> bool:
    """Return whether a factor is a wanted one, and not by chance."""
    return abs(factor[0] / wanted - 1.0) < WITHIN and abs(factor[0]) > SURE * factor[1]


def explained(moved: Motion, told: Array) -> tuple[float, complex]:
    """Return the share of a motion in the plane that is a multiple of another one, and the multiple."""
    factor = complex((moved * told).sum() / max(float((told**2).sum()), 1e-300))
    power = max(float((np.abs(moved) ** 2).sum()), 1e-300)
    return abs(factor) ** 2 * float((told**2).sum()) / power, factor


def share_of(moved: Array, told: Array) -> float:
    return float((moved * told).sum()) ** 2 / max(float((moved**2).sum()) * float((told**2).sum()), 1e-300)


def without_lost(sources: list[Source], part: Callable[[Source], Array]) -> list[Source]:
    """Return the sources without measured poses in whose noise the motion is lost, if there are true ones."""
    if len(sources) < 3:
        return sources
    factor, deviation = factor_of(part(sources[1]), part(sources[2]))
    return sources if abs(factor) > SURE * deviation else [sources[0], sources[2]]
