"""Measured against fitted errors: the data for a calibration's figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise
from turtlebot_gym_lab.calibration.alphas import pieces_of
from turtlebot_gym_lab.calibration.calibrate import Calibration
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, value_of
from turtlebot_gym_lab.calibration.windows import path_of

LENGTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Lengths of pieces for which the drift is shown, m."""
FEWEST = 3
"""Fewest pieces for which the drift is shown."""


class Residuals(NamedTuple):
    """Errors of measured poses, n of them."""

    values: NDArray[np.float64]
    """Measured minus true pose, without the bias; shape (n, 3); m, m, rad."""
    deviations: NDArray[np.float64]
    """Their standard deviations by the fit, without spikes, shape (n, 3)."""


class Drift(NamedTuple):
    """Error of wheel odometry at the end of pieces, by length."""

    length: NDArray[np.float64]
    """Lengths of the pieces, shape (m,), m."""
    measured: NDArray[np.float64]
    """Root mean square of the position's error and of the heading's, shape (m, 2); m, rad."""
    fitted: NDArray[np.float64]
    """The same as predicted by the noise model, shape (m, 2)."""


def residuals(calibration: Calibration) -> Residuals:
    """Return the errors of measured poses, of a calibration with truth."""
    drive, odometry = calibration.drive, calibration.likeliest.odometry
    are_known = known(drive.odometry) & known(drive.truth)
    error = difference(drive.odometry[are_known], drive.truth[are_known] + odometry.bias)
    return Residuals(error, np.broadcast_to(np.sqrt(odometry.R), error.shape))


def drift(calibration: Calibration, noise: Noise | None = None, *, lengths: Sequence[float] = LENGTHS) -> Drift:
    """Return the error of wheel odometry after some distances, and its prediction by a noise model.

    By default the noise model is the one that was fitted; a turn by 1 rad counts as `windows.LEVER` of the distances, m.
    """
    noise = noise or calibration.likeliest
    rule, process = INTEGRATORS[calibration.integrator], noise.process
    wheels = np.array([process.scale, process.turn_scale, process.veer, 0.0, 0.0, 0.0, 0.0, 0.0])
    variances, path, table = np.array([*(value_of(noise, name) for name in ALPHAS), 0.0, 0.0]), path_of(calibration.drive), []
    for length in lengths:
        pieces = pieces_of(path, calibration.drive.truth, wheels, rule, length)
        if len(pieces.off) >= FEWEST:
            C, squares = pieces.covariance(variances), (pieces.off**2).mean(axis=0)
            fitted = np.diagonal(C, axis1=1, axis2=2).mean(axis=0)
            roots = np.sqrt([squares[:2].sum(), squares[2], fitted[:2].sum(), fitted[2]])
            table.append((length, *roots))
    columns = np.array(table, np.float64).reshape(-1, 5)
    return Drift(columns[:, 0], columns[:, 1:3], columns[:, 3:5])
