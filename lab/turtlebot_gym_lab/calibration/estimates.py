"""Estimates of noise parameters with their intervals: fitted to the truth, or to the innovations alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym.config import choose
from turtlebot_gym.drive import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym_lab.calibration.coordinates import (
    ALPHAS,
    MEASURED,
    PARAMETERS,
    PLAIN,
    from_coordinates,
    natural_interval,
    to_coordinates,
    value_of,
    with_values,
)
from turtlebot_gym_lab.calibration.fit import LEVEL, Fit, climb, interval, maximize
from turtlebot_gym_lab.calibration.likelihood import Rows, innovations

Likelihood = Callable[[Noise], float]

SPIKES = ("spike_probability", "spike")
HEADINGS = ("R_theta", "bias_theta", *SPIKES)
"""Parameters of a measured heading; those of a position are the mean and the variance of its error."""
SPIKY = float(stats.chi2.ppf(0.999, 2))
"""Twice the gain in log-likelihood above which spikes are accepted."""
SPIKE_SIZES = (2.0, 4.0, 8.0)
"""Spike sizes at which the search starts, in standard deviations of the heading."""

CLEAR = 0.3
"""Relative deviation up to which a variance, a probability or a size counts as determined."""
FINE = {
    **dict.fromkeys(("bias_x", "bias_y", "bias_theta", "marker_theta"), 0.1),
    **dict.fromkeys(("scale", "turn_scale", "veer", "marker_x", "marker_y"), 0.05),
    "drift": 0.01,
}
"""Standard deviation up to which the other parameters count as determined."""

MOTIONS = {
    "alpha1": "drive straight ahead, fast, without turning, for 10 m or more",
    "alpha2": "turn on the spot, both ways, for ten turns or more",
    "alpha3": "drive straight ahead, fast, without turning, for 10 m or more",
    "alpha4": "turn on the spot, both ways, for ten turns or more",
    "scale": "drive 10 m or more",
    "turn_scale": "turn on the spot, both ways, for ten turns or more",
    "veer": "drive straight ahead, without turning, for 10 m or more",
    "drift": "stand still for a minute",
    "marker_x": "turn on the spot, both ways, for ten turns or more",
    "marker_y": "turn on the spot, both ways, for ten turns or more",
    "marker_theta": "drive straight ahead, without turning, for 10 m or more",
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

POSE, WHEELS = "pose", "wheel"
"""Odometry that measures the pose, and odometry that integrates the wheels."""
FEWEST = 6
"""Fewest poses, motions or segments to which anything is fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationEstimate:
    """What a drive says about one parameter."""

    value: float
    """The likeliest value."""
    low: float
    """Ends of the 95 % interval."""
    high: float
    unit: str = ""
    remedy: str = ""
    """What would determine it, if the drive does not."""
    is_profile: bool = False
    """Whether the interval comes from the profile likelihood, because the quadratic one is wrong."""

    @property
    def is_determined(self) -> bool:
        """Whether the drive determines the parameter."""
        return not self.remedy


def search(likelihood: Likelihood, start: Noise, names: Sequence[str]) -> Fit:
    """Return the maximum of a likelihood over some parameters of a noise model."""
    scales = np.array([PARAMETERS[name].scale for name in names])
    return maximize(lambda x: likelihood(from_coordinates(start, names, x)), to_coordinates(start, names), scales)


def _search_with_spikes(likelihood: Likelihood, start: Noise, names: Sequence[str]) -> tuple[tuple[str, ...], Noise, Fit]:
    """Return the fitted parameters, the start of their search, and the maximum; with spikes, if the drive has any."""
    plain = tuple(name for name in names if name not in SPIKES)
    scales = np.array([PARAMETERS[name].scale for name in plain])
    x, without = climb(lambda x: likelihood(from_coordinates(start, plain, x)), to_coordinates(start, plain), scales)
    smooth = from_coordinates(start, plain, x)
    # Without spikes in the model, they were part of the variance.
    spikes = {"spike_probability": 0.02, "R_theta": 0.8 * smooth.odometry.R[2]}
    sizes = [size * math.sqrt(smooth.odometry.R[2]) for size in SPIKE_SIZES]
    begin = max((with_values(smooth, {**spikes, "spike": size}) for size in sizes), key=likelihood)
    spiky = search(likelihood, begin, names)
    if 2.0 * (spiky.value - without) > SPIKY:
        return tuple(names), begin, spiky
    return plain, smooth, search(likelihood, smooth, plain)


