"""Numbers that say how well something went, with the intervals that say how sure that is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.trajectory import heading_error, position_error

CONFIDENCE = 0.95
"""Confidence of all intervals."""


class Interval(NamedTuple):
    """An estimate with its 95 % interval; NaN where there is nothing to estimate it from."""

    value: float
    low: float
    high: float


class Errors(NamedTuple):
    """How far believed poses are from the true ones, over a drive; each a number, or an array with one for each drive."""

    position_mean: NDArray[np.float64]
    """m"""
    position_max: NDArray[np.float64]
    position_final: NDArray[np.float64]
    heading_mean: NDArray[np.float64]
    """rad"""
    heading_max: NDArray[np.float64]
    heading_final: NDArray[np.float64]


def errors(poses: ArrayLike, truth: ArrayLike) -> Errors:
    """Return mean, greatest and final errors over time.

    Args:
        poses: Poses or states, shape (T, ..., 3) or (T, ..., 5); NaN where nothing is believed or the drive is over.
        truth: True ones, in the same shape but for the last axis.

    Returns:
        Of shape (...).
    """
    position, heading = position_error(poses, truth), heading_error(poses, truth)
    last = len(position) - 1 - np.argmax(np.isfinite(position)[::-1], axis=0)[None]
    return Errors(
        *(
            number
            for error in (position, heading)
            for number in (
                np.nanmean(error, axis=0),
                np.nanmax(error, axis=0),
                np.take_along_axis(error, last, axis=0)[0],
            )
        )
    )


def share(happened: ArrayLike) -> Interval:
    """Return how often something happened, with Wilson's interval.

    Args:
        happened: Booleans, shape (n,), n > 0.

    References:
        Wilson, "Probable inference, the law of succession, and statistical inference" (1927).
    """
    from scipy import stats  # slow to import

    flags = np.asarray(happened, np.bool_)
    test = stats.binomtest(int(flags.sum()), flags.size)
    low, high = test.proportion_ci(CONFIDENCE, method="wilson")
    return Interval(float(test.statistic), float(low), float(high))


def mean(values: ArrayLike) -> Interval:
    """Return the mean of independent numbers with Student's interval; those that are NaN do not count.

    Args:
        values: Shape (n,).
    """
    from scipy import stats

    known = np.asarray(values, np.float64)
    known = known[np.isfinite(known)]
    if known.size == 0:
        return Interval(np.nan, np.nan, np.nan)
    middle = float(known.mean())
    if known.size == 1:
        return Interval(middle, np.nan, np.nan)
    margin = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, known.size - 1) * stats.sem(known))
    return Interval(middle, middle - margin, middle + margin)
