"""Estimates of noise parameters, with their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym.calibration.coordinates import (
    PARAMETERS,
    PLAIN,
    VARIANCE,
    from_coordinates,
    natural_interval,
    to_coordinates,
    value_of,
    with_values,
)
from turtlebot_gym.calibration.fit import LEVEL, Fit, climb, interval, maximize, valley
from turtlebot_gym.parameters import Noise

NoiseLikelihood = Callable[[Noise], float]

SPIKES = ("spike_probability", "spike")
SPIKY = float(stats.chi2.ppf(0.999, 2))
"""Twice the gain in log-likelihood above which spikes are accepted."""
SPIKE_SIZES = (2.0, 4.0, 8.0)
"""Spike sizes at which the search starts, in standard deviations of the heading."""
SPREAD = (0.3, 1.0, 3.0)
"""Factors on the roots of variances at which a wide search starts."""

CLEAR = 0.3
"""Relative deviation up to which a variance, a probability or a size counts as determined."""
FINE = {"scale": 0.05, "bias_x": 0.1, "bias_y": 0.1, "bias_theta": 0.1}
"""Standard deviation up to which the other parameters count as determined."""

MOTIONS = {
    "alpha1": "drive straight ahead, fast, without turning, for 10 m or more",
    "alpha2": "turn on the spot, both ways, for ten turns or more",
    "alpha3": "drive straight ahead, fast, without turning, for 10 m or more",
    "alpha4": "turn on the spot, both ways, for ten turns or more",
    "scale": "drive 10 m or more",
    "bias_theta": "drive 10 m or more, so that the path shows the heading",
    "spike_probability": "record for longer",
    "spike": "record for longer",
}
"""The motion that determines a parameter."""
ONLY_TRUTH = {
    "bias_x": "a shift of all poses looks like another origin: record the truth",
    "bias_y": "a shift of all poses looks like another origin: record the truth",
}
"""Parameters that no motion determines without truth."""
HIDDEN = ("alpha1", "alpha3")
"""Parameters that the larger noise of measured poses hides; they seem determined by chance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What a drive says about one parameter."""

    value: float
    """The likeliest value."""
    low: float
    """Ends of the 95 % interval."""
    high: float
    unit: str
    is_profile: bool
    """Whether the interval comes from the profile likelihood, because the quadratic one is wrong."""
    is_determined: bool
    """Whether the drive determines the parameter."""
    remedy: str = ""
    """What would determine it, if the drive does not."""


def search(likelihood: NoiseLikelihood, start: Noise, names: Sequence[str], *, widely: bool = False) -> Fit:
    """Return the maximum of a likelihood over some parameters of a noise model.

    Args:
        likelihood: Log-likelihood as a function of a noise model.
        start: Start of the search.
        names: The parameters.
        widely: Also start elsewhere, and search without gradients first: for few data, whose likelihood has narrow valleys.
    """
    scales = np.array([PARAMETERS[name].scale for name in names])
    begin = to_coordinates(start, names)

    def of(x: NDArray[np.float64]) -> float:
        return likelihood(from_coordinates(start, names, x))

    if widely:
        spread = np.array([PARAMETERS[name].kind == VARIANCE for name in names])
        begins = [np.where(spread, share * begin, begin) for share in SPREAD]
        begin = max((valley(of, each, scales) for each in begins), key=lambda top: top[1])[0]
    return maximize(of, begin, scales)


def search_with_spikes(likelihood: NoiseLikelihood, start: Noise, names: Sequence[str]) -> tuple[tuple[str, ...], Noise, Fit]:
    """Return the fitted parameters, the start of their search, and the maximum; with spikes, if the drive has any.

    Args:
        likelihood: Log-likelihood as a function of a noise model.
        start: Start of the search, without spikes.
        names: All parameters, including those of spikes.
    """
    plain = tuple(name for name in names if name not in SPIKES)
    scales = np.array([PARAMETERS[name].scale for name in plain])
    x, without = climb(lambda x: likelihood(from_coordinates(start, plain, x)), to_coordinates(start, plain), scales)
    smooth = from_coordinates(start, plain, x)
    # Without spikes in the model, they were part of the variance.
    rest = {"spike_probability": 0.02, "R_theta": 0.8 * smooth.odometry.R[2]}
    sizes = [size * math.sqrt(smooth.odometry.R[2]) for size in SPIKE_SIZES]
    begin = max((with_values(smooth, {**rest, "spike": size}) for size in sizes), key=likelihood)
    spiky = search(likelihood, begin, names)
    if 2.0 * (spiky.value - without) > SPIKY:
        return tuple(names), begin, spiky
    return plain, smooth, search(likelihood, smooth, plain)


def estimates(
    likelihood: NoiseLikelihood, start: Noise, names: Sequence[str], fit: Fit, *, has_truth: bool
) -> dict[str, Estimate]:
    """Return values and intervals of parameters at the maximum of their likelihood.

    Args:
        likelihood: Log-likelihood as a function of a noise model.
        start: Values of the parameters that are not searched.
        names: The parameters that are searched.
        fit: The maximum.
        has_truth: Whether the truth was used.
    """
    likeliest = from_coordinates(start, names, fit.x)
    upright = fit._replace(x=np.where([PARAMETERS[name].kind == PLAIN for name in names], fit.x, np.abs(fit.x)))
    # Coordinates of variances have no sign: take the positive ones.
    signs = np.where(upright.x == fit.x, 1.0, -1.0)
    upright = upright._replace(
        information=fit.information * np.outer(signs, signs), covariance=fit.covariance * np.outer(signs, signs)
    )
    table = {}
    for at, name in enumerate(names):
        least = -math.inf if PARAMETERS[name].kind == PLAIN else 0.0
        ends = interval(lambda x: likelihood(from_coordinates(start, names, x)), upright, at, least=least)
        low, high = natural_interval(name, ends.low, ends.high)
        remedy = _remedy(name, upright.x[at], upright.deviations[at], low, high, has_truth=has_truth)
        table[name] = Estimate(
            value=value_of(likeliest, name),
            low=low,
            high=high,
            unit=PARAMETERS[name].unit,
            is_profile=ends.is_profile,
            is_determined=not remedy,
            remedy=remedy,
        )
    return table


def _remedy(name: str, x: float, deviation: float, low: float, high: float, *, has_truth: bool) -> str:
    """Return what would determine a parameter; nothing if the drive does."""
    if PARAMETERS[name].kind == PLAIN:
        clear = deviation <= FINE[name]
    else:
        clear = deviation <= CLEAR * abs(x) and low > 0.0 and high < math.inf
    is_hidden = name in HIDDEN and not has_truth
    if clear and not is_hidden:
        return ""
    remedy = MOTIONS.get(name, "record for longer")
    return f"record the truth, and {remedy}" if is_hidden else remedy


def of_share(happened: int, among: int, remedy: str) -> Estimate:
    """Return the probability of a counted event, with the interval by Jeffreys' prior.

    References:
        Brown, Cai, DasGupta, "Interval estimation for a binomial proportion", *Statistical Science* 16 (2001).
    """
    tail = 0.5 * (1.0 - LEVEL)
    posterior = stats.beta(happened + 0.5, among - happened + 0.5)
    low = 0.0 if happened == 0 else float(posterior.ppf(tail))
    high = 1.0 if happened == among else float(posterior.ppf(1.0 - tail))
    share = happened / among if among else 0.0
    return Estimate(
        value=share,
        low=low,
        high=high,
        unit="",
        is_profile=False,
        is_determined=among >= 100,
        remedy="" if among >= 100 else remedy,
    )
