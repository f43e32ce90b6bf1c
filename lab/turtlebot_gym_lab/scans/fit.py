"""Wheels and mount from pairs of scans: least squares with weights, and intervals by blocks.

If the wheels moved the robot by o between two scans, and the LiDAR is at m on it, the LiDAR moved by ``m^-1 o m``. What
differs from the motion by the scans is noise of the wheels, whose variances are fitted too, and of the match. Pairs far off
count less; the influence of each block of pairs on the fit gives intervals that hold although neighbours' errors are alike.

References:
    Censi, Franchi, Marchionni, Oriolo, "Simultaneous calibration of odometry and sensor parameters for mobile robots", *IEEE
    Transactions on Robotics* 29 (2013): the constraint, and what a drive must hold.
    Deray, Sola, Andrade-Cetto, "Joint on-manifold self-calibration of odometry model and sensor extrinsics using
    pre-integration", ECMR (2019): the wheels' noise between two scans.
    Efron, Tibshirani, *An Introduction to the Bootstrap* (1993), section 11: the jackknife.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.calibration.blocks import deviations_of

Array = NDArray[np.floating[Any]]

NAMES = ("scale", "turn_scale", "veer", "mount_x", "mount_y", "mount_yaw", "delay")
"""Parameters: those of `turtlebot_gym.parameters.ProcessNoise`; the LiDAR's pose; how old its scans are beyond their stamps."""
NUISANCE = ("alpha1", "alpha2", "alpha3", "alpha4", "match")
"""Variances: those of the wheels, and the factor of a match's own."""
STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3])
"""Steps of numerical derivatives."""
PRIOR = np.array([0.5, 0.5, 0.5, 0.5, 0.5, math.pi, 0.1])
"""Standard deviations of what is known before: so wide that they only keep the fit solvable."""
CUT = 16.0
"""Squared Mahalanobis distance from which a pair counts less: of three normal errors one in a thousand is beyond."""
ROUNDS, SETTLED = 30, 1e-7
"""Most Gauss-Newton steps, and the change at which they end."""
BLOCKS, LEAST_BLOCK = 30, 3
"""Most blocks, and fewest pairs of one."""
UNKNOWN = 1.0
"""Variance of a motion in a direction that a match does not determine, m^2 and rad^2."""
LEAST_ALPHA = 1e-7


WAY_OFF, TURN_OFF = (0.002, 0.0005), (0.001, 0.0003)
"""Errors of matches that repeat, because the same surfaces are seen again, ahead and to the left: as a share of the way, and
m per rad of the turn; measured in simulated rooms."""


class Motions(NamedTuple):
    """Odometry and pairs of scans, as the fit takes them."""

    time: Array
    """Shape (T,), s."""
    odometry: Array
    """Shape (T, 3); m, m, rad; its heading not wrapped."""
    first: NDArray[np.int64]
    """Rows of the first scans, shape (n,) ..."""
    second: NDArray[np.int64]
    """... and of the second ones."""
    motion: Array
    """Between them by the scans, with the LiDAR at `mount`, shape (n, 3); m, m, rad."""
    information: Array
    """Shape (n, 3, 3)."""
    mount: Pose
    """Where the LiDAR was taken to be."""


class ScanFit(NamedTuple):
    """A fit of wheels and mount."""

    x: Array
    """Values of `NAMES`."""
    deviation: Array
    """Their standard deviations, by blocks."""
    blocks: int
    variances: Array
    """Values of `NUISANCE`."""
    log_deviation: Array
    """Standard deviations of the logarithms of these."""
    errors: Array
    """Odometry's motions less those of the scans, shape (n, 3)."""
    weights: Array
    """Of the pairs, shape (n,)."""
    distance: Array
    """Squared Mahalanobis distances, shape (n,)."""

    @property
    def reach(self) -> float:
        """Standard deviations of half a 95 % interval."""
        return float(stats.t.ppf(0.975, max(self.blocks - 1, 1)))


def relative(first: Array, second: Array) -> Array:
    """Return poses in the frames of others, both of shape (n, 3); m, m, rad."""
    x, y, turn = (second - first).T
    cosine, sine = np.cos(first[:, 2]), np.sin(first[:, 2])
    return np.column_stack([cosine * x + sine * y, cosine * y - sine * x, turn])


def compose(first: Array, second: Array) -> Array:
    """Return the poses of frames within frames, shape (n, 3)."""
    cosine, sine = np.cos(first[..., 2]), np.sin(first[..., 2])
    x = first[..., 0] + cosine * second[..., 0] - sine * second[..., 1]
    y = first[..., 1] + sine * second[..., 0] + cosine * second[..., 1]
    return np.stack([x, y, first[..., 2] + second[..., 2]], axis=-1)


def inverse(pose: Array) -> Array:
    """Return the pose of the outer frame in the inner one, shape (..., 3)."""
    cosine, sine = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = -cosine * pose[..., 0] - sine * pose[..., 1], sine * pose[..., 0] - cosine * pose[..., 1]
    return np.stack([x, y, -pose[..., 2]], axis=-1)


