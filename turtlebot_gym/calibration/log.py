"""A recorded drive as arrays: the output of the file readers and the input of the likelihoods."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

POSE, WHEELS = "pose", "wheel"
"""Odometry that measures the pose, and odometry that integrates the wheels."""
GAP = 5.0
"""Ratio to the usual interval at which a gap interrupts a drive."""

FRESH = 0.3
"""Longest gap between true poses over which they are interpolated, s."""


class Log(NamedTuple):
    """A recorded drive of T rows; time increases."""

    time: NDArray[np.float64]
    """Shape (T,), s."""
    twist: NDArray[np.float64]
    """Speed and turning rate, measured by the wheels or commanded, shape (T, 2); m/s, rad/s. The twist of row k covers
    the interval from row k-1 to row k."""
    odometry: NDArray[np.float64]
    """Measured poses, shape (T, 3); m, m, rad; NaN where none arrived."""
    truth: NDArray[np.float64]
    """True poses, shape (T, 3); m, m, rad; NaN where they are not known."""
    joined: NDArray[np.bool_]
    """Whether a row continues the one before it, with no gap between them; shape (T,), false in row 0."""
    remarks: tuple[str, ...] = ()
    """Problems found in the file, and how each was handled."""

    @property
    def period(self) -> float:
        """The usual interval between rows, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def has_odometry(self) -> bool:
        """Whether poses were measured."""
        return int(known(self.odometry).sum()) >= 2

    @property
    def has_truth(self) -> bool:
        """Whether true poses are known."""
        return int(known(self.truth).sum()) >= 2


def make_log(
    time: NDArray[np.float64],
    twist: NDArray[np.float64],
    odometry: NDArray[np.float64] | None = None,
    truth: NDArray[np.float64] | None = None,
    *,
    joined: NDArray[np.bool_] | None = None,
    remarks: tuple[str, ...] = (),
) -> Log:
    """Make a log from arrays; rows that are far apart in time do not continue each other.

    Args:
        time: Shape (T,), s; increasing.
        twist: Shape (T, 2); the twist of row k covers the interval from row k-1 to row k.
        odometry: Shape (T, 3), None for none.
        truth: Shape (T, 3), None for none.
        joined: Whether a row continues the one before it, as far as the reader knows, shape (T,); None if every row does.
        remarks: Problems found in the file.

    Raises:
        ValueError: If there are fewer than two rows, or time does not increase.
    """
    time = np.asarray(time, np.float64)
    if len(time) < 2:
        raise ValueError(f"a drive has at least two rows, got {len(time)}.")
    steps = np.diff(time)
    if not (steps > 0.0).all():
        raise ValueError(f"time must increase, got {steps.min()} s from a row to the next.")
    unknown = np.full((len(time), 3), np.nan)
    near = np.concatenate([[False], steps <= GAP * np.median(steps)])
    return Log(
        time,
        np.asarray(twist, np.float64),
        unknown if odometry is None else np.asarray(odometry, np.float64),
        unknown if truth is None else np.asarray(truth, np.float64),
        near if joined is None else near & joined,
        remarks,
    )


def known(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each pose of shape (T, 3) is known, shape (T,)."""
    return np.asarray(np.isfinite(poses).all(axis=1))


def path_of(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance driven up to each row, shape (T,), m; at an unknown pose, that up to the last known one.

    Args:
        poses: Shape (T, 3).
    """
    there = np.flatnonzero(known(poses))
    if not there.size:
        return np.zeros(len(poses))
    legs = np.hypot(*np.diff(poses[there, :2], axis=0).T)
    driven = np.concatenate([[0.0], np.cumsum(legs)])
    return driven[np.maximum(np.searchsorted(there, np.arange(len(poses)), side="right") - 1, 0)]


def interpolated(time: NDArray[np.float64], poses: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate poses at other times, shape (n, 3); NaN where the known poses on either side are too far apart.

    Args:
        time: Shape (T,), s; increasing.
        poses: Known poses, shape (T, 3); m, m, rad.
        wanted: The other times, shape (n,), s.
    """
    heading = np.unwrap(poses[:, 2])
    between = np.stack([np.interp(wanted, time, values) for values in (poses[:, 0], poses[:, 1], heading)], axis=1)
    between[:, 2] = np.remainder(between[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    after = np.clip(np.searchsorted(time, wanted), 1, len(time) - 1)
    apart = time[after] - time[after - 1]
    outside = (wanted < time[0] - 1e-6) | (wanted > time[-1] + 1e-6)
    between[outside | (apart > max(FRESH, GAP * float(np.median(np.diff(time)))))] = np.nan
    return np.asarray(between, np.float64)
