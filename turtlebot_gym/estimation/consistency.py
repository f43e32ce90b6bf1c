"""Consistency of a filter's stated uncertainty.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4: NEES, NIS.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import Range, as_int
from turtlebot_gym.models.angles import wrap_all


def difference(one: ArrayLike, other: ArrayLike) -> NDArray[np.float64]:
    """Return the difference of poses or states, with that of the headings wrapped.

    Args:
        one: Shape (..., 3) or (..., 5); m, m, rad, m/s, rad/s.
        other: The same shape.
    """
    apart = np.asarray(one, np.float64) - np.asarray(other, np.float64)
    apart[..., 2] = wrap_all(apart[..., 2])
    return apart


def nees(estimate: ArrayLike, truth: ArrayLike, covariance: ArrayLike) -> NDArray[np.float64]:
    """Return the normalized estimation error squared of poses, ``e' P^-1 e``, with the heading's error wrapped.

    For a consistent filter it is chi-square distributed with 3 degrees of freedom.

    Args:
        estimate: Estimated poses or states, shape (..., 3) or (..., 5); m, m, rad.
        truth: True ones, the same shape.
        covariance: Shape (..., 3, 3).

    Returns:
        Shape (...).
    """
    error = difference(estimate, truth)[..., :3, None]
    return (np.swapaxes(error, -1, -2) @ np.linalg.solve(np.asarray(covariance, np.float64), error))[..., 0, 0]


def mean_bounds(degrees: int, runs: int, *, false_alarm: float) -> tuple[float, float]:
    """Return the interval that contains the mean of independent NEES or NIS values, except for a stated rate of false alarms.

    Args:
        degrees: Degrees of freedom of each: 3 for the NEES of a pose, and for the NIS.
        runs: Number of independent values in the mean. Values along one run are correlated: count runs, not steps.
        false_alarm: Probability that a consistent filter falls outside.

    Raises:
        ValueError: If an argument is out of its range.
    """
    df = as_int("degrees", degrees, 1) * as_int("runs", runs, 1)
    from scipy import stats  # slow to import

    low, high = stats.chi2.interval(1.0 - Range(0.0, 1.0, open_low=True, open_high=True).check("false_alarm", false_alarm), df)
    return float(low / runs), float(high / runs)
