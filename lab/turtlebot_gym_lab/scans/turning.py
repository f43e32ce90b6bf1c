"""Scale and bias of a gyro against the turns by scans, which need neither wheels nor mount."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from turtlebot_gym.drive import Drive
from turtlebot_gym_lab.calibration.blocks import deviations_of
from turtlebot_gym_lab.scans.calibrating import ByScans
from turtlebot_gym_lab.scans.fit import Array

KNOWN = 0.9
"""Least share of rows with a gyro."""
ROUNDS, FAR = 10, 3.0
"""Rounds in which weights are found, and median deviations at which a pair's weight has fallen to a quarter."""


class GyroByScans(NamedTuple):
    """A gyro against the turns by scans: values with their 95 % intervals."""

    scale: tuple[float, float, float]
    """True turn over that by the gyro without its bias."""
    bias: tuple[float, float, float]
    """rad/s"""


def _solved(A: Array, turns: Array, weights: Array) -> Array:
    root = np.sqrt(weights)
    return np.linalg.lstsq(A * root[:, None], turns * root, rcond=None)[0]


def gyro_by_scans(drive: Drive, found: ByScans) -> GyroByScans | None:
    """Return scale and bias of a drive's gyro; None if it has none."""
    good = np.isfinite(drive.gyro)
    if good.mean() < KNOWN:
        return None
    rate = np.interp(drive.time, drive.time[good], drive.gyro[good])
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(drive.time))])
    time, rows, turns = found.recorded.time, found.recorded.rows, found.pairs.motion[:, 2]
    begin, end = time[rows[found.pairs.first]], time[rows[found.pairs.second]]
    A = np.column_stack([np.interp(end, drive.time, turned) - np.interp(begin, drive.time, turned), end - begin])
    weights = np.ones(len(A))
    for _ in range(ROUNDS):
        off = turns - A @ _solved(A, turns, weights)
        weights = 1.0 / (1.0 + (off / (FAR * 1.4826 * float(np.median(np.abs(off))) + 1e-9)) ** 2) ** 2
    scale, drift = _solved(A, turns, weights)
    number, blocks = np.arange(len(A)), found.fit.blocks
    left = [np.setdiff1d(number, part) for part in np.array_split(number, blocks)]
    moves = np.array([_solved(A[rest], turns[rest], weights[rest]) for rest in left])
    half = found.fit.reach * deviations_of(moves) / np.array([1.0, abs(scale)])
    bias = -drift / scale
    a, b = (tuple(float(value + side * off) for side in (0, -1, 1)) for value, off in ((scale, half[0]), (bias, half[1])))
    return GyroByScans((a[0], a[1], a[2]), (b[0], b[1], b[2]))
