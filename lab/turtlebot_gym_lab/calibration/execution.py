"""The execution of twists, fitted to a drive with truth: wheels by windows, noise by pieces, and a verdict by halves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import choose
from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise
from turtlebot_gym_lab.calibration.alignment import NO_SHIFT, Shift, shift_twist
from turtlebot_gym_lab.calibration.alphas import AlphaFit, fit_alphas, intervals, pieces_of
from turtlebot_gym_lab.calibration.blocks import quantile
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, PARAMETERS, value_of, with_values
from turtlebot_gym_lab.calibration.estimates import MOTIONS, CalibrationEstimate
from turtlebot_gym_lab.calibration.truth import at_axle, cleaned
from turtlebot_gym_lab.calibration.verdict import DEGREES, Verdict, judge
from turtlebot_gym_lab.calibration.wheels import SEEN, WheelFit, fit_wheels
from turtlebot_gym_lab.calibration.windows import OVERLAP, USUAL, Array, length_for, path_of, relative, windows_of
from turtlebot_gym_lab.calibration.windows import PARAMETERS as WHEELS

SHORT, LONG = (0.1,), (0.5, 1.0, 2.0)
"""Lengths of pieces to which alphas are fitted, m: if errors are white, and if they last."""
WHITE = 2.0
"""Ratio of the NEES after the last of the long lengths to the right one up to which errors are white."""
WEIGHTED = 2
"""Rounds in which windows are weighted by the noise found."""
TOLD, NEAR = 5.0, 0.15
"""Standard deviations by which, and share of a turn to which, the truth must tell that steps have the heading of their start;
otherwise it is the midpoint rule. Wheels that slip to the side look a little like that."""
CERTAIN = 0.6
"""Standard deviation of an alpha's logarithm up to which it is determined."""
CAUTION = 4.0
"""Least ratio of an alpha that is not determined to the usual one: a filter that is too sure is worse than a cautious one."""
LEAST = 1e-3
"""Least drift and place of a marker that matter, rad/s, m and rad."""
JUMP = 6.0
"""Standard deviations from which a step of the truth jumps."""
EARLIEST = 0.01
"""Least delay that matters, s."""
UNITS = {"drift": "rad/s", "marker_x": "m", "marker_y": "m", "marker_theta": "rad"}
MARKER = (("marker_x", "m", "ahead"), ("marker_y", "m", "to the left"), ("marker_theta", "rad", "turned"))


class Execution(NamedTuple):
    """What a drive with truth shows about the execution of its twists."""

    likeliest: Noise
    """The noise model with the likeliest execution."""
    noise: Noise
    """The same, with alphas as large as its verdict demands, and those that are not determined `CAUTION` times as usual."""
    estimates: dict[str, CalibrationEstimate]
    verdict: Verdict
    integrator: str
    lengths: tuple[float, ...]
    """Lengths of the pieces to which the alphas were fitted, m."""
    delay: Shift
    """Time by which the motion lags behind the twist, s."""
    truth_deviations: tuple[float, float]
    """Standard deviations of the truth, m and rad."""
    drive: Drive
    """The drive with its truth at the middle of the axle, without jumps, and its twist without drift or lag."""
    remarks: list[str]


