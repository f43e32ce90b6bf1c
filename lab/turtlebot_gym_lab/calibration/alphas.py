"""The noise of the execution from whole pieces of a drive: its alphas, likeliest for the errors at the ends of pieces.

The covariance of a piece's end is linear in the alphas, and sums over the rows of the drive give it for all pieces at once.
Over longer pieces it holds what errors that last add up to, which white noise of rows does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym_lab.calibration.blocks import FEWEST, LONG, MOST, covariance_of
from turtlebot_gym_lab.calibration.windows import TOO_SHORT, Array, Path, driven, rest, windows_of

SPREAD = np.array([2.5, 2.5, 2.5, 2.5, 1.5, 1.5])
"""Standard deviations of the prior of the logarithms of alphas and of the truth's standard deviations: factors of 12 and 4."""
TRUTH = 1e-3
"""Usual standard deviation of a truth, m and rad: that of motion capture."""
ROUNDS, LONGEST = 100, 1.0
"""Most steps of the search, and the longest one of a logarithm."""
EXACT = 1e-12
"""Variance that each error has in any case, m^2 and rad^2."""


class Pieces(NamedTuple):
    """The ends of n pieces of a drive."""

    off: Array
    """What the wheels leave unexplained, shape (n, 3); ahead and left of the beginning, m, and rad."""
    parts: Array
    """Covariance of that for each alpha of 1, and for the truth's variances of 1, shape (n, 6, 3, 3)."""
    way: Array
    """Position in the frame of the beginning, shape (n, 2), m."""

    def covariance(self, variances: Array) -> Array:
        """Return the covariances for four alphas and two variances of the truth, shape (n, 3, 3)."""
        return _covariance(self.parts, variances)

    def nees(self, variances: Array) -> Array:
        """Return the normalized squared errors, shape (n,): 3 in the mean for the right variances."""
        return np.einsum("ni,ni->n", self.off, np.linalg.solve(self.covariance(variances), self.off[..., None])[..., 0])


def pieces_of(
    path: Path, truth: Array, wheels: Array, integrator: float, length: float, *, overlap: int = 1, by_way: bool = False
) -> Pieces:
    """Return the pieces of a drive of one length.

    A length, m, counts turns too, unless `by_way`; as many pieces as ``overlap`` begin in it. Unknown poses of the truth are
    NaN.
    """
    windows = windows_of(path, truth, length, overlap=overlap, by_way=by_way)
    off = rest(path, windows, wheels, integrator)
    poses = driven(path, wheels, path.time, integrator)
    first, last = (np.searchsorted(path.time, times) for times in (windows.begin, windows.end))
    steps = np.stack([np.diff(path.way), np.diff(path.turn)]) ** 2 * (REFERENCE_PERIOD / np.diff(path.time))
    middle = 0.5 * (poses[1:] + poses[:-1]).T
    x, y = middle[:2] - poses[:, :2].mean(axis=0)[:, None]
    sine, cosine = np.sin(middle[2]), np.cos(middle[2])
    scale, turn_scale = wheels[:2]
    shapes = np.stack([cosine**2, cosine * sine, sine**2, np.ones_like(x), x, y, x * x, x * y, y * y])
    sums = np.pad(np.cumsum(steps[:, None] * shapes, axis=2), ((0, 0), (0, 0), (1, 0)))
    total = sums[..., last] - sums[..., first]
    end_x, end_y = (poses[last, :2] - poses[:, :2].mean(axis=0)).T
    parts = np.zeros((len(off), 6, 3, 3))
    for at, (cc, cs, ss, n, sx, sy, sxx, sxy, syy) in enumerate(total):  # by the speed, by the turning rate
        parts[:, at, 0, 0], parts[:, at, 1, 1] = scale**2 * cc, scale**2 * ss
        parts[:, at, 0, 1] = parts[:, at, 1, 0] = scale**2 * cs
        # What is left to drive from the middle of a step is the lever of its turn.
        share = (scale * turn_scale) ** 2
        turned = parts[:, 2 + at]
        turned[:, 0, 0] = share * (end_y**2 * n - 2.0 * end_y * sy + syy)
        turned[:, 1, 1] = share * (end_x**2 * n - 2.0 * end_x * sx + sxx)
        turned[:, 0, 1] = turned[:, 1, 0] = -share * (end_x * end_y * n - end_x * sy - end_y * sx + sxy)
        turned[:, 0, 2] = turned[:, 2, 0] = -share * (end_y * n - sy)
        turned[:, 1, 2] = turned[:, 2, 1] = share * (end_x * n - sx)
        turned[:, 2, 2] = share * n
    parts[:, 0:4] = _rotated(parts[:, 0:4], poses[first, 2] + wheels[6])
    moved = windows.moved[:, :2]
    parts[:, 4, 0, 0] = parts[:, 4, 1, 1] = 2.0
    at_start = np.column_stack([moved[:, 1], -moved[:, 0], -np.ones(len(moved))])  # the truth's heading there turns the frame
    parts[:, 5] = at_start[:, :, None] * at_start[:, None, :]
    parts[:, 5, 2, 2] += 1.0
    return Pieces(off, parts, moved)


