"""Rows in time: the values of several streams, each with its own clock, at the times of rows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import GAP
from turtlebot_gym.models.angles import wrap_all

FRESH = 0.3
"""Longest gap between true poses over which they are interpolated, s."""
CHORD = 0.02
"""Shortest chord from which a heading is taken, m: motion capture is exact to a millimetre, which is 0.05 rad there."""
SAME = 1e-6
"""Difference up to which two stamps are the same, s; a float resolves a quarter of that since 1970."""


class Stream:
    """The values of one quantity in the order of their time."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.values: list[Any] = []
        self.late: list[int] = []
        """Numbers, from 1, of the values that were left out because their time did not increase."""
        self.count = 0
        """Number of all values."""

    def __len__(self) -> int:
        return len(self.times)

    def add(self, time: float, value: Any) -> bool:
        """Add a value, and return whether its time is later than that of all others; it is left out if not."""
        self.count += 1
        if self.times and not time > self.times[-1]:
            self.late.append(self.count)
            return False
        self.times.append(time)
        self.values.append(value)
        return True

    def last(self, wanted: NDArray[np.float64], *, fresh: float = math.inf) -> NDArray[np.intp]:
        """Return the index of the last value at or before each wanted time; -1 if there is none, or it is too old.

        A value counts up to an age, s.
        """
        times = np.array(self.times)
        at = np.searchsorted(times, wanted + SAME, side="right") - 1
        if len(times):
            at[wanted - times[np.maximum(at, 0)] > fresh + SAME] = -1
        return at

    def latest(self, wanted: NDArray[np.float64], otherwise: Any) -> list[Any]:
        """Return the last value at or before each wanted time, and ``otherwise`` where there is none."""
        return [self.values[at] if at >= 0 else otherwise for at in self.last(wanted).tolist()]

    def held(self, wanted: NDArray[np.float64], size: int | tuple[int, ...] = (), *, fresh: float = math.inf) -> Any:
        """Return the last value at or before each wanted time, shape (n, *size); NaN if there is none, or it is too old."""
        at = self.last(wanted, fresh=fresh)
        shape = (len(wanted), *(size if isinstance(size, tuple) else (size,)))
        held = np.full(shape, np.nan)
        if (at >= 0).any():
            held[at >= 0] = np.array(self.values, np.float64)[at[at >= 0]]
        return held

    def before(self, wanted: NDArray[np.float64], size: int) -> NDArray[np.float64]:
        """Return the last value before each wanted time, shape (n, size); zeros if there is none."""
        at = np.searchsorted(np.array(self.times), wanted, side="left") - 1
        values = np.array(self.values, np.float64)[np.maximum(at, 0), :size]
        values[at < 0] = 0.0
        return values

    def nearest(self, wanted: NDArray[np.float64], size: int) -> NDArray[np.float64]:
        """Assign each value to the wanted time nearest to it, shape (n, size); the others are NaN."""
        times = np.array(self.times)
        assigned = np.full((len(wanted), size), np.nan)
        at = np.clip(np.searchsorted(wanted, times), 1, len(wanted) - 1)
        at -= (times - wanted[at - 1]) < (wanted[at] - times)
        near = np.abs(wanted[at] - times) < np.median(np.diff(wanted))
        assigned[at[near]] = np.array(self.values, np.float64)[near, :size]
        return assigned

    def interpolated(self, wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses at other times, see `interpolated`; at its own times each pose is itself."""
        if len(self.times) < 2:
            return self.held(wanted, 5, fresh=0.0)[:, :3]
        poses = np.array(self.values, np.float64)[:, :3]
        placed, latest = interpolated(np.array(self.times), poses, wanted), self.last(wanted, fresh=0.0)
        placed[latest >= 0] = poses[latest[latest >= 0]]
        return placed


def between(time: NDArray[np.float64], poses: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses at other times, shape (n, 3), on straight lines between the known ones; headings are not wrapped."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.stack([np.interp(wanted, time, values) for values in columns], axis=1)


def interpolated(time: NDArray[np.float64], poses: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate poses at other times, shape (n, 3); NaN where the known poses on either side are too far apart.

    Times increase, s; poses may be positions, with NaN for the headings.
    """
    placed = between(time, poses, wanted)
    placed[:, 2] = wrap_all(placed[:, 2])
    after = np.clip(np.searchsorted(time, wanted), 1, len(time) - 1)
    apart = time[after] - time[after - 1]
    outside = (wanted < time[0] - SAME) | (wanted > time[-1] + SAME)
    placed[outside | (apart > max(FRESH, GAP * float(np.median(np.diff(time)))))] = np.nan
    return placed


def headings(time: NDArray[np.float64], positions: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the headings of a robot by the direction in which it moves, shape (T,), rad; NaN where it hardly does.

    The chord of an arc is parallel to the tangent in its middle.

    Speeds are negative where the robot drives backwards, m/s.
    """
    are_known = np.isfinite(positions).all(axis=1)
    poses = np.column_stack([positions[are_known], np.full(are_known.sum(), np.nan)])
    way = np.concatenate([[0.0], np.cumsum(speed[1:] * np.diff(time))])
    ends = time - 0.5 * FRESH, time + 0.5 * FRESH
    length = np.interp(ends[1], time, way) - np.interp(ends[0], time, way)
    first, last = (interpolated(time[are_known], poses, end)[:, :2] for end in ends)
    chord = (last - first) * np.sign(length)[:, None]
    direction = np.arctan2(chord[:, 1], chord[:, 0])
    return np.where(np.abs(length) > CHORD, direction, np.nan)