def fit_execution(drive: Drive, start: Noise, integrator: str | None, delay: float | None) -> Execution:
    """Fit the execution of twists to a drive with truth.

    The model has the usual alphas, and wheels as assumed; an integrator or a delay of None is found.

    Raises:
        ValueError: If the truth shows too little motion.
    """
    given = np.append(np.full(len(USUAL) - 1, np.nan), np.nan if delay is None else delay)
    path = path_of(drive)
    name = integrator or integrator_of(drive)
    rule = choose("integrator", name, INTEGRATORS)
    fit = fit_wheels(path, windows_of(path, drive.truth, length_for(path)), rule, given)
    drive, remark = cleaned(drive, fit.values, rule)
    usual = [value_of(start, name) for name in ALPHAS]
    fit = _weighted(drive, rule, given, fit.soft, usual)
    remarks = [remark] if remark else []
    drive, lag, text = _in_time(drive, _delay(fit, drive.period, is_given=delay is not None), is_given=delay is not None)
    remarks += text
    remarks += _remarks(fit)
    drive = at_axle(drive, *fit.values[4:7])
    drive = replace(drive, twist=drive.twist - [0.0, fit.values[3] / (fit.values[0] * fit.values[1])])
    wheels = np.append(fit.values[:3], np.zeros(5))
    alphas, lengths = _alphas(drive, wheels, rule, usual)
    half = np.where(fit.values == USUAL, USUAL, np.nan)
    half[3:] = 0.0
    half[7] = min(fit.values[7], 0.0) if delay is None else 0.0  # a lag is taken off, a late twist is not

    def refit(part: Drive) -> tuple[Array, Array]:
        again = _weighted(part, rule, half, np.append(wheels[:-1], half[7]), usual)
        found = np.append(again.values[:3], np.zeros(5))
        return found, _fit(part, found, rule, usual, lengths).variances

    verdict, factor = judge(drive, refit, np.append(usual, alphas.variances[4:]), rule)
    likeliest = with_values(start, dict(zip(WHEELS[:3], wheels.tolist(), strict=False)))
    likeliest = with_values(likeliest, dict(zip(ALPHAS, alphas.variances.tolist(), strict=False)))
    estimates = _alpha_estimates(alphas) | wheel_estimates(fit)
    least = {name: 0.0 if estimates[name].is_determined else CAUTION * value_of(start, name) for name in ALPHAS}
    wide = with_values(likeliest, {name: max(factor * value_of(likeliest, name), least[name]) for name in ALPHAS})
    if verdict.is_usual:
        wide = with_values(wide, dict(zip(WHEELS[:3], USUAL.tolist(), strict=False)))
    deviations = np.sqrt(alphas.variances[4:]).tolist()
    return Execution(likeliest, wide, estimates, verdict, name, lengths, lag, (deviations[0], deviations[1]), drive, remarks)


def lag_of(drive: Drive, delay: float | None) -> tuple[Drive, Shift, list[str]]:
    """Return a drive without truth whose motion does not lag behind its twist, by its measured poses, the lag and remarks."""
    path = path_of(drive)
    given = np.append(np.full(len(USUAL) - 1, np.nan), np.nan if delay is None else delay)
    try:
        fit = fit_wheels(path, windows_of(path, drive.odometry, LONG[0]), given=given)
    except ValueError:  # too short to tell
        return drive, NO_SHIFT, []
    return _in_time(drive, _delay(fit, drive.period, is_given=delay is not None), is_given=delay is not None)


def _in_time(drive: Drive, lag: Shift, *, is_given: bool) -> tuple[Drive, Shift, list[str]]:
    """Return a drive whose motion does not lag behind its twist, and a remark. A twist that comes late stays as it is."""
    if not lag.is_sure:
        return drive, lag, []
    text = f"the motion follows the recorded twist by {lag.value:.3f} s"
    if lag.value > 0.0 or is_given:
        return shift_twist(drive, lag.value), lag, [text]
    # The filter gets the twist just as late when it drives.
    return drive, lag, [f"{text}, that is, the twist comes late; the wheels are fitted without that, and the noise contains it"]


def _weighted(drive: Drive, rule: float, given: Array, start: Array, usual: Sequence[float]) -> WheelFit:
    """Return the wheels of a drive without gross errors, its windows weighted by the noise that others of them show."""
    path, truth = path_of(drive), drive.truth
    length = length_for(path)
    windows = windows_of(path, truth, length)
    rounds = WEIGHTED
    while True:
        noise = fit_alphas([pieces_of(path, truth, start, rule, length)], usual)
        covariance = pieces_of(path, truth, start, rule, length, overlap=OVERLAP).covariance(noise.variances)
        fit = fit_wheels(path, windows, rule, given, start, covariance)
        start, rounds = fit.soft, rounds - 1
        if not rounds:
            return fit


