"""Noise and bias of a gyro: while the robot stands, or else against the truth's turning rate.

Means over blocks of some seconds are the bias, which walks, plus white noise. Their likelihood, with the first bias profiled
out, gives the walk; white noise follows from the differences of successive values, to which a walk adds next to nothing.

References:
    von Neumann et al., "The mean square successive difference", *Annals of Mathematical Statistics* 12 (1941).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym.drive import Drive
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.systems.imu import ImuNoise
from turtlebot_gym_lab.calibration.estimates import CLEAR, CalibrationEstimate
from turtlebot_gym_lab.calibration.fit import LEVEL, Z
from turtlebot_gym_lab.calibration.windows import Array

STILL = (1e-3, 0.02)
"""Speed and turning rate by the wheels below which a robot stands, m/s and rad/s."""
SETTLING = 0.5
"""Time at both ends of a stand that is left out, s."""
BLOCK = 5.0
"""Length of a block, s."""
FEWEST = 4
"""Fewest blocks, and fewest values of each."""
WALKS = np.concatenate([[0.0], np.geomspace(1e-5, 1e-2, 81)])
"""Walks whose likelihood is compared, rad/s in the first second."""
REMEDY = "stand still for a minute, three times or more"


class GyroFit(NamedTuple):
    """What a drive shows about its gyro."""

    noise: ImuNoise
    """The sensor's parameters: the bias as recorded, as a deviation."""
    estimates: dict[str, CalibrationEstimate]
    """Bias at the start, and the other parameters of `ImuNoise`, by name."""
    by_truth: bool
    """Whether the truth's turning rate was taken off, because the robot does not stand."""


def fit_gyro(drive: Drive) -> GyroFit:
    """Fit a gyro's noise to a drive.

    Raises:
        ValueError: If the drive has no gyro, or neither stands for long enough nor has a truth.
    """
    if not np.isfinite(drive.gyro).any():
        raise ValueError("the drive has no gyro.")
    v, omega = np.abs(drive.twist).T
    parts, by_truth = _parts(drive, drive.gyro, (v < STILL[0]) & (omega < STILL[1])), False
    if len(parts) < FEWEST:
        parts, by_truth = _parts(drive, drive.gyro - _true_rate(drive), np.ones(len(drive), np.bool_)), True
    if len(parts) < FEWEST:
        raise ValueError(f"the robot stands for less than {FEWEST * BLOCK:g} s, and there is no truth: {REMEDY}.")
    squares = np.concatenate([0.5 * np.diff(values) ** 2 for _, values in parts])
    variance = float(squares.mean())
    off = Z * math.sqrt(3.0 / len(squares))
    time = np.array([at for at, _ in parts])
    means, counts = np.array([values.mean() for _, values in parts]), np.array([len(values) for _, values in parts])
    fits = [_first_bias(time - time[0] + 0.5 * BLOCK, means, variance / counts, walk) for walk in WALKS]
    likelihood = np.array([value for _, _, value in fits])
    best = int(likelihood.argmax())
    bias, deviation, _ = fits[best]
    inside = WALKS[likelihood > likelihood[best] - 0.5 * stats.chi2.ppf(LEVEL, 1)]
    # An uncertain walk widens the bias: as far as it would be with the walk's upper end.
    deviation = max(deviation, fits[int(np.searchsorted(WALKS, inside[-1]))][1])
    walk, clear = float(WALKS[best]), bool(inside[-1] - inside[0] < 4.0 * CLEAR * WALKS[best])
    estimates = {
        "bias": CalibrationEstimate(value=bias, low=bias - Z * deviation, high=bias + Z * deviation, unit="rad/s"),
        "variance": CalibrationEstimate(
            value=variance,
            low=variance / (1.0 + off),
            high=variance / max(1.0 - off, 0.1),
            unit="(rad/s)^2",
            remedy="" if off < 2.0 * CLEAR else REMEDY,
        ),
        "bias_walk": CalibrationEstimate(
            value=walk,
            low=float(inside[0]),
            high=float(inside[-1]),
            unit="rad/s/sqrt(s)",
            is_profile=True,
            remedy="" if clear else REMEDY,
        ),
    }
    return GyroFit(ImuNoise(variance=variance, bias_deviation=math.hypot(bias, deviation), bias_walk=walk), estimates, by_truth)


def _true_rate(drive: Drive) -> Array:
    """Return the truth's turning rate around each row, shape (T,); NaN where it is unknown."""
    rate = np.full(len(drive), np.nan)
    rate[1:-1] = wrap_all(drive.truth[2:, 2] - drive.truth[:-2, 2]) / (drive.time[2:] - drive.time[:-2])
    return rate


def _parts(drive: Drive, values: Array, chosen: NDArray[np.bool_]) -> list[tuple[float, Array]]:
    """Return blocks of the chosen rows: their middle times, s, and their values."""
    chosen = chosen & np.isfinite(values)
    begins = np.flatnonzero(chosen & ~(np.concatenate([[False], chosen[:-1]]) & drive.joined))
    blocks = []
    for first in begins.tolist():
        ends = np.flatnonzero(~chosen[first + 1 :] | ~drive.joined[first + 1 :])
        last = first + 1 + int(ends[0]) if len(ends) else len(drive)
        start, stop = float(drive.time[first]) + SETTLING, float(drive.time[last - 1]) - SETTLING
        for begin in np.arange(start, stop - BLOCK, BLOCK):
            row, end = np.searchsorted(drive.time, [begin, begin + BLOCK]).tolist()
            if end - row >= FEWEST:
                blocks.append((begin + 0.5 * BLOCK, values[row:end]))
    return blocks


def _first_bias(time: Array, means: Array, white: Array, walk: float) -> tuple[float, float, float]:
    """Return the bias at time 0, its standard deviation, and the restricted log-likelihood of a walk."""
    # The mean of a walk over a block varies as the walk does a sixth of the block before its middle.
    V = walk**2 * (np.minimum.outer(time, time) - BLOCK / 6.0 * np.eye(len(time))) + np.diag(white)
    root = np.linalg.cholesky(V)
    z, ones = np.linalg.solve(root, means), np.linalg.solve(root, np.ones_like(means))
    information = float(ones @ ones)
    bias = float(ones @ z) / information
    residuals = z - bias * ones
    likelihood = -np.log(np.diag(root)).sum() - 0.5 * math.log(information) - 0.5 * float(residuals @ residuals)
    return bias, 1.0 / math.sqrt(information), float(likelihood)
