"""The execution of twists, fitted to a drive with truth: row by row, or over segments where errors are correlated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym.drive import Drive
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym.validation import choose
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, PARAMETERS, with_values
from turtlebot_gym_lab.calibration.diagnosis import Verdict, diagnose
from turtlebot_gym_lab.calibration.estimates import (
    FEWEST,
    FINE,
    CalibrationEstimate,
    Likelihood,
    estimates_of,
    profiled,
    remedy_of,
    search,
)
from turtlebot_gym_lab.calibration.fit import LEVEL, Fit, Z, maximize
from turtlebot_gym_lab.calibration.likelihood import Rows, count_segments, innovations, segment_rows
from turtlebot_gym_lab.calibration.motions import Array, Motions, motions_of
from turtlebot_gym_lab.calibration.regression import (
    LINEAR,
    USUAL,
    WHEELS_ONLY,
    Regression,
    RegressionProblem,
    problem_of,
    relinearized,
)

SEGMENTS = (0.25, 0.5, 1.0)
"""Segment lengths for errors that are correlated from row to row, m: timing errors show over short distances, drift
over long ones. All lengths together count as much as the last one alone, since correlated errors are no further
evidence."""
CAPTURED = (1e-3) ** 2
"""Variance of the truth over segments: that of motion capture, a millimetre and a milliradian."""
BLOCKS = 20
"""Parts of a drive whose scores count as independent where errors are correlated."""
PLAUSIBLE = np.array([0.3, 0.6, 0.5, 0.1, 0.3, 0.3, math.inf])
"""Largest differences from the usual that are believed where errors are correlated, in the order of `LINEAR`."""
TYPICAL = np.array([0.1, 0.3, 0.1, 0.03, 0.1, 0.1, 1.0])
"""Typical differences from the usual, as standard deviations."""
SEEN = 5.0
"""Standard deviations from which a marker counts as off the axle."""
CLOSE = 20.0
"""Difference of log-likelihoods at the first variances beyond which the better integrator is certain."""
LEAST = 1e-3
"""Least drift and place of a marker that matter, rad/s, m and rad."""
UNITS = {"drift": "rad/s", "marker_x": "m", "marker_y": "m", "marker_theta": "rad"}


class Execution(NamedTuple):
    """What a drive with truth shows about the execution of its twists."""

    noise: Noise
    """The noise model with the likeliest execution."""
    estimates: dict[str, CalibrationEstimate]
    verdict: Verdict
    integrator: str
    segment: float
    """Length of the longest segments to which the alphas were fitted, m; 0 for row by row."""
    segments: int
    truth_deviations: tuple[float, float]
    """Standard deviations of the truth, m and rad."""
    jumps: NDArray[np.intp]
    """Rows at which the truth, or the twist, jumps."""
    drive: Drive
    """The drive with its truth at the middle of the axle, without jumps, and its twist without drift."""

    def is_seen(self, name: str) -> bool:
        """Return whether a parameter differs from 0 beyond doubt, and by as much as matters."""
        estimate = self.estimates[name]
        return abs(estimate.value) > max(SEEN / Z * 0.5 * (estimate.high - estimate.low), LEAST)


def fit_execution(drive: Drive, start: Noise, integrator: str | None, segment: float | None) -> Execution:
    """Fit the execution of twists to a drive with truth.

    Args:
        drive: The drive.
        start: Start of the search for the alphas over segments.
        integrator: "euler" or "midpoint"; None for the one that explains the motion better.
        segment: Length of the segments to which the alphas are fitted, m; 0 for row by row; None to choose.

    Raises:
        ValueError: If fewer than `FEWEST` motions have a truth.
    """
    motions = motions_of(drive)
    if len(motions.row) < FEWEST:
        raise ValueError(f"only {len(motions.row)} motions have a true pose before and after them.")
    other = None
    if integrator is None:
        integrator, other = _likelier(motions)
    rule = choose("integrator", integrator, INTEGRATORS)
    problem, fit, best = _fitted(problem_of(motions, rule), rule)
    verdict = diagnose(problem, best)
    if verdict.is_correlated and not (np.abs(best.linear - USUAL) < PLAUSIBLE).all():
        # Errors that last look like a marker off the axle if the drive is short.
        problem, fit, best = _fitted(problem_of(motions, rule, prior=WHEELS_ONLY), rule)
    linear, covariance = _by_blocks(best) if verdict.is_correlated else (best.linear, best.covariance)
    estimates = _linear_estimates(linear, covariance, blocks=BLOCKS * verdict.is_correlated)
    if other is not None and not verdict.is_correlated:
        estimates = _with_either(estimates, _linear_estimates(other.linear, other.covariance))
    seen = np.where(np.abs(linear) > SEEN * np.sqrt(np.diag(covariance)), linear, 0.0)
    drive = at_axle(drive, *seen[4:])
    drive = _corrected(drive, problem, seen[3])
    written = _without_guesses(linear, covariance) if verdict.is_correlated else linear
    wheels = with_values(start, dict(zip(LINEAR[:3], written.tolist(), strict=False)))
    lengths = (segment,) if segment else ()
    if segment is None and verdict.is_correlated and count_segments(segment_rows(drive, SEGMENTS[-1])) >= FEWEST:
        lengths = SEGMENTS
    rows = [segment_rows(drive, length) for length in lengths]
    if lengths:
        likelihood = _over(rows, rule)
        alphas = estimates_of(likelihood, wheels, ALPHAS, search(likelihood, wheels, ALPHAS, widely=True), has_truth=True)
    else:
        alphas = _alphas(problem, fit)
    return Execution(
        noise=with_values(wheels, {name: estimate.value for name, estimate in alphas.items()}),
        estimates=alphas | estimates,
        verdict=verdict,
        integrator=integrator,
        segment=lengths[-1] if lengths else 0.0,
        segments=count_segments(rows[-1]) if lengths else len(problem.motions.row),
        truth_deviations=(0.0, 0.0) if problem.is_exact else (abs(float(fit.x[4])), abs(float(fit.x[5]))),
        jumps=problem.jumps,
        drive=drive,
    )


def _likelier(motions: Motions) -> tuple[str, Regression | None]:
    """Return the integrator that explains motions better, and the regression with the other one if that may be right, too.

    Jumps of the one that sees fewer of them are left out.
    """
    problems = [problem_of(motions, rule) for rule in INTEGRATORS.values()]
    kept = min(problems, key=lambda problem: len(problem.jumps) + int(problem.is_far().sum())).motions
    by_name = {name: problem_of(kept, rule, rounds=0) for name, rule in INTEGRATORS.items()}
    values = {name: problem.likelihood(problem.roots) for name, problem in by_name.items()}
    if max(values.values()) - min(values.values()) > CLOSE:
        return max(values, key=values.__getitem__), None
    best = {name: _fitted(problem, INTEGRATORS[name])[2] for name, problem in by_name.items()}
    other, chosen = sorted(best, key=lambda name: best[name].likelihood)
    is_close = 2.0 * (best[chosen].likelihood - best[other].likelihood) < Z**2
    return chosen, best[other] if is_close else None


def _with_either(
    estimates: dict[str, CalibrationEstimate], others: dict[str, CalibrationEstimate]
) -> dict[str, CalibrationEstimate]:
    """Return estimates with intervals that hold those of the other integrator, too."""
    return {
        name: replace(estimate, low=min(estimate.low, others[name].low), high=max(estimate.high, others[name].high))
        for name, estimate in estimates.items()
    }


def _fitted(problem: RegressionProblem, rule: float) -> tuple[RegressionProblem, Fit, Regression]:
    """Return a problem, the maximum of its restricted likelihood, and the regression there."""
    fit = maximize(problem.likelihood, problem.roots, 0.3 * problem.roots)
    problem = relinearized(problem, problem.solve(fit.x).linear, rule)
    return problem, fit, problem.solve(fit.x)


def _alphas(problem: RegressionProblem, fit: Fit) -> dict[str, CalibrationEstimate]:
    """Return the alphas at the maximum of the restricted likelihood, with their intervals.

    Made linear again after the fit, the problem has other values and another maximum, from which its deviances count.
    """
    fit = maximize(problem.likelihood, fit.x, fit.deviations)
    return profiled(problem.likelihood, fit, dict(zip(ALPHAS, (fit.x**2).tolist(), strict=False)), has_truth=True)


def _linear_estimates(linear: Array, covariance: Array, *, blocks: int = 0) -> dict[str, CalibrationEstimate]:
    """Return the parameters of the mean motion; with ``blocks``, their covariance is that of so many independent parts."""
    quantile, table = float(stats.t.ppf(0.5 + 0.5 * LEVEL, blocks - 1)) if blocks else Z, {}
    for name, value, variance in zip(LINEAR, linear.tolist(), np.diag(covariance).tolist(), strict=True):
        deviation = math.sqrt(variance)
        low, high = value - quantile * deviation, value + quantile * deviation
        remedy = remedy_of(name, value, deviation, low, high, has_truth=True)
        unit = PARAMETERS[name].unit if name in PARAMETERS else UNITS[name]
        table[name] = CalibrationEstimate(value=value, low=low, high=high, unit=unit, remedy=remedy)
    return table


def _by_blocks(best: Regression) -> tuple[Array, Array]:
    """Return the parameters of `LINEAR` and their covariance by how much the parts of a drive differ.

    A drive in curves of one kind hardly tells a turn of its own from one by the speed; then the usual values count.

    References:
        Liang, Zeger, "Longitudinal data analysis using generalized linear models", *Biometrika* 73 (1986).
    """
    sums = np.array([part.sum(axis=0) for part in np.array_split(best.influence, BLOCKS)])
    prior = np.diag(TYPICAL**2)
    gain = prior @ np.linalg.inv(prior + BLOCKS / (BLOCKS - 1.0) * sums.T @ sums)
    return USUAL + gain @ (best.linear - USUAL), prior - gain @ prior


def _without_guesses(linear: Array, covariance: Array) -> Array:
    """Return the parameters with the usual values of scale, turn scale and veer that a drive neither determines nor refutes."""
    linear, covariance = linear.copy(), covariance.copy()
    for at in np.argsort(-np.diag(covariance)[:3]):
        off, deviation = USUAL[at] - linear[at], math.sqrt(covariance[at, at])
        if deviation > FINE[LINEAR[at]] and abs(off) < 2.0 * deviation:
            share = covariance[at] / covariance[at, at]  # the others as they are if this one is as usual
            linear, covariance = linear + share * off, covariance - np.outer(share, covariance[at])
    return linear


def at_axle(drive: Drive, x: float, y: float, direction: float) -> Drive:
    """Return a drive with its truth at the point that the wheels move, from that of a marker there; m, m, rad."""
    state = drive.true_state.copy()
    heading = state[:, 2] - direction
    state[:, 0] -= x * np.cos(heading) - y * np.sin(heading)
    state[:, 1] -= x * np.sin(heading) + y * np.cos(heading)
    state[:, 2] = wrap_all(heading)
    return replace(drive, true_state=state)


def _corrected(drive: Drive, problem: RegressionProblem, drift: float) -> Drive:
    """Return a drive with its twist without drift, and interrupted by jumps."""
    scale, turn_scale = problem.guess[:2]
    twist, joined = drive.twist.copy(), drive.joined.copy()
    twist[:, 1] -= drift / (scale * turn_scale)
    joined[problem.jumps] = False
    return replace(drive, twist=twist, joined=joined)


def _over(sets: Sequence[Rows], rule: float) -> Likelihood:
    """Return the likelihood of a noise model over segments of several lengths, weighted as if there were only the last length.

    The count is reduced by the number of fitted parameters: with few errors, three for each segment, maximum likelihood
    makes variances too small by that share.
    """
    counts = [count_segments(rows) for rows in sets]
    errors = 3.0 * counts[-1]
    rest = max(errors - len(ALPHAS) - 3.0, 0.2 * errors) / errors
    shares = [rest * counts[-1] / (len(sets) * max(count, 1)) for count in counts]
    truth = OdometryNoise(R=(CAPTURED,) * 3)

    def likelihood(model: Noise) -> float:
        exact = Noise(process=model.process, odometry=truth)
        return sum(share * innovations(rows, exact, integrator=rule) for share, rows in zip(shares, sets, strict=True))

    return likelihood
