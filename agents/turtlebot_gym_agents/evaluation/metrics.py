"""Metrics with their confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.drive import heading_error, position_error

CONFIDENCE = 0.95
"""Confidence of all intervals."""


class Interval(NamedTuple):
    """An estimate with its 95 % interval; NaN without data. The format `.2f` gives `1.50 (1.40, 1.60)`, and `.1%` per cent."""

    value: float
    low: float
    high: float

    def __format__(self, spec: str) -> str:
        value, low, high = (format(number, spec).removesuffix("%") for number in self)
        return f"{value} ({low}, {high})"


class Errors(NamedTuple):
    """Errors of estimated poses over a drive; numbers, or arrays with a number per drive."""

    position_mean: NDArray[np.float64]
    """m"""
    position_max: NDArray[np.float64]
    position_final: NDArray[np.float64]
    heading_mean: NDArray[np.float64]
    """rad"""
    heading_max: NDArray[np.float64]
    heading_final: NDArray[np.float64]


def errors(poses: ArrayLike, truth: ArrayLike) -> Errors:
    """Return mean, largest and final errors over time of poses or states (T, ..., 3 or 5), each of shape (...).

    NaN is where there is no estimate or the drive is over.
    """
    position, heading = position_error(poses, truth), heading_error(poses, truth)
    last = len(position) - 1 - np.argmax(np.isfinite(position)[::-1], axis=0)[None]
    numbers: list[NDArray[np.float64]] = []
    for error in (position, heading):
        numbers += [np.nanmean(error, axis=0), np.nanmax(error, axis=0), np.take_along_axis(error, last, axis=0)[0]]
    return Errors(*numbers)


def share(happened: ArrayLike) -> Interval:
    """Return the share of cases in which something happened, booleans (n,), n > 0, with Wilson's interval."""
    from scipy import stats  # slow to import

    flags = np.asarray(happened, np.bool_)
    return wilson(float(flags.mean()), flags.size, float(stats.norm.ppf(0.5 + 0.5 * CONFIDENCE)))


def ratio(parts: ArrayLike, wholes: ArrayLike, most: float = np.inf) -> Interval:
    """Return the ratio of two sums over independent cases, (n,), n > 0, with the interval of its linearization.

    ``parts`` are not negative, ``wholes`` positive in sum, and ``most`` is the greatest possible ratio, such as 1 for a share.
    """
    parts, wholes = np.asarray(parts, np.float64), np.asarray(wholes, np.float64)
    size = wholes.mean()
    value = float(parts.mean() / size)
    _, low, high = mean((parts - value * wholes) / size)
    return Interval(value, max(value + low, 0.0), min(value + high, most))


def wilson(p: float, n: float, z: float) -> Interval:
    """Return Wilson's interval for a share ``p`` of ``n`` cases, or of an effective number of independent ones.

    ``z`` is a quantile of the standard normal distribution, or of Student's: Wilson, "Probable inference, the law of
    succession, and statistical inference" (1927).
    """
    centre, margin = p + z * z / (2.0 * n), z * np.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
    low, high = (centre - margin) / (1.0 + z * z / n), (centre + margin) / (1.0 + z * z / n)
    return Interval(p, float(low) if p > 0.0 else 0.0, float(high) if p < 1.0 else 1.0)


def share_difference(share: Interval, other: Interval, correlation: float = 0.0) -> Interval:
    """Return the difference of two shares with Newcombe's interval, computed from the shares' intervals and their correlation.

    Newcombe, "Interval estimation for the difference between independent proportions" (1998), method 10.
    """

    def margin(down: float, up: float) -> float:
        return float(np.sqrt(max(down * down - 2.0 * correlation * down * up + up * up, 0.0)))

    difference = share.value - other.value
    low = difference - margin(share.value - share.low, other.high - other.value)
    return Interval(difference, low, difference + margin(other.value - other.low, share.high - share.value))


def paired_share_difference(events: ArrayLike, other: ArrayLike) -> Interval:
    """Return the difference of the shares of two events, booleans (n,), in the same episodes, with Newcombe's interval for
    pairs.

    Newcombe, "Improved confidence intervals for the difference between binomial proportions based on paired data" (1998),
    method 10.
    """
    first, second = np.asarray(events, np.bool_), np.asarray(other, np.bool_)
    both, neither = int(np.sum(first & second)), int(np.sum(~first & ~second))
    first_only, second_only = int(np.sum(first & ~second)), int(np.sum(~first & second))
    excess = both * neither - first_only * second_only
    corrected = max(excess - first.size / 2.0, 0.0) if excess > 0 else excess
    margins = np.prod([float(flags.sum()) * float((~flags).sum()) for flags in (first, second)])
    correlation = float(corrected / np.sqrt(margins)) if margins > 0.0 else 0.0
    return share_difference(share(first), share(second), correlation)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values of several comparisons, adjusted to control the family-wise error rate.

    Holm, "A simple sequentially rejective multiple test procedure" (1979).
    """
    adjusted, largest = [1.0] * len(p_values), 0.0
    for rank, at in enumerate(sorted(range(len(p_values)), key=lambda at: p_values[at])):
        largest = max(largest, min((len(p_values) - rank) * p_values[at], 1.0))
        adjusted[at] = largest
    return adjusted


def quantile(values: ArrayLike, share: float) -> Interval:
    """Return a quantile of independent numbers (n,), n > 0, with a distribution-free interval between two order statistics.

    The count of numbers below it is binomial: Hahn, Meeker, *Statistical Intervals* (1991), section 5.2.
    """
    from scipy import stats

    ordered = np.sort(np.asarray(values, np.float64))
    outer = stats.binom.ppf([0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE], ordered.size, share)
    # Order statistics are counted from 1.
    low, high = np.clip(outer.astype(np.int64) - (1, 0), 0, ordered.size - 1)
    return Interval(float(np.quantile(ordered, share, method="weibull")), float(ordered[low]), float(ordered[high]))


def side(interval: Interval) -> int:
    """Return on which side of 0 a whole interval lies, 1 or -1; 0 if it contains 0."""
    return int(interval.low > 0.0) - int(interval.high < 0.0)


def mean(values: ArrayLike) -> Interval:
    """Return the mean of independent numbers (n,) with Student's interval; NaNs are ignored."""
    from scipy import stats

    numbers = np.asarray(values, np.float64)
    numbers = numbers[np.isfinite(numbers)]
    if numbers.size == 0:
        return Interval(np.nan, np.nan, np.nan)
    middle = float(numbers.mean())
    if numbers.size == 1:
        return Interval(middle, np.nan, np.nan)
    margin = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, numbers.size - 1) * stats.sem(numbers))
    return Interval(middle, middle - margin, middle + margin)
