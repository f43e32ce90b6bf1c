"""The execution of twists, fitted to poses whose covariance is known, such as those of scans in a map.

The likelihood of each pose is conditional on all earlier ones: between two of them the wheels move the belief, by the equations
of the core's filter. Errors of a map are the same in poses from nearly the same place, so only poses that are `APART` count.
Two factors on the covariances, for positions and headings, are fitted too, and so is the pose on the robot that was measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.drive import Drive, known
from turtlebot_gym.estimation.ekf import predict
from turtlebot_gym.estimation.update import innovation_variance, of_row, update, wrapped
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise
from turtlebot_gym.validation import choose
from turtlebot_gym.values import Belief, Command, Covariance, State
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, from_coordinates
from turtlebot_gym_lab.calibration.diagnosis import judge
from turtlebot_gym_lab.calibration.estimates import FEWEST, Likelihood, estimates_of, search
from turtlebot_gym_lab.calibration.execution import Execution, at_axle
from turtlebot_gym_lab.calibration.fit import Fit
from turtlebot_gym_lab.calibration.likelihood import tuning_of
from turtlebot_gym_lab.calibration.motions import Array
from turtlebot_gym_lab.calibration.regression import JUMP, MOST, ROUNDS

APART = (0.25, 0.5, 1.0, 2.0)
"""Distance between two poses that are used, m: the first at which errors are neither correlated nor of heavy tails."""
TURN = 0.25
"""Distance as which a turn by 1 rad counts, m."""
FITTED = ("R_x", "R_theta", "bias_x", "bias_y", "bias_theta", *ALPHAS, "scale", "turn_scale", "veer")
"""Fitted parameters: of a noise model whose R and bias are those of the poses, the bias in the robot's frame."""
MARKER = {"bias_x": "marker_x", "bias_y": "marker_y", "bias_theta": "marker_theta"}
LEAST = 1e-5
"""Least standard deviation of a pose, m and rad."""
WIDE = 1e4
"""Variance of the belief before the first pose, m^2 and rad^2."""


class Scanned(NamedTuple):
    """What is known of a drive's true poses, if they are those of scans in a map."""

    covariance: Array
    """Covariance of each pose, shape (T, 3, 3), up to a factor of positions and one of headings; m^2, m, rad^2."""
    period: float
    """Time over which a pose is measured, s: that of the revolution of a LiDAR, whose middle is the row's time."""


class Poses(NamedTuple):
    """A drive of T rows with poses at some of them, in the form that the loop takes."""

    time: Array
    """Shape (T,), s."""
    twist: Array
    """Shape (T, 2); row k's covers the interval from row k-1 to row k."""
    poses: Array
    """Shape (T, 3); m, m, rad."""
    whiteners: Array
    """Rows that make an error of a pose, in units of the usual deviations, white; shape (T, 3, 3), lower triangular."""
    due: NDArray[np.bool_]
    """Whether a row has a pose, shape (T,)."""
    joined: NDArray[np.bool_]
    """Whether a row continues the one before it, shape (T,)."""
    noise: Array
    """Share of the noise of the motion to each row that poses show, shape (T,)."""


@kernel
def _correct(
    belief: Belief, z: Any, whitener: Any, marker: Any, spread: tuple[float, float], white: Any
) -> tuple[Belief, float]:
    """Condition a belief on a pose; write its white innovation, and return its log-likelihood up to a constant."""
    prior, total = belief.mean, -2.0 * math.log(spread[0]) - math.log(spread[1])
    sine, cosine = sincos(prior.theta)
    forward, left = cosine * marker[0] - sine * marker[1], sine * marker[0] + cosine * marker[1]
    off_x, off_y = z[0] - prior.x - forward, z[1] - prior.y - left
    off_theta = wrap(z[2] - prior.theta - marker[2])
    for k in range(3):
        x, y, by_theta = whitener[k, 0] / spread[0], whitener[k, 1] / spread[0], whitener[k, 2] / spread[1]
        theta = by_theta - x * left + y * forward
        now = belief.mean
        moved = x * (now.x - prior.x) + y * (now.y - prior.y) + theta * (now.theta - prior.theta)
        h, off = of_row(belief.covariance, (x, y, theta)), x * off_x + y * off_y + by_theta * off_theta - moved
        belief, nis = update(belief, h, off, 1.0)
        S = innovation_variance(h, 1.0)
        white[k] = off / sqrt(S)
        total -= 0.5 * (math.log(S) + nis)
    return wrapped(belief), total


