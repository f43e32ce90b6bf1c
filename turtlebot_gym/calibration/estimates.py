"""Estimates of noise parameters with their intervals: fitted to the truth, or to the innovations alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym.calibration.coordinates import (
    MEASURED,
    MOTION,
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
from turtlebot_gym.calibration.likelihood import Rows, count_segments, innovations, measurements, segment_rows
from turtlebot_gym.drives import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym.validation import choose

_Likelihood = Callable[[Noise], float]

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

POSE, WHEELS = "pose", "wheel"
"""Odometry that measures the pose, and odometry that integrates the wheels."""
SEGMENTS = (0.25, 0.5, 1.0)
"""Segment lengths for errors that are correlated from row to row, m: timing errors show over short distances, drift
over long ones. All lengths together count as much as the last one alone, since correlated errors are no further
evidence."""
EXACT = (1e-6) ** 2
"""Variance of the truth row by row, m^2 and rad^2 ..."""
CAPTURED = (1e-3) ** 2
"""... and over segments: that of motion capture, a millimetre and a milliradian."""
FEWEST = 6
"""Fewest segments or poses to which anything is fitted."""
FALSE_ALARM = 1e-4
"""Level of the test for errors that are correlated from row to row."""


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


def _search(likelihood: _Likelihood, start: Noise, names: Sequence[str], *, widely: bool = False) -> Fit:
    """Return the maximum of a likelihood over some parameters of a noise model.

    With ``widely`` it also starts elsewhere, and without gradients: the likelihood of few data has narrow valleys.
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


def _search_with_spikes(likelihood: _Likelihood, start: Noise, names: Sequence[str]) -> tuple[tuple[str, ...], Noise, Fit]:
    """Return the fitted parameters, the start of their search, and the maximum; with spikes, if the drive has any."""
    plain = tuple(name for name in names if name not in SPIKES)
    scales = np.array([PARAMETERS[name].scale for name in plain])
    x, without = climb(lambda x: likelihood(from_coordinates(start, plain, x)), to_coordinates(start, plain), scales)
    smooth = from_coordinates(start, plain, x)
    # Without spikes in the model, they were part of the variance.
    rest = {"spike_probability": 0.02, "R_theta": 0.8 * smooth.odometry.R[2]}
    sizes = [size * math.sqrt(smooth.odometry.R[2]) for size in SPIKE_SIZES]
    begin = max((with_values(smooth, {**rest, "spike": size}) for size in sizes), key=likelihood)
    spiky = _search(likelihood, begin, names)
    if 2.0 * (spiky.value - without) > SPIKY:
        return tuple(names), begin, spiky
    return plain, smooth, _search(likelihood, smooth, plain)


def _estimates(
    likelihood: _Likelihood, start: Noise, names: Sequence[str], fit: Fit, *, has_truth: bool
) -> dict[str, Estimate]:
    """Return values and intervals of parameters at the maximum of their likelihood."""
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


class _Found(NamedTuple):
    estimates: dict[str, Estimate]
    likeliest: Noise
    integrator: str
    segment: float
    segments: int


