"""Wheels, gyro and the LiDAR's mount from a drive with odometry and scans alone: no truth, no map, no tape.

Scans tell lengths in the LiDAR's metres: ranges that are 1 % too long make `scale` 1 % too great, and nothing in such a drive
shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.models.angles import wrap, wrap_all
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.calibration.estimates import MOTIONS, CalibrationEstimate
from turtlebot_gym_lab.calibration.fit import Z
from turtlebot_gym_lab.evaluation.localize import RecordedScans, clocked, recorded_of
from turtlebot_gym_lab.scans.fit import NAMES, Array, Motions, ScanFit, begin, compose, driven, fit, relative
from turtlebot_gym_lab.scans.pairs import Pairs, paired

FINE = np.array([0.02, 0.03, 0.02, 0.015, 0.015, 0.03, 0.03])
"""Standard deviations up to which the parameters of `NAMES` count as determined."""
UNITS = ("", "", "rad/m", "m", "m", "rad", "s")
"""Units of `NAMES`."""
ALPHAS = (("alpha1", ""), ("alpha2", "m^2"), ("alpha3", "rad^2/m^2"), ("alpha4", ""))
"""The wheels' noise, with its units."""
ALPHAS_OFF = (0.1, 0.3, 0.25, 0.1)
"""Standard deviations of the alphas' logarithms beyond what the likelihood says, measured in simulated rooms: part of what
matches miss looks like noise of the wheels."""
CLEAR = 0.6
"""Standard deviation of a variance's logarithm up to which it counts as determined: that of 0.3 of its root."""
REMEDIES = {
    "scale": "drive 10 m or more",
    "turn_scale": "turn on the spot, both ways, for ten turns or more",
    "veer": "drive straight ahead, without turning, for 10 m or more",
    "mount_x": "turn on the spot, both ways, for ten turns or more",
    "mount_y": "turn on the spot, both ways, for ten turns or more",
    "mount_yaw": "drive straight ahead, without turning, for 10 m or more",
    "delay": "start and stop often, and turn both ways",
}
PASSES = 3
"""Passes: the mount of one aligns the beams of the next."""
FEWEST = 6
"""Fewest pairs to fit to."""
TURNED = 1.0
"""Least sum of turns, rad, that shows whether a LiDAR is upside down."""
MATCH = 2.0
"""Factor of the variances of matches to begin with."""


class ByScans(NamedTuple):
    """Wheels and mount by scans."""

    fit: ScanFit
    determined: NDArray[np.bool_]
    """Which of `NAMES` the drive determines, shape (7,); the others have their prior values."""
    mount: Pose
    """The LiDAR's pose on the robot."""
    delay: float
    """Time by which scans are older than stated, s."""
    upside_down: bool
    """Whether the beams run the other way round than stated."""
    recorded: RecordedScans
    """The scans with the mount and the delay found."""
    pairs: Pairs
    """By the last pass ..."""
    motions: Motions
    """... as they were fitted, without the delay."""
    odometry: Array
    """As recorded, its heading not wrapped, shape (T, 3)."""

    @property
    def path(self) -> Array:
        """The odometry corrected by the wheels found, shape (T, 3)."""
        return driven(self.odometry, self.fit.x)


def _placed(recorded: RecordedScans, turns: Array, mount: Pose, delay: float) -> RecordedScans:
    """Return scans of a LiDAR at some mount, older by a delay."""
    return recorded._replace(angles=turns + mount.theta, mount=(mount.x, mount.y), last=recorded.last - delay)