@kernel
def _calmed(belief: Belief, share: float) -> Belief:
    """Return a belief with a share of its twist's variances."""
    mean, P = belief
    return Belief(
        mean,
        Covariance(
            P.xx,
            P.xy,
            P.xt,
            P.xv,
            P.xw,
            P.yy,
            P.yt,
            P.yv,
            P.yw,
            P.tt,
            P.tv,
            P.tw,
            share * P.vv,
            P.vw,
            share * P.ww,
        ),
    )


@in_machine_code("likelihood of poses")
def _of_poses(time, twist, poses, whiteners, due, joined, noise, tuning, marker, spread, rule, white):
    total, running = 0.0, False
    nowhere = Covariance(WIDE, 0.0, 0.0, 0.0, 0.0, WIDE, 0.0, 0.0, 0.0, WIDE, 0.0, 0.0, 0.0, 0.0, 0.0)
    belief = Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), nowhere)
    for row in range(len(time)):
        after = min(row + 1, len(time) - 1)
        command = Command(twist[after, 0], twist[after, 1])
        running = running and joined[row]
        if running:
            belief = _calmed(predict(belief, command, tuning, time[row] - time[row - 1], rule), noise[after])
        if due[row]:
            if not running:
                belief = Belief(State(poses[row, 0], poses[row, 1], poses[row, 2] - marker[2], 0.0, 0.0), nowhere)
            belief, likelihood = _correct(belief, poses[row], whiteners[row], marker, spread, white[row])
            if running:
                total += likelihood
            else:  # at rest: nothing moves yet
                white[row] = math.nan
                belief = _calmed(predict(belief, command, tuning, time[after] - time[row], rule), noise[after])
            running = True
    return total


def _innovations(rows: Poses, model: Noise, integrator: str) -> tuple[float, Array]:
    """Return the log-likelihood of poses under a model of `FITTED`, and their white innovations, shape (T, 3), NaN for none."""
    R, white = model.odometry.R, np.full((len(rows.time), 3), np.nan)
    spread = max(math.sqrt(R[0]), LEAST), max(math.sqrt(R[2]), LEAST)
    tuning = as_tuple(tuning_of(Noise(process=model.process)))
    rule = choose("integrator", integrator, INTEGRATORS)
    return _of_poses(*rows, tuning, model.odometry.bias, spread, rule, white), white


def _likelihood(rows: Poses, integrator: str) -> Likelihood:
    return lambda model: _innovations(rows, model, integrator)[0]


def fit_poses(drive: Drive, truth: Scanned, start: Noise, integrator: str | None) -> Execution:
    """Fit the execution of twists to a drive whose truth is known with a covariance.

    Args:
        drive: The drive.
        truth: What is known of its true poses.
        start: Start of the search.
        integrator: "euler" or "midpoint"; None for the likelier one.

    Raises:
        ValueError: If fewer than `FEWEST` of the poses are `APART`.
    """
    fitted = None
    for apart in APART:
        due = _spaced(drive, apart)
        if due.sum() < FEWEST:
            break
        fitted = _fitted(drive, due, truth, start, integrator)._replace(segment=apart if apart > APART[0] else 0.0)
        if fitted.verdict.is_good and not fitted.verdict.is_correlated:
            break
    if fitted is None:
        raise ValueError(f"only {int(known(drive.truth).sum())} true poses are known, too few of them {APART[0]:g} m apart.")
    return fitted


