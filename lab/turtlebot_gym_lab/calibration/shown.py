"""Measured against fitted errors: the data for a calibration's figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import known
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import FilterTuning, Noise, OdometryNoise
from turtlebot_gym.values import STOP, Command, Covariance, Pose
from turtlebot_gym_lab.calibration.alphas import pieces_of
from turtlebot_gym_lab.calibration.calibrate import Calibration
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, value_of
from turtlebot_gym_lab.calibration.estimates import measured_rows
from turtlebot_gym_lab.calibration.likelihood import Rows, tuning_of
from turtlebot_gym_lab.calibration.windows import path_of

LENGTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Lengths of pieces for which the drift is shown, m."""
FEWEST = 3
"""Fewest pieces for which the drift is shown."""


class Residuals(NamedTuple):
    """Errors of measured poses, n of them."""

    values: NDArray[np.float64]
    """Measured minus true pose, or minus the predicted one, without the bias; shape (n, 3); m, m, rad."""
    deviations: NDArray[np.float64]
    """Their standard deviations by the fit, without spikes, shape (n, 3)."""


class Drift(NamedTuple):
    """Error of wheel odometry at the end of pieces, by length."""

    length: NDArray[np.float64]
    """Lengths of the pieces, shape (m,), m."""
    pieces: NDArray[np.intp]
    """Number of pieces, shape (m,)."""
    measured: NDArray[np.float64]
    """Root mean square of the position's error and of the heading's, shape (m, 2); m, rad."""
    fitted: NDArray[np.float64]
    """The same as predicted by the noise model, shape (m, 2)."""


def residuals(calibration: Calibration) -> Residuals:
    """Return the errors of measured poses, or the innovations without truth."""
    drive, odometry = calibration.drive, calibration.likeliest.odometry
    if calibration.has_truth:
        are_known = known(drive.odometry) & known(drive.truth)
        error = difference(drive.odometry[are_known], drive.truth[are_known] + odometry.bias)
        return Residuals(error, np.broadcast_to(np.sqrt(odometry.R), error.shape))
    spiky = odometry.spike_probability * odometry.spike**2  # a filter matched to the noise counts spikes into R
    R = (*odometry.R[:2], odometry.R[2] + spiky)
    tuning = tuning_of(Noise(process=calibration.likeliest.process, odometry=OdometryNoise(R=R)))
    rows = measured_rows(drive)
    rows = rows._replace(poses=rows.poses - odometry.bias)
    walk = list(_innovations(rows, tuning, calibration))
    values = [off for off, _ in walk]
    variances = [(P.xx + R[0], P.yy + R[1], P.tt + odometry.R[2]) for _, P in walk]
    return Residuals(np.array(values).reshape(-1, 3), np.sqrt(np.array(variances).reshape(-1, 3)))


def drift(calibration: Calibration, noise: Noise | None = None, *, lengths: Sequence[float] = LENGTHS) -> Drift:
    """Return the error of wheel odometry after some distances, and its prediction by a noise model.

    Args:
        calibration: The calibration, with truth.
        noise: The noise model; None for the one that was fitted.
        lengths: The distances, m; a turn by 1 rad counts as `windows.LEVER`.
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
            table.append((length, len(pieces.off), *roots))
    columns = np.array(table, np.float64).reshape(-1, 6)
    return Drift(columns[:, 0], columns[:, 1].astype(np.intp), columns[:, 2:4], columns[:, 4:6])


def _innovations(rows: Rows, tuning: FilterTuning, calibration: Calibration) -> Iterator[tuple[Pose, Covariance]]:
    """Yield the innovation of each pose, with its prediction's covariance."""
    belief, rule, last = None, INTEGRATORS[calibration.integrator], len(rows.time) - 1
    times, poses, twists = rows.time.tolist(), rows.poses.tolist(), rows.twist.tolist()
    for row in range(last + 1):
        z, following = Pose(*poses[row]), Command(*twists[row + 1]) if row < last else STOP
        belief = belief if rows.joined[row] else None
        is_first = belief is None
        if belief is not None:
            belief = ekf.predict(belief, following, tuning, times[row] - times[row - 1], rule)
            if rows.due[row]:
                yield ekf.innovation(belief.mean, z), belief.covariance
                belief, _ = ekf.correct(belief, z, tuning.R)
        if rows.due[row] and is_first and row < last:
            begun = ekf.initialize(z, tuning).belief
            belief = ekf.predict(begun, following, tuning, times[row + 1] - times[row], rule)
