"""Measured against fitted errors: the data for a calibration's figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.calibration.calibrate import Calibration
from turtlebot_gym.calibration.likelihood import tuning_of
from turtlebot_gym.calibration.log import Log, known
from turtlebot_gym.calibration.segments import segment_rows
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import FilterTuning, Noise, OdometryNoise
from turtlebot_gym.values import STOP, Command, Pose

LENGTHS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Segment lengths for which the drift is shown, m."""
FEWEST = 3
"""Fewest segments for which the drift is shown."""


class Residuals(NamedTuple):
    """Errors of measured poses, n of them."""

    values: NDArray[np.float64]
    """Measured minus true pose, or minus the predicted one, without the bias; shape (n, 3); m, m, rad."""
    deviations: NDArray[np.float64]
    """Their standard deviations by the fit, without spikes, shape (n, 3)."""


class Drift(NamedTuple):
    """Error of wheel odometry at the end of segments, by length."""

    length: NDArray[np.float64]
    """Segment lengths, shape (m,), m."""
    segments: NDArray[np.intp]
    """Number of segments, shape (m,)."""
    measured: NDArray[np.float64]
    """Root mean square of the position's error and of the heading's, shape (m, 2); m, rad."""
    fitted: NDArray[np.float64]
    """The same as predicted by the noise model, shape (m, 2)."""


def residuals(found: Calibration) -> Residuals:
    """Return the errors of the measured poses against the truth if it was used; the innovations otherwise."""
    log, odometry = found.log, found.likeliest.odometry
    if found.has_truth:
        both = known(log.odometry) & known(log.truth)
        error = difference(log.odometry[both], log.truth[both] + odometry.bias)
        return Residuals(error, np.broadcast_to(np.sqrt(odometry.R), error.shape))
    return _innovations(log, found.likeliest, INTEGRATORS[found.integrator])


def _innovations(log: Log, noise: Noise, middle: float) -> Residuals:
    """Return the innovations of a filter matched to the noise, with spikes counted into R."""
    spiky = noise.odometry.spike_probability * noise.odometry.spike**2
    R = (*noise.odometry.R[:2], noise.odometry.R[2] + spiky)
    tuning = tuning_of(Noise(process=noise.process, odometry=OdometryNoise(R=R)))
    due, belief = known(log.odometry), None
    values, variances = [], []
    twists = (log.twist * noise.process.scale).tolist()
    poses = (log.odometry - noise.odometry.bias).tolist()
    for row in range(len(log.time) - 1):
        following = Command(*twists[row + 1])
        if belief is not None and log.joined[row]:
            dt = float(log.time[row] - log.time[row - 1])
            belief = ekf.predict(belief, following, tuning, dt, middle)
            if due[row]:
                z, P = Pose(*poses[row]), belief.covariance
                values.append(ekf.innovation(belief.mean, z))
                variances.append((P.xx + R[0], P.yy + R[1], P.tt + R[2] - spiky))
                belief, _ = ekf.correct(belief, z, tuning.R)
        elif due[row]:
            begun = ekf.initialize(Pose(*poses[row]), tuning).belief
            belief = ekf.predict(begun, following, tuning, float(log.time[row + 1] - log.time[row]), middle)
        else:
            belief = None
    return Residuals(np.array(values).reshape(-1, 3), np.sqrt(np.array(variances).reshape(-1, 3)))


def drift(found: Calibration, noise: Noise | None = None, *, lengths: Sequence[float] = LENGTHS) -> Drift:
    """Return the error of wheel odometry after some distances, and its prediction by a noise model.

    Args:
        found: The calibration, with truth.
        noise: The noise model; None for the one that was fitted.
        lengths: The distances, m.
    """
    model = (noise or found.likeliest).process
    tuning, middle = FilterTuning(Q=(0.0,) * 5, R=(0.0,) * 3, process=model), INTEGRATORS[found.integrator]
    rows = []
    for length in lengths:
        ends = segment_rows(found.log, length).due
        squares = _squares(found.log, ends, tuning, model.scale, middle)
        if len(squares) >= FEWEST:
            rows.append((length, len(squares), *np.sqrt(squares.mean(axis=0))))
    table = np.array(rows, np.float64).reshape(-1, 6)
    return Drift(table[:, 0], table[:, 1].astype(np.intp), table[:, 2:4], table[:, 4:6])


def _squares(log: Log, ends: NDArray[np.bool_], tuning: FilterTuning, scale: float, middle: float) -> NDArray[np.float64]:
    """Return the squared errors of position and heading at the ends of segments, and their variances, shape (n, 4)."""
    squares, belief = [], None
    twists, truth = (log.twist * scale).tolist(), log.truth.tolist()
    for row in range(len(log.time)):
        following = Command(*twists[row + 1]) if row + 1 < len(log.time) else STOP
        if belief is not None and log.joined[row]:
            dt = float(log.time[row] - log.time[row - 1])
            belief = ekf.predict(belief, following, tuning, dt, middle)
            if ends[row]:
                off, P = ekf.innovation(belief.mean, Pose(*truth[row])), belief.covariance
                squares.append((off.x**2 + off.y**2, off.theta**2, P.xx + P.yy, P.tt))
        elif not ends[row]:
            belief = None
        if ends[row] and row + 1 < len(log.time):
            begun = ekf.initialize(Pose(*truth[row]), tuning).belief
            belief = ekf.predict(begun, following, tuning, float(log.time[row + 1] - log.time[row]), middle)
    return np.array(squares, np.float64).reshape(-1, 4)
