"""Wheels from windows: least squares with a weak prior, clear of wrong poses, with intervals by blocks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from turtlebot_gym_lab.calibration.blocks import FEWEST, LONG, MOST, correlation, covariance_of
from turtlebot_gym_lab.calibration.windows import TOO_SHORT, USUAL, Array, Path, Windows, rest

TYPICAL = np.array([0.1, 0.3, 0.04, 0.007, 0.02, 0.02, 0.3, 0.3])
"""Standard deviations of parameters that a drive does not determine, in the order of `PARAMETERS`."""
LOOSE = np.array([1.0, 1.0, 3.0, 1.0, 1.5, 1.5, 1.0, 1.0])
"""Ratio of the prior to `TYPICAL` while it is found which parameters a drive determines."""
CLEAR = np.array([0.04, 0.08, 0.02, 0.0015, 0.008, 0.008, 0.1, np.inf])
"""Standard deviations up to which a drive determines a parameter ..."""
SEEN = 3.5
"""... and by how many of them one that is not so clear must differ from the usual."""
EVIDENT = 2.0
"""Standard deviations by which veer, drift and marker must differ from the usual: what is not evident is not taken for real."""
MAIN = np.array([True, True, False, False, False, False, False, True])
"""The scales and the delay, which count for themselves: the others have their usual values while those are judged."""
WIDE = 1e3
"""Ratio of the prior of determined parameters to `TYPICAL`: a drive that determines one is not drawn to the usual."""
REACH, STEP = 0.6, 0.05
"""Largest delay that is looked for, and the step of the search, s."""
GROSS, FLOOR = 8.0, np.array([0.05, 0.05, 0.1])
"""An error is gross, and not noise, beyond this many standard deviations (by its median) and these sizes, m, m, rad."""
ROUNDS = 12
"""Most rounds in which gross errors are looked for."""
COMPARED = 0.8
"""Share of the windows that are compared in the search for the delay: the rest may be gross."""
LEAST = 1e-7
"""Least standard deviation of an error, m and rad."""


class WheelFit(NamedTuple):
    """Wheels that were fitted to windows."""

    values: Array
    """In the order of `PARAMETERS`, shape (8,); the usual ones where the drive does not determine them."""
    covariance: Array
    """By blocks, shape (8, 8); what is not determined has that of the prior."""
    determined: NDArray[np.bool_]
    """Which parameters the drive determines, shape (8,)."""
    used: NDArray[np.bool_]
    """Which windows have no gross error, shape (n,)."""
    blocks: int
    """Number of blocks."""
    soft: Array
    """Values of all parameters, drawn to the usual ones by the prior: the best explanation of the windows, shape (8,)."""

    @property
    def deviations(self) -> Array:
        """Standard deviations, shape (8,)."""
        return np.sqrt(np.diag(self.covariance))


def fit_wheels(
    path: Path,
    windows: Windows,
    integrator: float = 0.5,
    given: Array | None = None,
    start: Array | None = None,
    covariance: Array | None = None,
) -> WheelFit:
    """Fit wheels to the windows of a drive.

    What the drive does not determine has its usual value, and its uncertainty counts for the others. Parameters, shape (8,),
    may be given, NaN for those to be fitted, and so may a start and the covariance of each window's error up to a factor.
    """
    blocks = min(int(_independent(windows)) // LONG, MOST)
    if blocks < FEWEST:
        raise ValueError(TOO_SHORT)
    whiten = None if covariance is None else np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), np.float64)
    unknown = np.ones(len(USUAL), np.bool_) if given is None else np.isnan(given)
    wheels = _begun(path, windows) if start is None else start.copy()
    usual = USUAL if given is None else np.where(unknown, USUAL, given)
    wheels, free = np.where(unknown, wheels, usual), np.zeros(len(USUAL), np.bool_)
    rounds = ROUNDS
    while True:  # what is freed is no longer drawn to the usual, and neither are the others because of it
        fit = _least_squares(path, windows, integrator, wheels, unknown, usual, _priors(free) * LOOSE, blocks, whiten)
        wheels, before = fit.values, free
        free, rounds = unknown & _determined(fit, usual), rounds - 1
        if (free == before).all() or not rounds:
            break
    determined, soft = free, fit.values
    free = unknown & (MAIN | free & (np.abs(wheels - usual) > EVIDENT * fit.deviations))
    while True:
        wheels = np.where(free, wheels, usual)
        fit = _least_squares(path, windows, integrator, wheels, free, usual, _priors(free), blocks, whiten, unknown)
        clear = _determined(fit, usual)
        if clear[free & MAIN].all():
            break
        free &= clear | ~MAIN
    return fit._replace(determined=np.where(MAIN, free, determined) & unknown, soft=soft)


def _determined(fit: WheelFit, usual: Array) -> NDArray[np.bool_]:
    """Return which parameters are known well, or but for the scales are not the usual ones beyond doubt, shape (8,)."""
    seen = (np.abs(fit.values - usual) > SEEN * fit.deviations) & (fit.deviations < 0.5 * TYPICAL * LOOSE) & ~MAIN
    return (fit.deviations <= CLEAR) | seen


def _priors(free: NDArray[np.bool_]) -> Array:
    """Return the standard deviations of the prior, if the drive determines some parameters."""
    return np.where(free, WIDE, 1.0) * TYPICAL


def _least_squares(
    path: Path,
    windows: Windows,
    integrator: float,
    wheels: Array,
    free: NDArray[np.bool_],
    usual: Array,
    priors: Array,
    blocks: int,
    whiten: Array | None,
    uncertain: NDArray[np.bool_] | None = None,
) -> WheelFit:
    """Return the fit of free parameters; the others keep their values, and if uncertain, their prior in the covariance."""
    uncertain = free if uncertain is None else uncertain
    off = rest(path, windows, wheels, integrator)
    used, dependent, prior = ~_gross(off), len(off) / _independent(windows), priors[free]
    rounds = ROUNDS
    while True:
        chosen, before = windows.chosen(used), used
        if whiten is None:
            sizes = np.maximum(np.sqrt((rest(path, chosen, wheels, integrator) ** 2).mean(axis=0)), LEAST)
            W = np.broadcast_to(np.diag(1.0 / sizes), (int(used.sum()), 3, 3))
        else:
            W = whiten[used]
            size = math.sqrt(float((_times(W, rest(path, chosen, wheels, integrator)) ** 2).mean()))
            W = W / max(size, LEAST)
        W = W / math.sqrt(dependent)

        def errors(x: Array, chosen: Windows = chosen, W: Array = W, wheels: Array = wheels) -> Array:
            tried = wheels.copy()
            tried[free] = x
            return np.append(_times(W, rest(path, chosen, tried, integrator)), (x - usual[free]) / prior)

        found = least_squares(errors, wheels[free], x_scale=np.minimum(prior, TYPICAL[free])).x
        moved = np.abs(found - wheels[free]) / TYPICAL[free]
        wheels = wheels.copy()
        wheels[free] = found
        off = rest(path, windows, wheels, integrator)
        white, used = _times(W, off[before]), ~_gross(off)
        again, dependent = dependent, correlation(white - white.mean(axis=0), blocks)
        rounds -= 1
        is_stable = moved.max(initial=0.0) < 1e-3 and abs(again / dependent - 1.0) < 0.1
        if not rounds or ((used == before).all() and is_stable):
            break
    J = np.zeros((int(before.sum()), 3, len(USUAL)))
    for at in np.flatnonzero(uncertain):
        step = 1e-4 * TYPICAL[at] * (np.arange(len(USUAL)) == at)
        change = rest(path, chosen, wheels + step, integrator) - rest(path, chosen, wheels - step, integrator)
        J[:, :, at] = _times(W, change) / (2.0 * step[at])
    scores, information = np.einsum("nij,ni->nj", J, white), np.einsum("nij,nik->njk", J, J)
    fixed = uncertain & ~free
    H = information.sum(axis=0)
    # What is not determined keeps what the prior leaves of it, and the others follow that.
    unsure = np.linalg.inv(H + np.diag(np.where(uncertain, priors, 1e-9) ** -2.0))[np.ix_(fixed, fixed)]
    follow = -np.linalg.solve(H[np.ix_(free, free)] + np.diag(prior**-2.0), H[np.ix_(free, fixed)])
    covariance = np.zeros((len(USUAL), len(USUAL)))
    by_blocks = covariance_of(scores[:, free], information[:, free][:, :, free], prior**-2.0, blocks)
    covariance[np.ix_(free, free)] = by_blocks + follow @ unsure @ follow.T
    covariance[np.ix_(fixed, fixed)] = unsure
    return WheelFit(wheels, covariance, free, used, blocks, wheels)


def _times(W: Array, off: Array) -> Array:
    """Return errors, shape (n, 3), each multiplied by its matrix."""
    return np.einsum("nij,nj->ni", W, off)


def _independent(windows: Windows) -> float:
    """Return how many windows fit in their time without overlap."""
    if len(windows.begin) < 2 * FEWEST:
        return 0.0
    return float((windows.end[-1] - windows.begin[0]) / np.median(windows.end - windows.begin))


def _gross(off: Array) -> NDArray[np.bool_]:
    """Return which windows have a gross error, shape (n,)."""
    size = 1.4826 * np.median(np.abs(off), axis=0)
    return np.asarray((np.abs(off) > np.maximum(GROSS * size, FLOOR)).any(axis=1))


def _begun(path: Path, windows: Windows) -> Array:
    """Return wheels whose scales and delay explain most of the windows, as a start."""
    x, y, turn = windows.moved.T
    half = 0.5 * turn
    arc = (x * np.cos(half) + y * np.sin(half)) / np.maximum(np.sinc(half / math.pi), 0.5)
    best = (math.inf, USUAL.copy())
    for late in np.arange(-REACH, REACH + 0.5 * STEP, STEP):
        wheels = np.append(USUAL[:-1], late)
        ends = [np.stack([np.interp(t - late, path.time, each) for each in path[1:3]]) for t in windows[:2]]
        way, turned = ends[1] - ends[0]
        # Headings are known up to whole turns; those of the wheels say which.
        true = turned + np.remainder(turn - turned + math.pi, 2.0 * math.pi) - math.pi
        (wheels[0], along), (turns, aside) = (_slope(a, b) for a, b in ((way, arc), (turned, true)))
        wheels[1] = turns / wheels[0]
        if (score := along + aside) < best[0]:
            best = (score, wheels)
    return best[1]


def _slope(told: Array, true: Array) -> tuple[float, float]:
    """Return the slope of most of some numbers against others, near 1, and the logarithm of the squares that it leaves."""
    slope, kept = 1.0, np.ones(len(told), np.bool_)
    for _ in range(5):
        power = float((told[kept] ** 2).sum())
        if not power > 1e-6 * len(told):
            break
        slope = min(max(float(told[kept] @ true[kept]) / power, 0.3), 3.0)
        off = np.abs(true - slope * told)
        kept = off <= np.quantile(off, COMPARED)
    return slope, math.log(float(((true - slope * told)[kept] ** 2).sum()) + 1e-12)