def estimates_of(
    likelihood: Likelihood, start: Noise, names: Sequence[str], fit: Fit, *, has_truth: bool
) -> dict[str, CalibrationEstimate]:
    """Return values and intervals of parameters at the maximum of their likelihood."""
    likeliest = from_coordinates(start, names, fit.x)
    kinds = np.array([PARAMETERS[name].kind for name in names])
    signs = np.where((fit.x < 0.0) & (kinds != PLAIN), -1.0, 1.0)  # coordinates of variances have no sign: take the positive
    products = np.outer(signs, signs)
    fit = fit._replace(x=signs * fit.x, information=fit.information * products, covariance=fit.covariance * products)

    def of(x: NDArray[np.float64]) -> float:
        return likelihood(from_coordinates(start, names, x))

    table = {}
    for at, name in enumerate(names):
        low, high, is_profile = interval(of, fit, at, least=-math.inf if kinds[at] == PLAIN else 0.0)
        low, high = natural_interval(name, low, high)
        table[name] = CalibrationEstimate(
            value=value_of(likeliest, name),
            low=low,
            high=high,
            unit=PARAMETERS[name].unit,
            remedy=remedy_of(name, fit.x[at], fit.deviations[at], low, high, has_truth=has_truth),
            is_profile=is_profile,
        )
    return table


def remedy_of(name: str, x: float, deviation: float, low: float, high: float, *, has_truth: bool) -> str:
    """Return what would determine a parameter; nothing if the drive does."""
    limit = CLEAR * abs(x) if low > 0.0 and high < math.inf else -math.inf
    clear = deviation <= FINE.get(name, limit)
    is_hidden = name in HIDDEN and not has_truth
    if clear and not is_hidden:
        return ""
    remedy = MOTIONS.get(name, "record for longer")
    return f"record the truth, and {remedy}" if is_hidden else remedy


def of_share(happened: int, among: int, remedy: str) -> CalibrationEstimate:
    """Return the probability of a counted event, with the interval by Jeffreys' prior.

    References:
        Brown, Cai, DasGupta, "Interval estimation for a binomial proportion", *Statistical Science* 16 (2001).
    """
    tail = 0.5 * (1.0 - LEVEL)
    posterior = stats.beta(happened + 0.5, among - happened + 0.5)
    low = 0.0 if happened == 0 else float(posterior.ppf(tail))
    high = 1.0 if happened == among else float(posterior.ppf(1.0 - tail))
    share = happened / among if among else 0.0
    return CalibrationEstimate(value=share, low=low, high=high, remedy="" if among >= 100 else remedy)


def by_truth(drive: Drive, start: Noise, truth_deviations: tuple[float, float]) -> tuple[Noise, dict[str, CalibrationEstimate]]:
    """Fit the noise of measured poses to the truth, and return the likeliest model and what was fitted.

    The truth has standard deviations of its own, m and rad; only the model's odometry is fitted.

    Raises:
        ValueError: If fewer than `FEWEST` measured poses have a true one beside them.
    """
    are_known = known(drive.odometry) & known(drive.truth)
    error = difference(drive.odometry[are_known], drive.truth[are_known])
    n = len(error)
    if n < FEWEST:
        raise ValueError(f"only {n} measured poses have a true one beside them.")
    table, R, bias = {}, [], []
    for at, axis in enumerate(("x", "y")):
        R.append(_variance(error[:, at], truth_deviations[0] ** 2))
        bias.append(_mean(error[:, at]))
        table |= {f"R_{axis}": R[at], f"bias_{axis}": bias[at]}
    begin = replace(
        start.odometry,
        R=(*(max(variance.value, 0.0) for variance in R), max(float(error[:, 2].var()), 1e-12)),
        bias=(*(mean.value for mean in bias), float(error[:, 2].mean())),
    )

    def likelihood(model: Noise) -> float:
        return _of_headings(error[:, 2], model.odometry, truth_deviations[1] ** 2)

    names, base, best = _search_with_spikes(likelihood, replace(start, odometry=begin), HEADINGS)
    table |= estimates_of(likelihood, base, names, best, has_truth=True)
    return from_coordinates(base, names, best.x), table