def by_scans(drive: Drive, progress: Callable[[str], None] = lambda done: None) -> ByScans:
    """Find wheels and mount from a drive's odometry and scans.

    Args:
        drive: With odometry and scans; its mount is where the search starts, and the prior of what is not determined.
        progress: Called with the name of each finished part.

    Raises:
        ValueError: If the drive has no odometry or no scans, or too few scans fit one another.
    """
    recorded = clocked(recorded_of(drive))
    stated = drive.scans[0].mount
    turns, mount, delay, mirrored = recorded.angles - stated.theta, stated, 0.0, False
    odometry = recorded.odometry.copy()
    odometry[:, 2] = np.unwrap(odometry[:, 2])
    prior = np.array([1.0, 1.0, 0.0, *stated, 0.0])
    free, x = np.ones(len(NAMES), np.bool_), prior
    path: Array = odometry
    variances = np.array([*_alphas_of(WHEEL.process), MATCH])
    done = 0
    while True:
        placed = _placed(recorded, turns, mount, delay)
        pairs = paired(placed, path, is_placed=done > 0)
        if len(pairs.first) < FEWEST:
            raise ValueError(
                f"{drive.around.label or 'the drive'}: only {len(pairs.first)} pairs of scans fit each other with motion "
                f"between them, {FEWEST} are needed: drive 10 m or more where walls are within the LiDAR's range."
            )
        m = Motions(
            recorded.time,
            odometry,
            recorded.rows[pairs.first],
            recorded.rows[pairs.second],
            pairs.motion,
            pairs.information,
            mount,
        )
        if done == 0 and not mirrored and _is_mirrored(m):
            mirrored, turns = True, -turns
            continue
        found = fit(m, begin(m) if done == 0 else np.array([*x[:6], 0.0]), variances, free)
        if done == PASSES - 1:
            break
        x, variances, delay, done = found.x, found.variances, delay + float(found.x[6]), done + 1
        mount, path = Pose(*x[3:6].tolist()), driven(odometry, x)
        progress("scans")
    determined = found.deviation * found.reach / 1.96 < FINE
    if not determined.all():
        # The rest is fitted with what is not determined at its prior.
        found = fit(m, np.where(determined, found.x, np.array([*prior[:6], -delay])), found.variances, determined)
        determined &= found.deviation * found.reach / 1.96 < FINE
    progress("fit")
    delay += float(found.x[6])
    found.x[5] = wrap(float(found.x[5]))
    mount = Pose(*found.x[3:6].tolist())
    return ByScans(found, determined, mount, delay, mirrored, _placed(recorded, turns, mount, delay), pairs, m, odometry)


def _alphas_of(process: Any) -> tuple[float, ...]:
    return process.alpha1, process.alpha2, process.alpha3, process.alpha4


def _is_mirrored(m: Motions) -> bool:
    """Return whether the scans turn the other way than the wheels."""
    turn = wrap_all(relative(m.odometry[m.first], m.odometry[m.second])[:, 2])
    both = turn * m.motion[:, 2]
    return bool(np.abs(turn).sum() > TURNED and both.sum() < -0.5 * np.abs(both).sum())


def with_truth(drive: Drive, found: ByScans) -> Drive:
    """Return a drive whose truth is the path by the scans, at the rows of key scans; it drifts, but slowly."""
    rows = found.recorded.rows
    poses, path = np.full((len(found.recorded.time), 3), np.nan), found.path
    last, pose = -1, None
    for k in range(len(found.pairs.first)):
        a, b = int(rows[found.pairs.first[k]]), int(rows[found.pairs.second[k]])
        if pose is None:
            pose = path[a]
        elif found.pairs.first[k] != last:
            pose = compose(pose, relative(path[int(rows[last])][None], path[a][None])[0])
        poses[a] = pose
        pose = compose(pose, found.pairs.motion[k])
        poses[b], last = pose, found.pairs.second[k]
    poses[:, 2] = wrap_all(poses[:, 2])
    return replace(drive, true_state=poses)


def estimates_of(found: ByScans) -> dict[str, CalibrationEstimate]:
    """Return the estimates of wheels, mount and alphas with their 95 % intervals."""
    estimates = {}
    values, half = [*found.fit.x[:6].tolist(), found.delay], (found.fit.reach * found.fit.deviation).tolist()
    for at, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
        is_determined = bool(found.determined[at])
        width = half[at] if is_determined else math.inf
        remedy = "" if is_determined else REMEDIES[name]
        value = values[at]
        estimates[name] = CalibrationEstimate(value=value, low=value - width, high=value + width, unit=unit, remedy=remedy)
    for at, (name, unit) in enumerate(ALPHAS):
        value, off = float(found.fit.variances[at]), math.hypot(float(found.fit.log_deviation[at]), ALPHAS_OFF[at])
        low, high = value * math.exp(-Z * off), value * math.exp(Z * off)
        remedy = "" if off < CLEAR else MOTIONS[name]
        estimates[name] = CalibrationEstimate(value=value, low=low, high=high, unit=unit, remedy=remedy)
    return estimates