def _rotated(parts: Array, heading: Array) -> Array:
    """Return covariances of the world in frames with some headings."""
    R = np.zeros((len(heading), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(heading)
    R[:, 0, 1], R[:, 1, 0], R[:, 2, 2] = np.sin(heading), -np.sin(heading), 1.0
    return np.einsum("nij,nkjl,nml->nkim", R, parts, R)


def _covariance(parts: Array, variances: Array) -> Array:
    return np.tensordot(parts, variances, axes=(1, 0)) + EXACT * np.eye(3)


class AlphaFit(NamedTuple):
    """Alphas and the standard deviations of the truth that were fitted to pieces."""

    logarithms: Array
    """Of four alphas and of two standard deviations of the truth, m and rad; shape (6,)."""
    covariance: Array
    """By blocks, with the prior, shape (6, 6)."""
    blocks: int
    """Number of blocks."""

    @property
    def variances(self) -> Array:
        """Alphas, and variances of the truth, shape (6,)."""
        return np.exp(self.logarithms * _POWERS)


_POWERS = np.array([1.0, 1.0, 1.0, 1.0, 2.0, 2.0])


def fit_alphas(sets: Sequence[Pieces], usual: Sequence[float]) -> AlphaFit:
    """Return the likeliest alphas for pieces of some lengths, which count together as much as those of the last length alone.

    The sets do not overlap; the usual alphas are the prior.

    Raises:
        ValueError: If there are none.

    References:
        Jennrich, Schluchter, "Unbalanced repeated-measures models with structured covariance matrices", *Biometrics* 42 (1986):
            Fisher scoring.
    """
    sets = [each for each in sets if len(each.off)]
    if not sets:
        raise ValueError(TOO_SHORT)
    off, parts = np.concatenate([each.off for each in sets]), np.concatenate([each.parts for each in sets])
    number = len(sets[-1].off)
    weights = np.concatenate([np.full(len(each.off), number / (len(sets) * len(each.off))) for each in sets])
    order = np.argsort(np.concatenate([np.linspace(0.0, 1.0, len(each.off)) for each in sets]), kind="stable")
    off, parts, weights = off[order], parts[order], weights[order]
    centre = np.log([*usual, TRUTH, TRUTH])
    prior = SPREAD**-2.0

    def terms(u: Array) -> tuple[float, Array, Array]:
        variances = np.exp(u * _POWERS)
        C = _covariance(parts, variances)
        inverse = np.linalg.inv(C)
        white = np.einsum("nij,nj->ni", inverse, off)
        scaled = np.einsum("nij,nkjl->nkil", inverse, parts) * (variances * _POWERS)[None, :, None, None]
        fitted = np.einsum("nkii->nk", scaled)
        found = np.einsum("ni,nkij,nj->nk", white, parts, white) * (variances * _POWERS)
        scores = 0.5 * weights[:, None] * (found - fitted)
        information = 0.5 * np.einsum("n,nkij,nlji->nkl", weights, scaled, scaled)
        cost = 0.5 * float(weights @ (np.linalg.slogdet(C)[1] + np.einsum("ni,ni->n", off, white)))
        return cost + 0.5 * float(prior @ (u - centre) ** 2), scores, information

    u = centre.copy()
    cost, scores, information = terms(u)
    for _ in range(ROUNDS):
        move = np.linalg.solve(information.sum(axis=0) + np.diag(prior), scores.sum(axis=0) - prior * (u - centre))
        move *= min(1.0, LONGEST / max(float(np.abs(move).max()), 1e-12))
        while True:
            tried = terms(u + move)
            if tried[0] <= cost or np.abs(move).max() < 1e-6:
                break
            move *= 0.5
        u, (cost, scores, information) = u + move, tried
        if np.abs(move).max() < 1e-4:
            break
    blocks = min(max(number // LONG, FEWEST), MOST)
    return AlphaFit(u, covariance_of(scores, information, prior, blocks), blocks)


def intervals(fit: AlphaFit, half: float) -> tuple[Array, Array]:
    """Return the ends of the intervals of the alphas, shape (4,) each, for half a width in standard deviations."""
    off = half * np.sqrt(np.diag(fit.covariance))[:4]
    return np.exp(fit.logarithms[:4] - off), np.exp(np.minimum(fit.logarithms[:4] + off, math.log(1e3)))