def _rows(drive: Drive, due: NDArray[np.bool_], truth: Scanned) -> tuple[Poses, tuple[float, ...]]:
    """Return the form of a drive that the loop takes, and the usual variances of its poses."""
    covariance = truth.covariance[due]
    deviations = np.sqrt(np.median(np.diagonal(covariance, axis1=1, axis2=2), axis=0))
    position = math.sqrt(0.5 * float((deviations[:2] ** 2).sum()))
    usual = np.array([position, position, deviations[2]])
    whiteners = np.zeros_like(truth.covariance)
    whiteners[due] = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(usual, usual)))
    poses, noise = np.where(due[:, None], drive.truth, 0.0), _noise(drive, due, truth.period)
    return Poses(drive.time, drive.twist, poses, whiteners, due, drive.joined, noise), tuple((usual**2).tolist())


def _spaced(drive: Drive, apart: float) -> NDArray[np.bool_]:
    """Return at which rows there is a pose so far from the one before it, by the twist, shape (T,)."""
    motion = np.abs(drive.twist[1:]) @ np.array([1.0, TURN]) * np.diff(drive.time)
    way = np.concatenate([[0.0], np.cumsum(motion)])
    due, reached = np.zeros(len(drive), np.bool_), -math.inf
    for row in np.flatnonzero(known(drive.truth)).tolist():
        if way[row] >= reached:
            due[row], reached = True, way[row] + apart
    return due


def _noise(drive: Drive, due: NDArray[np.bool_], period: float) -> Array:
    """Return the share of the noise of each row's motion that poses show, shape (T,).

    A pose is a mean over its period: it shows two thirds of the variance of a random walk in it.
    """
    apart = np.abs(drive.time[due] - 0.5 * (drive.time[1:] + drive.time[:-1])[:, None]).min(axis=1)
    return np.concatenate([[1.0], np.where(apart < 0.5 * period, 2.0 / 3.0, 1.0)])


def _likeliest(rows: Poses, start: Noise, names: Sequence[str]) -> tuple[str, Fit, Array]:
    """Return the likeliest of some integrators, its fit, and the white innovations there."""
    fits = {name: search(_likelihood(rows, name), start, FITTED) for name in names}
    name = max(fits, key=lambda name: fits[name].value)
    return name, fits[name], _innovations(rows, from_coordinates(start, FITTED, fits[name].x), name)[1]


def _fitted(drive: Drive, due: NDArray[np.bool_], truth: Scanned, start: Noise, integrator: str | None) -> Execution:
    """Return the fit to some of the poses, without those that are far from where the others say."""
    rows, R = _rows(drive, due, truth)
    begun = replace(start, odometry=replace(start.odometry, R=R))
    names = tuple(INTEGRATORS) if integrator is None else (integrator,)
    jumps, (name, fit, white) = np.zeros(0, np.intp), _likeliest(rows, begun, names)
    for _ in range(ROUNDS):
        far = (np.abs(white) > JUMP).any(axis=1)
        if not far.any() or far.sum() > MOST * due.sum():
            break
        jumps, due = np.union1d(jumps, np.flatnonzero(far)), due & ~far
        rows = rows._replace(due=due)
        name, fit, white = _likeliest(rows, begun, names)
    best = from_coordinates(begun, FITTED, fit.x)
    table = estimates_of(_likelihood(rows, name), begun, FITTED, fit, has_truth=True)
    estimates = {MARKER.get(key, key): table[key] for key in FITTED if key not in ("R_x", "R_theta")}
    execution = Execution(
        noise=replace(best, odometry=start.odometry),
        estimates=estimates,
        verdict=judge(white[np.isfinite(white).all(axis=1)], len(jumps), int(due.sum())),
        integrator=name,
        segment=0.0,
        segments=int(due.sum()),
        truth_deviations=(math.sqrt(best.odometry.R[0]), math.sqrt(best.odometry.R[2])),
        jumps=jumps,
        drive=drive,
    )
    marker = [estimates[key].value * execution.is_seen(key) for key in MARKER.values()]
    return execution._replace(drive=at_axle(drive, *marker))
