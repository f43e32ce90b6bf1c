"""Whether the fitted model describes a drive: tests of its residuals, with a verdict in one line.

The whitened residuals of the right model are independent standard normal numbers. The level of the tests is so low that a right
model fails one in several thousand drives.

References:
    Ljung, Box, "On a measure of lack of fit in time series models", *Biometrika* 65 (1978).
    Anscombe, Glynn, "Distribution of the kurtosis statistic b2 for normal samples", *Biometrika* 70 (1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym_lab.calibration.regression import Regression, RegressionProblem

LEVEL = 1e-5
"""Level of each test."""
LAGS = 20
"""Motions over which residuals are compared with themselves."""
FAR = 4.0
"""Standard deviations to which residuals are clipped for the correlation, so that a few do not decide it."""
SMALL = 0.2
"""Correlation that heavy tails alone may cause."""
JUMPS = 0.01
"""Largest share of jumps that a drive may have."""
SLOW, LEVER = 1e-3, 0.1
"""Speed below which the robot stands, m/s, and distance as which a turn by 1 rad counts, m."""
FEWEST = 30
"""Fewest residuals to test."""


class Verdict(NamedTuple):
    """Result of the tests."""

    is_good: bool
    """Whether the model describes the drive, so that its file may be used."""
    is_correlated: bool
    """Whether errors are correlated from row to row."""
    text: str
    """One line for the user."""
    nees: float
    """Mean square of the residuals: 1 for the right model."""
    kurtosis: float
    """Largest kurtosis of the three axes: 3 for normal errors."""


def diagnose(problem: RegressionProblem, fitted: Regression) -> Verdict:
    """Test the residuals of a regression."""
    v, omega = problem.motions.twist.T
    moving = np.abs(v) + LEVER * np.abs(omega) > SLOW
    axes = (0, 2) if problem.is_exact else (0, 1, 2)  # an exact truth leaves nothing to the side
    residuals = fitted.residuals[moving] if problem.is_exact else fitted.residuals
    rows = len(problem.motions.row)
    return judge(residuals[:, axes], len(problem.jumps), rows, _uneven(problem, fitted.residuals, axes))


def judge(residuals: NDArray[np.float64], jumps: int, kept: int, uneven: Sequence[str] = ()) -> Verdict:
    """Test white residuals.

    Args:
        residuals: Shape (n, axes).
        jumps: Number of errors that were left out ...
        kept: ... and of those that were not.
        uneven: Further faults, which count only where errors are neither correlated nor of heavy tails.
    """
    faults, rows = [], jumps + kept
    if jumps > max(JUMPS * rows, 10.0):
        faults.append(f"{jumps} of {rows} errors are far beyond the rest: heavy tails, or a truth or twist that jumps")
    kurtosis = max(float(stats.kurtosis(errors, fisher=False)) for errors in residuals.T)
    has_tails = len(residuals) >= FEWEST and any(_has_heavy_tails(errors) for errors in residuals.T)
    least = SMALL if has_tails else 0.0  # rare large errors look weakly correlated
    is_correlated = len(residuals) >= FEWEST and any(_is_correlated(errors, least) for errors in residuals.T)
    if has_tails and not is_correlated:
        faults.append(f"errors have heavy tails (kurtosis {kurtosis:.1f} instead of 3)")
    if not has_tails and not is_correlated and len(residuals) >= FEWEST:
        faults += uneven
    nees = float((residuals**2).mean())
    if faults:
        text = "The model does not describe the drive: " + "; ".join(faults) + "."
    elif is_correlated:
        text = "Errors are correlated from row to row: the alphas are those of segments, at the upper ends of their intervals."
    else:
        text = f"The model describes the drive: residuals are white and normal, NEES {nees:.2f} for 1."
    return Verdict(not faults, is_correlated, text, nees, kurtosis)


def _is_correlated(z: NDArray[np.float64], least: float) -> bool:
    z = np.clip(z, -FAR, FAR)
    n, power = len(z), float((z**2).sum())
    shares = np.array([float((z[lag:] * z[:-lag]).sum()) / power for lag in range(1, min(LAGS, n // 3) + 1)])
    statistic = n * (n + 2.0) * float((shares**2 / (n - np.arange(1, len(shares) + 1))).sum())
    return bool(stats.chi2.sf(statistic, len(shares)) < LEVEL and np.abs(shares).max() > least)


def _has_heavy_tails(z: NDArray[np.float64]) -> bool:
    statistic, p = stats.kurtosistest(z)
    return bool(statistic > 0.0 and p < LEVEL)


def _uneven(problem: RegressionProblem, residuals: NDArray[np.float64], axes: tuple[int, ...]) -> list[str]:
    """Return in which motions errors are larger or smaller than fitted."""
    v, omega = np.abs(problem.motions.twist.T)
    ahead, turning = v > SLOW, LEVER * omega > SLOW
    faults = []
    for name, chosen in (("straight ahead", ahead & ~turning), ("on the spot", turning & ~ahead), ("in arcs", ahead & turning)):
        squares = residuals[chosen][:, axes] ** 2
        if squares.size >= FEWEST:
            p = stats.chi2.cdf(squares.sum(), squares.size)
            if min(p, 1.0 - p) < 0.5 * LEVEL:
                faults.append(f"errors {name} are {np.sqrt(squares.mean()):.2f} times as large as fitted")
    return faults