def _variance(errors: NDArray[np.float64], known_variance: float) -> CalibrationEstimate:
    """Return the variance of normal errors beyond a known one, with the interval by chi-square."""
    n, variance = len(errors), float(errors.var(ddof=1))
    low, high = (n - 1) * variance / stats.chi2.ppf([0.5 + 0.5 * LEVEL, 0.5 - 0.5 * LEVEL], n - 1)
    value, low, high = (max(float(number) - known_variance, 0.0) for number in (variance, low, high))
    remedy = "" if low > 0.0 and high - low < 4.0 * CLEAR * value else "record for longer"
    return CalibrationEstimate(value=value, low=low, high=high, unit="m^2", remedy=remedy)


def _mean(errors: NDArray[np.float64]) -> CalibrationEstimate:
    """Return the mean of normal errors, with the interval by Student."""
    n, mean = len(errors), float(errors.mean())
    half = float(stats.t.ppf(0.5 + 0.5 * LEVEL, n - 1)) * float(errors.std(ddof=1)) / math.sqrt(n)
    remedy = "" if half < 2.0 * FINE["bias_x"] else "record for longer"
    return CalibrationEstimate(value=mean, low=mean - half, high=mean + half, unit="m", remedy=remedy)


def _of_headings(errors: NDArray[np.float64], odometry: OdometryNoise, known_variance: float) -> float:
    """Return the log-likelihood of heading errors, a mixture of true ones and spikes of either sign."""
    variance, share, spike = odometry.R[2] + known_variance, odometry.spike_probability, odometry.spike
    turn = wrap_all(errors - odometry.bias[2])
    parts = [(1.0 - share, turn)]
    if share > 0.0:
        parts += [(0.5 * share, turn - spike), (0.5 * share, turn + spike)]
    density = sum(weight * np.exp(-0.5 * off**2 / variance) for weight, off in parts)
    return float(np.log(np.maximum(density, 1e-300)).sum()) - 0.5 * len(errors) * math.log(variance)


def by_innovations(drive: Drive, start: Noise, integrator: str | None) -> tuple[Noise, dict[str, CalibrationEstimate], str]:
    """Fit execution and measurement noise together, by the innovations; return the integrator, too."""
    rows = measured_rows(drive)
    step = difference(drive.odometry[rows.due][1:], drive.odometry[rows.due][:-1])
    # The median resists spikes; a difference has twice the variance.
    spread = (1.4826 * np.median(np.abs(step - np.median(step, axis=0)), axis=0)) ** 2 / 2.0
    begun = replace(start, odometry=replace(start.odometry, R=tuple(np.maximum(spread, 1e-8).tolist()), wheel=False))
    if integrator is None:
        integrator = max(INTEGRATORS, key=lambda name: innovations(rows, begun, integrator=INTEGRATORS[name]))
    rule = choose("integrator", integrator, INTEGRATORS)
    likelihood = lambda model: innovations(rows, model, integrator=rule)  # noqa: E731
    names = tuple(name for name in (*MEASURED, *ALPHAS, "scale") if name not in ONLY_TRUTH)
    names, base, best = _search_with_spikes(likelihood, begun, names)
    estimates = estimates_of(likelihood, base, names, best, has_truth=False)
    return from_coordinates(base, names, best.x), estimates, integrator


def measured_rows(drive: Drive) -> Rows:
    """Return a drive's measured poses."""
    due = known(drive.odometry)
    poses = np.where(due[:, None], drive.odometry, 0.0)
    return Rows(drive.time, drive.twist, poses, due, drive.joined)