def driven(odometry: Array, x: Array) -> Array:
    """Return the path of wheels with the parameters of `NAMES`, shape (T, 3), from the path by odometry, not wrapped."""
    scale, turn_scale, veer = x[:3]
    step, middle = np.diff(odometry, axis=0), 0.5 * (odometry[1:, 2] + odometry[:-1, 2])
    ahead, aside = (
        np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1],
        np.cos(middle) * step[:, 1] - np.sin(middle) * step[:, 0],
    )
    theta = odometry[0, 2] + np.concatenate([[0.0], np.cumsum(scale * (turn_scale * step[:, 2] + veer * ahead))])
    middle = 0.5 * (theta[1:] + theta[:-1])
    cosine, sine = scale * np.cos(middle), scale * np.sin(middle)
    moves = np.stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside], axis=1)
    return np.column_stack([odometry[0, :2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)]), theta])


def _later(time: Array, path: Array, rows: NDArray[np.int64], by: float) -> Array:
    """Return a path at some rows' times, moved by some seconds, shape (n, 3)."""
    at = time[rows] + by
    return np.column_stack([np.interp(at, time, path[:, k]) for k in range(3)])


def errors_of(m: Motions, x: Array) -> Array:
    """Return odometry's motions, as the LiDAR shows them, less those of the scans, shape (n, 3); m, m, rad."""
    path = driven(m.odometry, x)
    moved = relative(_later(m.time, path, m.first, -x[6]), _later(m.time, path, m.second, -x[6]))
    # With the LiDAR at another place than `mount`, the scans' points are in a frame that is off by d.
    d = compose(np.array([x[3], x[4], x[5]]), inverse(np.array(m.mount)))
    seen = compose(compose(inverse(d)[None], moved), np.broadcast_to(d, moved.shape))
    off = seen - m.motion
    off[:, 2] = wrap_all(off[:, 2])
    return off


def noise_of(m: Motions, x: Array) -> Array:
    """Return the covariances of the wheels' motions for each alpha of 1, shape (n, 4, 3, 3)."""
    path = driven(m.odometry, x)
    step, dt = relative(path[:-1], path[1:]), np.diff(m.time)
    share = 0.1 / np.maximum(dt, 1e-3)  # alphas are per 0.1 s
    way, turn = step[:, 0] ** 2 + step[:, 1] ** 2, step[:, 2] ** 2
    variances = np.stack([way * share, turn * share, way * share, turn * share], axis=1)
    result = np.zeros((len(m.first), 4, 3, 3))
    for k, (a, b) in enumerate(zip(m.first.tolist(), m.second.tolist(), strict=True)):
        within = relative(np.broadcast_to(path[a], (b - a, 3)), path[a:b])
        end = relative(path[a : a + 1], path[b : b + 1])[0]
        along = np.stack([np.cos(within[:, 2]), np.sin(within[:, 2]), np.zeros(b - a)], axis=1)
        turned = np.stack([within[:, 1] - end[1], end[0] - within[:, 0], np.ones(b - a)], axis=1)
        for at, columns in enumerate((along, along, turned, turned)):
            result[k, at] = np.einsum("k,ki,kj->ij", variances[a:b, at], columns, columns)
    return result


def _covariances(by_alpha: Array, matched: Array, variances: Array) -> Array:
    """Return the covariances of errors, shape (n, 3, 3)."""
    return np.einsum("a,naij->nij", variances[:4], by_alpha) + variances[4] * matched


def _variances(errors: Array, weights: Array, by_alpha: Array, matched: Array, start: Array) -> tuple[Array, Array]:
    """Return the likeliest variances, with the standard deviations of their logarithms, loosely tied to a start."""

    def loss(logs: Array) -> float:
        root = np.linalg.cholesky(_covariances(by_alpha, matched, np.exp(logs)))
        white = np.linalg.solve(root, errors[..., None])[..., 0]
        spread = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        return float((weights * (spread + 0.5 * (white**2).sum(axis=1))).sum() + 0.5 * (((logs - begin) / 3.0) ** 2).sum())

    begin = np.log(np.maximum(start, LEAST_ALPHA))
    best = optimize.minimize(loss, begin, method="L-BFGS-B", bounds=[(math.log(LEAST_ALPHA), 3.0)] * 4 + [(-1.0, 5.0)])
    steps, H = 0.1 * np.eye(5), np.zeros((5, 5))
    for i in range(5):
        for j in range(i + 1):
            corners = [loss(best.x + a * steps[i] + b * steps[j]) * a * b for a in (-1, 1) for b in (-1, 1)]
            H[i, j] = H[j, i] = sum(corners) / 0.04
    values, vectors = np.linalg.eigh(H)
    inverse_H = vectors @ np.diag(1.0 / np.maximum(values, 1.0 / 9.0)) @ vectors.T
    return np.exp(best.x), np.sqrt(np.diag(inverse_H))


