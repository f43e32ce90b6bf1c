"""Maximum likelihood with intervals, for any likelihood.

Parameters are searched in unbounded coordinates in which the likelihood is nearly quadratic: variances by their square
roots, probabilities by their arc sine. Each quadratic interval is checked, and replaced by that of the profile
likelihood where it does not hold.

References:
    Venzon, Moolgavkar, "A method for computing profile-likelihood-based confidence intervals", *Applied Statistics* 37 (1988).
    Pawitan, *In All Likelihood* (2001), sections 3.4 and 9.4: profiles, and intervals by Wald and by Wilks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import minimize, root_scalar

LEVEL = 0.95
"""Confidence level of the intervals."""
Z = float(stats.norm.ppf(0.5 + 0.5 * LEVEL))
"""Half width of that interval for a normal distribution, in standard deviations."""
STEP = 1e-3
"""First step of finite differences, in units of a coordinate's scale."""
QUADRATIC = 0.08
"""Tolerance on the root of the deviance, which should be `Z`, for a quadratic interval to hold."""
ACCURATE = 0.02
"""Tolerance on a profile's end, in standard deviations."""
FAR = 8.0
"""Standard deviations beyond which the search for an interval's end stops: the drive sets no bound."""
CONVERGED = 5e-3
"""Gain in log-likelihood below which no further step is made."""
BEND = (0.02, 0.3)
"""Target second difference of the cost for a finite-difference step: the step's square in standard deviations, others held."""
LONGEST = 3.0
"""Longest step, in units of a coordinate's scale."""
NEWTON, DESCENTS = 4, 8
"""Most evaluations of the second derivatives, and most steps with each."""

Vector = NDArray[np.float64]
Likelihood = Callable[[Vector], float]


class Fit(NamedTuple):
    """The maximum of a likelihood of n coordinates."""

    x: Vector
    """Coordinates of the maximum, shape (n,)."""
    value: float
    """Log-likelihood there."""
    information: Vector
    """Observed Fisher information, minus the second derivatives, shape (n, n)."""
    covariance: Vector
    """Inverse of the information; a direction that the drive does not determine has a huge variance."""

    @property
    def deviations(self) -> Vector:
        """Standard deviations of the coordinates, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def root(self, cost: Likelihood, x: Vector) -> float:
        """Return the root of the deviance at some coordinates, given the cost that `_finite` makes of the likelihood."""
        return math.sqrt(max(2.0 * (self.value + cost(x)), 0.0))


def _finite(likelihood: Likelihood) -> Likelihood:
    """Return the negative log-likelihood, or a large number where it is undefined."""

    def cost(x: Vector) -> float:
        try:
            value = likelihood(x)
        except ValueError:
            return 1e15
        return -value if math.isfinite(value) else 1e15

    return cost


def _gradient(cost: Likelihood, steps: Vector) -> Callable[[Vector], Vector]:
    def gradient(x: Vector) -> Vector:
        slopes = np.empty(len(x))
        for k, step in enumerate(steps):
            ahead, behind = x.copy(), x.copy()
            ahead[k] += step
            behind[k] -= step
            slopes[k] = (cost(ahead) - cost(behind)) / (2.0 * step)
        return slopes

    return gradient


def _curvature(cost: Likelihood, x: Vector, steps: Vector) -> Vector:
    """Return the second derivatives of a function by central differences, shape (n, n)."""
    n, middle = len(x), cost(x)
    curvature = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            along, across = steps[i] * np.eye(n)[i], steps[j] * np.eye(n)[j]
            if i == j:
                curvature[i, i] = (cost(x + along) - 2.0 * middle + cost(x - along)) / steps[i] ** 2
            else:
                rise = cost(x + along + across) - cost(x + along - across)
                rise = rise - cost(x - along + across) + cost(x - along - across)
                curvature[i, j] = curvature[j, i] = rise / (4.0 * steps[i] * steps[j])
    return curvature


def _inverse(information: Vector) -> Vector:
    """Return the inverse of an information matrix; a saddle's eigenvalues count by magnitude."""
    sizes = np.sqrt(np.maximum(np.abs(np.diag(information)), 1e-12))
    values, directions = np.linalg.eigh(information / np.outer(sizes, sizes))
    inverse = (directions / np.maximum(np.abs(values), 1e-4)) @ directions.T
    return inverse / np.outer(sizes, sizes)


def climb(likelihood: Likelihood, start: Vector, scales: Vector) -> tuple[Vector, float]:
    """Return an approximate maximum and the value there; see `maximize`."""
    cost = _finite(likelihood)

    def scaled(u: Vector) -> float:
        return cost(u * scales)

    slope = _gradient(scaled, np.full(len(start), STEP))
    result = minimize(scaled, start / scales, jac=slope, method="BFGS", options={"gtol": 0.1, "maxiter": 200})
    return result.x * scales, -float(result.fun)


