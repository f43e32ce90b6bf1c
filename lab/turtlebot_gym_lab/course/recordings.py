"""The recorded drives of the second exercise, and the filter over them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import FilterTuning, Noise
from turtlebot_gym.drive import Drive
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import OdometryNoise
from turtlebot_gym_lab.evaluation.replay import replay

R = (0.03**2, 0.03**2, 0.02**2)
"""Variances of the measured poses; m^2, m^2, rad^2."""
DT = 0.1
"""Time between two rows, s."""
START = 10
"""First rows, in which the filter still converges and which do not count."""
_SLIP = (0.05, 0.25)
"""Standard deviations of the true speeds about those that the wheels report; m/s, rad/s."""


def recording(seed: int = 0, *, rows: int = 600) -> Drive:
    """Return a minute of driving: the twists that the wheels report, and the true poses."""
    rng = np.random.default_rng((seed, 2))
    reported = np.repeat(rng.uniform((0.05, -0.8), (0.2, 0.8), (rows // 20 + 1, 2)), 20, axis=0)[:rows]
    v, omega = (reported + rng.normal(size=(rows, 2)) * _SLIP).T
    headings = np.concatenate([[0.0], np.cumsum(omega[1:]) * DT])
    middle = headings[:-1] + 0.5 * omega[1:] * DT
    steps = np.stack([np.cos(middle), np.sin(middle)], axis=1) * (v[1:] * DT)[:, None]
    places = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    truth = np.column_stack([places, [wrap(heading) for heading in headings.tolist()], v, omega])
    return Drive(time=DT * np.arange(rows, dtype=np.float64), true_state=truth, twist=reported)


def filtered(drive: Drive, Q: Sequence[float], *, seed: int = 0) -> Drive:
    """Return a drive with the estimate and covariance of a filter with the variances Q, from a measured pose in each row."""
    noise = Noise(odometry=OdometryNoise(R=R))
    return replay(drive, noise=noise, filter=FilterTuning(Q=tuple(Q), R=R), seed=seed, rate=np.inf)


def honesty(drive: Drive) -> float:
    """Return the mean squared error of a filtered drive's pose relative to its stated covariance; 3 for an honest filter."""
    errors, stated = _errors(drive), drive.covariance[START:, :3, :3] + 1e-12 * np.eye(3)  # always invertible
    return float(np.einsum("ti,tij,tj->t", errors, np.linalg.inv(stated), errors).mean())


def size_of_errors(drive: Drive) -> float:
    """Return the root mean square error of a filtered drive's position, m."""
    return float(np.sqrt((_errors(drive)[:, :2] ** 2).sum(axis=1).mean()))


def _errors(drive: Drive) -> NDArray[np.float64]:
    errors = (drive.estimate - drive.true_state)[START:, :3]
    errors[:, 2] = [wrap(error) for error in errors[:, 2].tolist()]
    return errors