def begin(m: Motions) -> Array:
    """Return where a fit starts: the mount's yaw from directions of motion, the scales from sizes."""
    moved = relative(m.odometry[m.first], m.odometry[m.second])
    turn_scale = float((moved[:, 2] * m.motion[:, 2]).sum() / max((moved[:, 2] ** 2).sum(), 1e-9))
    own, seen = moved[:, 0] + 1j * moved[:, 1], m.motion[:, 0] + 1j * m.motion[:, 1]
    straight = np.abs(m.motion[:, 2]) < 0.2
    rotation = (own * seen.conj())[straight].sum() if straight.any() else (own * seen.conj()).sum()
    yaw = float(np.angle(rotation)) if abs(rotation) > 0.0 else 0.0
    x = np.array([1.0, min(max(turn_scale, 0.3), 3.0), 0.0, *m.mount, 0.0])
    x[5] += yaw
    return x


def fit(m: Motions, start: Array, variances: Array, free: NDArray[np.bool_]) -> ScanFit:
    """Fit wheels and mount.

    Args:
        m: The motions.
        start: Values of `NAMES`, which those that are not free keep.
        variances: Values of `NUISANCE` to begin with.
        free: Which of `NAMES` are fitted, shape (7,).
    """
    x, n, weights = start.copy(), len(m.first), np.ones(len(m.first))
    matched = np.linalg.inv(m.information + np.eye(3) / UNKNOWN)
    names, logs = np.flatnonzero(free), np.zeros(5)
    by_alpha = noise_of(m, x)
    precision = np.diag(1.0 / PRIOR[names] ** 2)
    A, J, white = precision, np.zeros((n, 3, len(names))), np.zeros((n, 3))
    root = matched
    for round_ in range(ROUNDS):
        errors = errors_of(m, x)
        if round_ in (2, 5, 8):
            by_alpha = noise_of(m, x)
            variances, logs = _variances(errors, weights, by_alpha, matched, variances)
        root = np.linalg.cholesky(_covariances(by_alpha, matched, variances))
        slopes = []
        for k in names.tolist():
            up, down = x.copy(), x.copy()
            up[k] += STEPS[k]
            down[k] -= STEPS[k]
            change = errors_of(m, up) - errors_of(m, down)
            change[:, 2] = wrap_all(change[:, 2])
            slopes.append(change / (2.0 * STEPS[k]))
        J = np.linalg.solve(root, np.stack(slopes, axis=2))
        white = np.linalg.solve(root, errors[..., None])[..., 0]
        weights = np.minimum(CUT / np.maximum((white**2).sum(axis=1), 1e-9), 1.0) ** 2
        A = np.einsum("n,nki,nkj->ij", weights, J, J) + precision
        g = np.einsum("n,nki,nk->i", weights, J, white) + precision @ (x - start)[names]
        step = np.linalg.solve(A, g)
        x[names] -= step
        if round_ > 8 and np.abs(step).max() < SETTLED:
            break
    deviation, blocks = np.full(len(NAMES), np.inf), max(min(BLOCKS, n // LEAST_BLOCK), 1)
    repeated = _repeated(m, A, J, root, weights)
    # Where only the prior says something, no block moves the fit.
    by_blocks = np.maximum(_jackknife(A, J, white, weights, blocks), 0.5 * np.sqrt(np.diag(np.linalg.inv(A))))
    deviation[names] = np.hypot(by_blocks, repeated)
    return ScanFit(x, deviation, blocks, variances, logs, errors_of(m, x), weights, (white**2).sum(axis=1))


def _repeated(m: Motions, A: Array, J: Array, root: Array, weights: Array) -> Array:
    """Return standard deviations of a fit by errors of matches that repeat."""
    nothing, (x, y, turn) = np.zeros(len(m.first)), m.motion.T
    (along, across), (ahead, aside) = WAY_OFF, TURN_OFF
    kinds = ((along * x, along * y), (-across * y, across * x), (ahead * turn, nothing), (nothing, aside * turn))
    moves = []
    for x, y in kinds:
        white = np.linalg.solve(root, np.stack([x, y, nothing], axis=1)[..., None])[..., 0]
        moves.append(np.linalg.solve(A, np.einsum("n,nki,nk->i", weights, J, white)))
    return np.sqrt((np.array(moves) ** 2).sum(axis=0))


def _jackknife(A: Array, J: Array, white: Array, weights: Array, blocks: int) -> Array:
    """Return standard deviations of a fit by how much each block of pairs moves it."""
    if blocks < 2:
        return np.full(len(A), np.inf)
    moves = []
    for part in np.array_split(np.arange(len(J)), blocks):
        a = np.einsum("n,nki,nkj->ij", weights[part], J[part], J[part])
        g = np.einsum("n,nki,nk->i", weights[part], J[part], white[part])
        moves.append(np.linalg.solve(A - a, g))
    return deviations_of(np.array(moves))
