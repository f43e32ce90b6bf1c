"""Calibrate a noise model from a drive: align, fit, and say what remains unknown."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.parameters import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.validation import choose
from turtlebot_gym_lab.calibration.alignment import NO_SHIFT, SAME_FRAME, Frame, Shift, aligned
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, value_of, with_values
from turtlebot_gym_lab.calibration.diagnosis import Verdict
from turtlebot_gym_lab.calibration.estimates import (
    ONLY_TRUTH,
    POSE,
    WHEELS,
    CalibrationEstimate,
    by_innovations,
    by_truth,
    of_share,
)
from turtlebot_gym_lab.calibration.execution import Execution, fit_execution
from turtlebot_gym_lab.calibration.fit import Z
from turtlebot_gym_lab.calibration.poses import Scanned, fit_poses

KINDS = (POSE, WHEELS)
"""Kinds of odometry."""

CAPS = {"alpha1": 0.1, "alpha2": 0.025, "alpha3": 2.5, "alpha4": 0.1}
"""Largest alphas in a file: noise of a third of the speed in each 0.1 s; between speed and turn by levers of 0.5 m (alpha2) and
0.2 m (alpha3). A drive whose likeliest value is larger is not described by white noise."""
WHITE = 5e-4
"""Least white noise of measured poses, m: less is the rounding of wheel odometry."""


SAME = 1e-6
"""Difference of two steps that is rounding, m and rad."""
UNKNOWN = {"alpha1": "scale", "alpha3": "veer", "alpha4": "turn_scale"}
"""Wheel parameter whose error each alpha covers if the drive does not determine it."""
MENTIONED = 5
"""Most jumps whose times are mentioned."""
MARKER = (("marker_x", "m", "ahead"), ("marker_y", "m", "to the left"), ("marker_theta", "rad", "turned"))
UNTESTED = Verdict(
    True, False, "Fitted to the innovations alone: nothing tests whether the model describes the drive.", 1.0, 3.0
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The noise of a robot, as far as a drive determines it."""

    noise: Noise
    """Model to use: the likeliest values, except for alphas that the drive does not determine or that were fitted over
    segments, which take the upper end of their interval."""
    likeliest: Noise
    """Model of the likeliest values throughout."""
    estimates: dict[str, CalibrationEstimate]
    """Estimate of each parameter that was fitted, by name."""
    unknown: dict[str, str]
    """Parameters that this kind of drive can never determine, with the reason."""
    verdict: Verdict
    """Whether the model describes the drive."""
    kind: str
    """"pose" or "wheel"."""
    has_truth: bool
    """Whether the truth was used; the innovations alone if not."""
    integrator: str
    """"euler" or "midpoint", whichever explains the motion better."""
    segment: float = 0.0
    """Length of the longest segments to which the alphas were fitted, m; 0 for row by row."""
    segments: int = 0
    """Number of those segments."""
    delay: Shift = NO_SHIFT
    """Time by which the motion lags behind the recorded twist, s."""
    truth_delay: Shift = NO_SHIFT
    """Time by which the measured poses lag behind the truth, s."""
    frame: Frame = SAME_FRAME
    """Pose of the measured poses' frame in the truth's."""
    remarks: tuple[str, ...]
    """Remarks on the drive: what was left out, shifted or assumed."""
    drive: Drive = field(repr=False)
    """The drive, aligned."""
    measured: int = 0
    """Number of measurements by tape that the wheels were fitted to; 0 if none."""


def detect_kind(drive: Drive) -> str:
    """Return the kind of odometry: "wheel" if its poses move as the recorded twist does, or if there are none.

    White noise on a pose makes one step too long and the next too short; errors of that pattern mark measured poses, if they
    are larger than rounding.
    """
    z = drive.odometry
    step, dt = difference(z[1:], z[:-1]), np.diff(drive.time)
    good = np.isfinite(step).all(axis=1) & drive.joined[1:]
    if good.sum() < 10:
        return WHEELS if not drive.has_odometry else POSE
    middle = z[:-1, 2] + 0.5 * step[:, 2]
    forward = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
    surplus = np.where(good, forward - drive.twist[1:, 0] * dt, 0.0)
    size = float((surplus**2).sum())
    # White noise gives -0.5: an error ends one step and begins the next.
    is_white = size > 2.0 * WHITE**2 * good.sum() and float((surplus[1:] * surplus[:-1]).sum()) < -0.25 * size
    return POSE if is_white else WHEELS