def by_truth(
    drive: Drive, kind: str, start: Noise, integrator: str | None, segment: float | None, progress: Callable[[str], None]
) -> _Found:
    """Fit to a drive with truth: execution noise and measurement noise separately."""
    fitted: dict[str, Estimate] = {}
    noise = start
    every = segment_rows(drive, 0.0)
    if integrator is None:
        integrator = _better(lambda middle: innovations(every, _exactly(start, CAPTURED), middle=middle))
    middle = choose("integrator", integrator, INTEGRATORS)

    if not segment:
        length, rows = 0.0, every
        likelihood: _Likelihood = lambda model: innovations(every, _exactly(model, EXACT), middle=middle)  # noqa: E731
    else:
        length, rows = segment, segment_rows(drive, segment)
        likelihood = _over([rows], CAPTURED, middle)
    fit = _search(likelihood, start, MOTION, widely=length > 0.0)
    if segment is None:
        longer = [segment_rows(drive, each) for each in SEGMENTS]
        if count_segments(longer[-1]) >= FEWEST:
            over = _over(longer, CAPTURED, middle)
            best = _search(over, start, MOTION, widely=True)
            gain = 2.0 * (best.value - over(from_coordinates(start, MOTION, fit.x)))
            if gain > stats.chi2.ppf(1.0 - FALSE_ALARM, len(MOTION)):
                length, rows, likelihood, fit = SEGMENTS[-1], longer[-1], over, best
    fitted |= _estimates(likelihood, start, MOTION, fit, has_truth=True)
    noise = from_coordinates(noise, MOTION, fit.x)
    progress("execution")
    if kind == POSE:
        measured = measured_rows(drive)
        true = known(drive.truth)
        measured = measured._replace(due=measured.due & true)
        truth = np.where(true[:, None], drive.truth, 0.0)
        error = difference(drive.odometry, drive.truth)[measured.due]
        if len(error) < FEWEST:
            raise ValueError(f"only {len(error)} measured poses have a true one beside them.")
        begin = replace(noise.odometry, R=tuple(np.maximum(error.var(axis=0), 1e-12)), bias=tuple(error.mean(axis=0).tolist()))
        begun = Noise(process=noise.process, odometry=begin)
        likely = lambda model: measurements(measured, truth, model)  # noqa: E731
        names, base, best = _search_with_spikes(likely, begun, MEASURED)
        fitted |= _estimates(likely, base, names, best, has_truth=True)
        noise = from_coordinates(base, names, best.x)
        progress("measurements")
    return _Found(fitted, noise, integrator, length, count_segments(rows))


def _over(sets: Sequence[Rows], variance: float, middle: float) -> _Likelihood:
    """Return the likelihood of a noise model over segments of several lengths, weighted as if there were only the last length.

    The count is reduced by the number of fitted parameters: with few errors, three for each segment, maximum likelihood
    makes variances too small by that share.
    """
    counts = [count_segments(rows) for rows in sets]
    errors = 3.0 * counts[-1]
    rest = max(errors - len(MOTION), 0.2 * errors) / errors
    shares = [rest * counts[-1] / (len(sets) * max(each, 1)) for each in counts]

    def likelihood(model: Noise) -> float:
        exact = _exactly(model, variance)
        return sum(share * innovations(rows, exact, middle=middle) for share, rows in zip(shares, sets, strict=True))

    return likelihood


def by_innovations(drive: Drive, start: Noise, integrator: str | None, progress: Callable[[str], None]) -> _Found:
    """Fit execution and measurement noise together, by the innovations."""
    rows = measured_rows(drive)
    step = difference(drive.odometry[rows.due][1:], drive.odometry[rows.due][:-1])
    # The median resists spikes; a difference has twice the variance.
    spread = (1.4826 * np.median(np.abs(step - np.median(step, axis=0)), axis=0)) ** 2 / 2.0
    begun = replace(start, odometry=replace(start.odometry, R=tuple(np.maximum(spread, 1e-8).tolist()), wheel=False))
    if integrator is None:
        integrator = _better(lambda middle: innovations(rows, begun, middle=middle))
    middle = choose("integrator", integrator, INTEGRATORS)
    likely = lambda model: innovations(rows, model, middle=middle)  # noqa: E731
    names = tuple(name for name in (*MEASURED, *MOTION) if name not in ONLY_TRUTH)
    names, base, best = _search_with_spikes(likely, begun, names)
    progress("search")
    fitted = _estimates(likely, base, names, best, has_truth=False)
    progress("intervals")
    return _Found(fitted, from_coordinates(base, names, best.x), integrator, 0.0, int(rows.due.sum()))


def _better(likelihood: Callable[[float], float]) -> str:
    return max(INTEGRATORS, key=lambda name: likelihood(INTEGRATORS[name]))


def _exactly(noise: Noise, variance: float) -> Noise:
    return Noise(process=noise.process, odometry=OdometryNoise(R=(variance,) * 3))


def measured_rows(drive: Drive) -> Rows:
    """Return a drive's measured poses."""
    due = known(drive.odometry)
    poses = np.where(due[:, None], drive.odometry, 0.0)
    return Rows(drive.time, drive.twist, poses, due, np.zeros(len(due), np.bool_), drive.joined)
