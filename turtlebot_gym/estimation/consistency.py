"""Consistency of a filter's stated uncertainty.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4: NEES, NIS.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