def maximize(likelihood: Likelihood, start: Vector, scales: Vector) -> Fit:
    """Return the maximum of a likelihood.

    It is a function of n coordinates; ``scales`` are typical steps of these.
    """
    cost = _finite(likelihood)

    def scaled(u: Vector) -> float:
        return cost(u * scales)

    steps = np.full(len(start), STEP)
    u = climb(likelihood, start, scales)[0] / scales
    information, expected = np.eye(len(start)), math.inf
    for _ in range(NEWTON):
        if expected < CONVERGED:
            break
        steps = _steps(scaled, u, steps)
        information = _curvature(scaled, u, steps)
        u, expected = _descend(scaled, u, _inverse(information), steps)
    covariance = _inverse(information)
    return Fit(u * scales, -scaled(u), information / np.outer(scales, scales), covariance * np.outer(scales, scales))


def _steps(cost: Likelihood, x: Vector, steps: Vector) -> Vector:
    """Return steps beyond rounding within which a cost is quadratic."""
    value, sizes = cost(x), steps.copy()
    low, high = BEND
    for k in range(len(x)):
        for _ in range(20):
            off = sizes[k] * np.eye(len(x))[k]
            bend = cost(x + off) + cost(x - off) - 2.0 * value
            if low <= bend <= high or (bend < low and sizes[k] >= LONGEST):
                break
            sizes[k] *= 2.5 if bend < low else 0.4
    return np.minimum(sizes, LONGEST)


def _descend(cost: Likelihood, x: Vector, metric: Vector, steps: Vector) -> tuple[Vector, float]:
    """Descend by Newton steps with a fixed metric, the inverse of the second derivatives.

    Returns:
        The point reached, and how much lower the quadratic model puts the minimum.
    """
    value, expected, slope_of = cost(x), math.inf, _gradient(cost, steps)
    for _ in range(DESCENTS):
        slope = slope_of(x)
        move = -metric @ slope
        expected = -0.5 * float(slope @ move)
        if expected < CONVERGED:
            break
        share = 1.0
        while share > 0.1 and not cost(x + share * move) < value:
            share *= 0.5
        beyond = cost(x + share * move)
        if not beyond < value:
            break
        x, value = x + share * move, beyond
    return x, expected


def interval(likelihood: Likelihood, fit: Fit, at: int, *, least: float = -math.inf) -> tuple[float, float, bool]:
    """Return the interval of a coordinate; infinite on a side where the drive sets no bound.

    The quadratic interval holds if the deviance at its ends is as predicted, with the other coordinates at the
    quadratic's optimum.

    It begins at ``least`` if the drive does not exclude that.

    Returns:
        Its ends, and whether one of them comes from the profile likelihood.
    """
    cost = _finite(likelihood)
    deviation = fit.deviations[at]
    direction = fit.covariance[at] / fit.covariance[at, at]
    ends, is_profile = [], False
    for side in (-1.0, 1.0):
        if abs(fit.root(cost, fit.x + side * Z * deviation * direction) - Z) < QUADRATIC:
            ends.append(float(fit.x[at] + side * Z * deviation))
        else:
            is_profile = True
            ends.append(_profile_end(cost, fit, at, side, least))
    return ends[0], ends[1], is_profile


def _profile_end(cost: Likelihood, fit: Fit, at: int, side: float, least: float) -> float:
    """Return where the profile's deviance reaches that of the interval, on one side."""
    others = np.arange(len(fit.x)) != at
    deviation = fit.deviations[at]
    direction = fit.covariance[at] / fit.covariance[at, at]
    metric = _inverse(fit.information[np.ix_(others, others)])
    steps = 0.1 * np.minimum(np.sqrt(np.diag(metric)), np.maximum(fit.deviations[others], 1e-9))
    best = {0.0: fit.x}

    def root_at(distance: float) -> float:
        """Return the profile's root deviance at a distance, in deviations."""
        nearest = min(best, key=lambda known: abs(known - distance))
        x = best[nearest] + side * (distance - nearest) * deviation * direction
        x[at] = fit.x[at] + side * distance * deviation

        def rest(free: Vector) -> float:
            full = x.copy()
            full[others] = free
            return cost(full)

        if others.any():
            x[others], _ = _descend(rest, x[others], metric, steps)
        best[distance] = x
        return fit.root(cost, x)

    high = Z
    room = (fit.x[at] - least) / deviation if side < 0.0 else math.inf
    if room < 2.0 * Z:
        high = room
        if root_at(room) <= Z:
            return least
    low = 0.0
    while root_at(high) < Z:
        if high >= FAR * Z:
            return side * math.inf
        low, high = high, 2.0 * high
    distance = root_scalar(lambda far: root_at(far) - Z, bracket=(low, high), xtol=ACCURATE, rtol=ACCURATE).root
    return float(fit.x[at] + side * distance * deviation)
