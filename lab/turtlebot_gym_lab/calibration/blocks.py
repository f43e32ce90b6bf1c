"""Intervals by blocks: errors of real wheels are correlated, but parts of a drive are nearly independent of each other.

References:
    Liang, Zeger, "Longitudinal data analysis using generalized linear models", *Biometrika* 73 (1986): the covariance of an
        estimate by how much the scores of blocks differ.
    Künsch, "The jackknife and the bootstrap for general stationary observations", *Annals of Statistics* 17 (1989).
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from turtlebot_gym_lab.calibration.fit import LEVEL
from turtlebot_gym_lab.calibration.windows import Array

MOST, FEWEST = 20, 5
"""Number of blocks of a drive, if it is long enough, and the least."""
LONG = 2
"""Windows in a block: those that overlap its ends, and so belong to two, must be few."""


def block_sums(values: Array, blocks: int) -> Array:
    """Return the sums over blocks of rows in order, shape (blocks, ...)."""
    return np.array([part.sum(axis=0) for part in np.array_split(values, blocks)])


def correlation(errors: Array, blocks: int) -> float:
    """Return how many rows count as one independent row: the variance of block sums over that of independent rows, at least 1.

    Errors have the shape (n, axes) and the mean 0.
    """
    power = float((errors**2).sum())
    return max(float((block_sums(errors, blocks) ** 2).sum()) / power, 1.0) if power > 0.0 else 1.0


def covariance_of(scores: Array, information: Array, prior: Array, blocks: int) -> Array:
    """Return the covariance of parameters that minimize squares, by how they change without each block, shape (m, m).

    Scores, shape (n, m), are what each row pulls at the parameters, and the information, shape (n, m, m), the second
    derivatives of half its squares; what rows leave open keeps the prior's variance.
    """
    parts = block_sums(information, blocks)
    total = parts.sum(axis=0) + np.diag(prior)
    changes = np.linalg.solve(total - parts, block_sums(scores, blocks)[..., None])[..., 0]
    gain = np.linalg.inv(total)
    by_blocks = (blocks - 1.0) / blocks * changes.T @ changes + gain @ np.diag(prior) @ gain
    wider = np.sqrt(np.maximum(np.diag(gain) / np.diag(by_blocks), 1.0))  # few blocks may agree by chance
    return by_blocks * np.outer(wider, wider)


def quantile(blocks: int) -> float:
    """Return half the width of an interval, in standard deviations by blocks."""
    return float(stats.t.ppf(0.5 + 0.5 * LEVEL, blocks - 1))
