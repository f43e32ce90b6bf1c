"""Fit the noise model to an aligned drive: to the truth, or to the innovations alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import stats

from turtlebot_gym.calibration.coordinates import MEASURED, MOTION, from_coordinates
from turtlebot_gym.calibration.estimates import ONLY_TRUTH, Estimate, NoiseLikelihood, estimates, search, search_with_spikes
from turtlebot_gym.calibration.likelihood import Rows, count_segments, innovations, measurements, segment_rows
from turtlebot_gym.drives import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym.validation import choose

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
        likelihood: NoiseLikelihood = lambda model: innovations(every, _exactly(model, EXACT), middle=middle)  # noqa: E731
    else:
        length, rows = segment, segment_rows(drive, segment)
        likelihood = _over([rows], CAPTURED, middle)
    fit = search(likelihood, start, MOTION, widely=length > 0.0)
    if segment is None:
        longer = [segment_rows(drive, each) for each in SEGMENTS]
        if count_segments(longer[-1]) >= FEWEST:
            over = _over(longer, CAPTURED, middle)
            best = search(over, start, MOTION, widely=True)
            gain = 2.0 * (best.value - over(from_coordinates(start, MOTION, fit.x)))
            if gain > stats.chi2.ppf(1.0 - FALSE_ALARM, len(MOTION)):
                length, rows, likelihood, fit = SEGMENTS[-1], longer[-1], over, best
    fitted |= estimates(likelihood, start, MOTION, fit, has_truth=True)
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
        names, base, best = search_with_spikes(likely, begun, MEASURED)
        fitted |= estimates(likely, base, names, best, has_truth=True)
        noise = from_coordinates(base, names, best.x)
        progress("measurements")
    return _Found(fitted, noise, integrator, length, count_segments(rows))


def _over(sets: Sequence[Rows], variance: float, middle: float) -> NoiseLikelihood:
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
    names, base, best = search_with_spikes(likely, begun, names)
    progress("search")
    fitted = estimates(likely, base, names, best, has_truth=False)
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