def calibrate(
    drive: Drive,
    *,
    kind: str | None = None,
    use_truth: bool = True,
    scanned: Scanned | None = None,
    integrator: str | None = None,
    segment: float | None = None,
    delay: float | None = None,
    start: ProcessNoise = WHEEL.process,
    progress: Callable[[str], None] = lambda done: None,
) -> Calibration:
    """Fit the noise model to a drive.

    Args:
        drive: The drive.
        kind: "pose" for odometry that measures the pose, "wheel" for wheel odometry; None to detect it.
        use_truth: Use the truth where the drive has it; if false, the innovations alone.
        scanned: What is known of the truth if it is that of scans in a map; wheels only, and ``segment`` does not count.
            None for a truth whose errors are independent from row to row.
        integrator: "euler" or "midpoint"; None for the one that explains the motion better.
        segment: Length of the segments to which the alphas are fitted, m; 0 for row by row. None chooses row by row if the
            errors are not correlated, and `execution.SEGMENTS` otherwise. With truth only.
        delay: Time by which the motion lags behind the recorded twist, s; None to estimate it.
        start: Start of the search for the alphas; an alpha that the drive does not determine keeps this value.
        progress: Called with the name of each finished part.

    Raises:
        ValueError: If the drive is too short, or an argument is unknown.
    """
    has_truth = drive.has_truth and use_truth
    if has_truth and _is_odometry(drive):
        raise ValueError(
            "the truth moves exactly as odometry does: it is the odometry itself, or a simulation without noise, and there is "
            "nothing to calibrate; name another truth."
        )
    kind = detect_kind(drive) if kind is None else choose("kind", kind, dict(zip(KINDS, KINDS, strict=True)))
    if not has_truth and kind == WHEELS:
        raise ValueError(
            "wheel odometry alone says nothing about its error: record the truth or measured poses (a fix) beside it, or "
            "measure the drive by tape."
        )
    if kind == POSE and scanned is not None:
        raise ValueError("by a map only wheel odometry is calibrated, and its poses look measured: if they are not, say so.")
    if kind == POSE and not drive.has_odometry:
        raise ValueError("there are no measured poses to calibrate.")
    drive, delays, frame, remarks = aligned(drive, kind, has_truth, delay, scanned is not None)
    progress("alignment")
    exact = replace(start, scale=1.0, turn_scale=1.0, veer=0.0, slip=0.0)
    started = Noise(process=exact, odometry=OdometryNoise(wheel=kind == WHEELS))
    if has_truth:
        if scanned is None:
            execution = fit_execution(drive, started, integrator, segment)
        else:
            execution = fit_poses(drive, scanned, started, integrator)
        drive, integrator, verdict = execution.drive, execution.integrator, execution.verdict
        longest, segments = execution.segment, execution.segments
        estimates, likeliest = dict(execution.estimates), execution.noise
        remarks += _remarks(execution)
        if scanned is not None:
            far, turned = execution.truth_deviations
            remarks.append(f"single scans in the map are off by {far:.4f} m along an axis and {turned:.4f} rad, by the fit")
        progress("execution")
        if kind == POSE:
            likeliest, measured = by_truth(drive, likeliest, execution.truth_deviations)
            estimates |= measured
            progress("measurements")
    else:
        likeliest, estimates, integrator = by_innovations(drive, started, integrator)
        longest, segments, verdict = 0.0, int(known(drive.odometry).sum()), UNTESTED
        progress("innovations")
    if kind == POSE:
        missing, among = _lost(drive)
        estimates["dropout_probability"] = of_share(missing, among, "record for longer")
        share = missing / max(among, 1)
        likeliest = replace(likeliest, odometry=replace(likeliest.odometry, dropout_probability=share))
    is_certain = longest == 0.0 or (scanned is not None and not verdict.is_correlated)
    noise = _wary(likeliest, estimates, started, is_certain=is_certain)
    verdict = _capped(verdict, estimates)
    unknown = {} if kind == WHEELS or (has_truth and not frame.is_other) else dict(ONLY_TRUTH)
    return Calibration(
        noise=noise,
        likeliest=likeliest,
        estimates=estimates,
        unknown=unknown,
        verdict=verdict,
        kind=kind,
        has_truth=has_truth,
        integrator=integrator,
        segment=longest,
        segments=segments,
        delay=delays[0],
        truth_delay=delays[1],
        frame=frame,
        remarks=(*drive.remarks, *remarks),
        drive=drive,
    )


