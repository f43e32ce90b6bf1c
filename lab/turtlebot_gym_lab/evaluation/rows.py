"""A filter over the rows of a recorded drive, in a compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.compiled.program import compiled, in_machine_code
from turtlebot_gym.estimation.filters import filter_of, matrix
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.odometry import sense
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import advance
from turtlebot_gym.parameters import FilterTuning, OdometryNoise
from turtlebot_gym.values import Belief, Command, Odometry, Pose, Senses


class RecordedRows(NamedTuple):
    """A drive of T rows, in the form that the loop takes."""

    intervals: NDArray[np.float64]
    """Time since the row before, shape (T,), s; that of row 0 is not read."""
    truth: NDArray[np.float64]
    """True poses, shape (T, 3); m, m, rad."""
    wheels: NDArray[np.float64]
    """Poses by dead reckoning, shape (T, 3); m, m, rad."""
    commands: NDArray[np.float64]
    """Twist from a row to the next, shape (T, 2); m/s, rad/s."""
    recorded: NDArray[np.float64]
    """Poses that correct the filter, shape (T, 3); of shape (0, 3), they are measured from the true ones."""
    due: NDArray[np.bool_]
    """Rows at which a pose is measured, shape (T,)."""


class Filtered(NamedTuple):
    """What the filter was given and what it believed, row by row."""

    measured: NDArray[np.bool_]
    """Whether a pose was measured, shape (T,)."""
    odometry: NDArray[np.float64]
    """The last measured pose, shape (T, 3); m, m, rad."""
    estimate: NDArray[np.float64]
    """Mean of the belief, shape (T, 5)."""
    covariance: NDArray[np.float64]
    """Covariance of the pose, shape (T, 3, 3)."""


@kernel
def _pose(table: Any, row: int) -> Pose:
    return Pose(float(table[row, 0]), float(table[row, 1]), float(table[row, 2]))


@kernel
def _command(table: Any, row: int) -> Command:
    return Command(float(table[row, 0]), float(table[row, 1]))


@in_machine_code("dead reckoning of recordings")
def _roll(intervals: Any, twist: Any, pose: Any, integrator: float, poses: Any) -> None:
    for row in range(len(poses)):
        if row > 0:
            pose = advance(pose, float(twist[row, 0]), float(twist[row, 1]), float(intervals[row]), integrator)
        poses[row, 0], poses[row, 1], poses[row, 2] = pose


def rolled(intervals: NDArray[np.float64], twist: NDArray[np.float64], start: Pose, integrator: float) -> NDArray[np.float64]:
    """Return the poses to which a twist leads, shape (T, 3).

    Twists, shape (T, 2), lead from the row before to each row.
    """
    poses = np.empty((len(twist), 3))
    _roll(intervals, twist, start, integrator, poses)
    return poses


@kernel
def _measured(rows: RecordedRows, row: int, before: Odometry, noise: OdometryNoise, key: int) -> Odometry:
    """Return the odometry with the pose that is measured at a row."""
    twist = _command(rows.commands, row)
    if len(rows.recorded) > 0:
        return Odometry(_pose(rows.recorded, row), twist, True)
    return sense(_pose(rows.truth, row), _pose(rows.wheels, row), twist, before, noise, key, row)


@cache
def _loop_of(filter: Filter) -> Callable[..., None]:
    """Return the loop over rows of a filter; plain Python for one that is not made of kernels."""
    step = filter.step

    def follow(rows, now, estimate, tuning, noise, key, rule, measured, poses, beliefs):
        """Write from row 1 on whether a pose was measured, the last pose, and the numbers of the belief."""
        for row in range(1, len(poses)):
            before = now
            if rows.due[row]:
                now = _measured(rows, row, before, noise, key)
            else:
                now = Odometry(before.pose, _command(rows.commands, row), False)
            estimate = step(estimate, Senses(before), Senses(now), tuning, float(rows.intervals[row]), rule)
            measured[row] = now.measured
            poses[row, 0], poses[row, 1], poses[row, 2] = now.pose
            mean, covariance = estimate.belief
            for at in range(5):
                beliefs[row, at] = mean[at]
            for at in range(8):
                beliefs[row, 5 + at] = covariance[at]

    return compiled(follow, "filter of recordings") if filter.compiled else follow


def filtered(rows: RecordedRows, tuning: FilterTuning, noise: OdometryNoise, *, seed: int, integrator: float) -> Filtered:
    """Run a filter over the rows of a drive.

    The noise is that of poses measured from the true ones.
    """
    filter, key = filter_of(tuning), episode_key(seed, 0)
    first = Odometry(_pose(rows.truth, 0), _command(rows.commands, 0), True)
    now = _measured(rows, 0, first, noise, key)
    estimate = _moving(filter.start(Senses(now), tuning), now.twist)
    numbers: Any = (as_tuple(tuning), as_tuple(noise)) if filter.compiled else (tuning, noise)
    length, measured = len(rows.due), rows.due.copy()
    poses, beliefs = np.empty((length, 3)), np.empty((length, 13))
    poses[0], beliefs[0] = now.pose, (*estimate.belief.mean, *estimate.belief.covariance)
    _loop_of(filter)(rows, now, estimate, *numbers, key, integrator, measured, poses, beliefs)
    return Filtered(measured, poses, beliefs[:, :5], np.moveaxis(matrix(beliefs[:, 5:].T), -1, 0))


def _moving(estimate: Any, twist: Command) -> Any:
    """Set a twist in all beliefs of an estimate, since a recorded drive may begin in motion; whole numbers become floats."""
    if isinstance(estimate, Belief):
        estimate = estimate._replace(mean=estimate.mean._replace(v=twist.v, omega=twist.omega))
        return Belief(*(type(part)(*map(float, part)) for part in estimate))
    if isinstance(estimate, tuple):
        parts = [_moving(part, twist) for part in estimate]
        return type(estimate)(*parts) if hasattr(estimate, "_fields") else tuple(parts)
    return estimate if isinstance(estimate, bool) else float(estimate)