def integrator_of(drive: Drive) -> str:
    """Return by which rule the truth moves from row to row: "euler" moves along the heading at the start of a step.

    Seen from the heading in the middle, such a step goes aside by half its turn. A marker ahead of the axle goes aside by its
    distance times the turn, and one that is turned in proportion to the way.
    """
    rows = np.flatnonzero(known(drive.truth)[1:] & known(drive.truth)[:-1] & drive.joined[1:]) + 1
    x, y, turn = relative(drive.truth[rows - 1], drive.truth[rows]).T
    step = (x + 1j * y) * np.exp(-0.5j * turn)
    X = np.column_stack([step.real * turn, turn, step.real])
    kept, solution, variance = np.isfinite(turn), np.zeros(3), math.inf
    for _ in range(2):  # the second time without jumps
        if kept.sum() < 2 * len(X.T):
            return "midpoint"
        solution = np.linalg.lstsq(X[kept], step.imag[kept])[0]
        off = step.imag - X @ solution
        variance = float((off[kept] ** 2).mean()) * np.linalg.pinv(X[kept].T @ X[kept])[0, 0]
        kept = np.abs(off) <= max(JUMP * 1.4826 * float(np.median(np.abs(off))), 1e-9)
    slope, deviation = float(solution[0]), math.sqrt(variance)
    return "euler" if slope < -TOLD * deviation and abs(slope + 0.5) < NEAR else "midpoint"


def _delay(fit: WheelFit, period: float, *, is_given: bool) -> Shift:
    """Return the delay of the motion, with its interval; delays by steps are whole steps."""
    value, off = float(fit.values[7]), quantile(fit.blocks) * float(fit.deviations[7])
    is_sure = is_given or abs(value) > max(SEEN * float(fit.deviations[7]), EARLIEST, 0.25 * period)
    steps = round(value / period)
    whole = steps * period if not is_given and abs(value / period - steps) < 0.25 and value > 0.0 else value
    return Shift(whole, value - off, value + off, bool(is_sure))


def _alphas(drive: Drive, wheels: Array, rule: float, usual: Sequence[float]) -> tuple[AlphaFit, tuple[float, ...]]:
    """Return the alphas by short pieces, or by long ones if errors last, and the lengths."""
    short = _fit(drive, wheels, rule, usual, SHORT)
    long = pieces_of(path_of(drive), drive.truth, wheels, rule, LONG[-1], overlap=4)
    if not len(long.off) or long.nees(short.variances).mean() < WHITE * DEGREES:
        return short, SHORT
    return _fit(drive, wheels, rule, usual, LONG), LONG


def _fit(drive: Drive, wheels: Array, rule: float, usual: Sequence[float], lengths: Sequence[float]) -> AlphaFit:
    path = path_of(drive)
    return fit_alphas([pieces_of(path, drive.truth, wheels, rule, length) for length in lengths], usual)


def _alpha_estimates(fit: AlphaFit) -> dict[str, CalibrationEstimate]:
    low, high = intervals(fit, quantile(fit.blocks))
    unsure = np.sqrt(np.diag(fit.covariance)) > CERTAIN
    return {
        name: CalibrationEstimate(
            value=float(fit.variances[at]),
            low=float(low[at]),
            high=float(high[at]),
            unit=PARAMETERS[name].unit,
            remedy=MOTIONS[name] if unsure[at] else "",
        )
        for at, name in enumerate(ALPHAS)
    }


def wheel_estimates(fit: WheelFit) -> dict[str, CalibrationEstimate]:
    """Return the estimates of wheels, drift and marker."""
    table = {}
    for at, name in enumerate(WHEELS[:-1]):
        off, value = quantile(fit.blocks) * float(fit.deviations[at]), float(fit.values[at])
        unit = PARAMETERS[name].unit if name in PARAMETERS else UNITS[name]
        remedy = "" if fit.determined[at] else MOTIONS[name]
        table[name] = CalibrationEstimate(value=value, low=value - off, high=value + off, unit=unit, remedy=remedy)
    return table


def _remarks(fit: WheelFit) -> list[str]:
    """Return what differs from the usual beyond doubt, and by as much as matters, and was taken off."""
    seen: NDArray[np.bool_] = np.abs(fit.values) > np.maximum(SEEN * fit.deviations, LEAST)
    off = {name: float(fit.values[at]) for at, name in enumerate(WHEELS) if at in range(3, 7) and seen[at]}
    remarks = []
    if "drift" in off:
        remarks.append(f"the recorded turning rate is off by {off['drift']:.4f} rad/s throughout: a gyro's bias? Subtract it")
    places = [f"{off[name]:.3f} {unit} {side}" for name, unit, side in MARKER if name in off]
    if places:
        remarks.append(f"what is tracked is {', '.join(places)} from the middle of the axle; the truth was moved there")
    return remarks