def _is_odometry(drive: Drive) -> bool:
    """Return whether the true poses move from row to row as the measured ones do, but for rounding."""
    both = known(drive.truth) & known(drive.odometry)
    rows = np.flatnonzero(both[1:] & both[:-1]) + 1
    if len(rows) < 2:
        return False
    truth, odometry = (_steps(poses, rows) for poses in (drive.truth, drive.odometry))
    return bool(np.abs(truth).sum() > 0.0 and np.abs(truth - odometry).max() < SAME)


def _steps(poses: NDArray[np.float64], rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the motion to some rows in the frame of the pose before, shape (n, 3)."""
    x, y, turn = difference(poses[rows], poses[rows - 1]).T
    cosine, sine = np.cos(poses[rows - 1, 2]), np.sin(poses[rows - 1, 2])
    return np.column_stack([cosine * x + sine * y, cosine * y - sine * x, turn])


def _wary(noise: Noise, estimates: dict[str, CalibrationEstimate], start: Noise, *, is_certain: bool) -> Noise:
    """Return a noise model with the largest execution noise that the drive allows, where the drive does not determine it.

    Correlated errors are not white noise; the upper end then stands for all of them.
    """
    worst = {}
    for name in ALPHAS:
        estimate = estimates[name]
        value = estimate.value if is_certain and estimate.is_determined else estimate.high
        value = value if math.isfinite(value) else value_of(start, name)
        # A wheel that is not known is noise to a filter.
        part = estimates[UNKNOWN[name]] if name in UNKNOWN and not is_certain else None
        unsure = ((part.high - part.low) / (2.0 * Z)) ** 2 if part is not None and not part.is_determined else 0.0
        worst[name] = min(value + unsure, CAPS[name])
    return with_values(noise, worst)


def _capped(verdict: Verdict, estimates: dict[str, CalibrationEstimate]) -> Verdict:
    """Return a verdict that also says which alphas are larger than any robot's, beyond doubt."""
    above = [name for name in ALPHAS if estimates[name].low > CAPS[name]]
    if not above:
        return verdict
    text = ", ".join(f"{name} is {estimates[name].value:.3g}, above {CAPS[name]:g}" for name in above)
    text = f"The model does not describe the drive: {text}." if verdict.is_good else f"{verdict.text[:-1]}; {text}."
    return verdict._replace(is_good=False, text=text)


def _remarks(execution: Execution) -> list[str]:
    """Return what the fit of the execution corrected."""
    remarks = []
    if len(execution.jumps):
        times = ", ".join(f"{time:.2f}" for time in execution.drive.time[execution.jumps[:MENTIONED]])
        more = ", ..." if len(execution.jumps) > MENTIONED else ""
        remarks.append(f"the truth or the twist jumps {len(execution.jumps)} times, at {times}{more} s; left out")
    off = {name: estimate.value for name, estimate in execution.estimates.items() if execution.is_seen(name)}
    if "drift" in off:
        remarks.append(f"the recorded turning rate is off by {off['drift']:.4f} rad/s throughout: a gyro's bias? Subtract it")
    places = [f"{off[name]:.3f} {unit} {side}" for name, unit, side in MARKER if name in off]
    if places:
        remarks.append(f"what is tracked is {', '.join(places)} from the middle of the axle; the truth was moved there")
    return remarks


def _lost(drive: Drive) -> tuple[int, int]:
    """Return how many measured poses were lost, and out of how many."""
    gaps = np.diff(drive.time[known(drive.odometry)])
    # A gap of n usual intervals has lost n - 1 poses.
    among = np.rint(gaps / np.median(gaps))
    return int((among - 1.0).clip(0.0).sum()), int(among.sum())
