"""Calibrate a noise model from a drive: align, fit, and say what remains unknown."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from turtlebot_gym.calibration.alignment import Frame, Shift, aligned
from turtlebot_gym.calibration.coordinates import value_of, with_values
from turtlebot_gym.calibration.estimates import ONLY_TRUTH, POSE, WHEELS, Estimate, by_innovations, by_truth, of_share
from turtlebot_gym.drives import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.parameters import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.validation import choose

KINDS = (POSE, WHEELS)
"""Kinds of odometry."""

WORST = {"alpha1": 0.1, "alpha2": math.inf, "alpha3": math.inf, "alpha4": 0.1}
"""Cap on alphas that a drive does not determine: noise of a third of the speed in each 0.1 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The noise of a robot, as far as a drive determines it."""

    noise: Noise
    """Model to use: the likeliest values, except for alphas that the drive does not determine or that were fitted over
    segments, which take the upper end of their interval."""
    likeliest: Noise
    """Model of the likeliest values throughout."""
    estimates: dict[str, Estimate]
    """Estimate of each parameter that was fitted, by name."""
    unknown: dict[str, str]
    """Parameters that this kind of drive can never determine, with the reason."""
    kind: str
    """"pose" or "wheel"."""
    has_truth: bool
    """Whether the truth was used; the innovations alone if not."""
    integrator: str
    """"euler" or "midpoint", whichever explains the motion better."""
    segment: float
    """Length of the longest segments to which the alphas were fitted, m; 0 for row by row."""
    segments: int
    """Number of those segments."""
    delay: Shift
    """Time by which the motion lags behind the recorded twist, s."""
    truth_delay: Shift
    """Time by which the measured poses lag behind the truth, s."""
    frame: Frame
    """Pose of the measured poses' frame in the truth's."""
    remarks: tuple[str, ...]
    """Remarks on the drive: what was left out, shifted or assumed."""
    drive: Drive = field(repr=False)
    """The drive, aligned."""


def detect_kind(drive: Drive) -> str:
    """Return the kind of odometry: "wheel" if its poses move as the recorded twist does, or if there are none.

    White noise on a pose makes one step too long and the next too short; errors of that pattern mark measured poses.
    """
    z = drive.odometry
    step, dt = difference(z[1:], z[:-1]), np.diff(drive.time)
    good = np.isfinite(step).all(axis=1) & drive.joined[1:]
    if good.sum() < 10:
        return WHEELS if not drive.has_odometry else POSE
    middle = z[:-1, 2] + 0.5 * step[:, 2]
    forward = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1]
    rest = np.where(good, forward - drive.twist[1:, 0] * dt, 0.0)
    size = float((rest**2).sum())
    # White noise gives -0.5: an error ends one step and begins the next.
    return POSE if size > 0.0 and float((rest[1:] * rest[:-1]).sum()) < -0.25 * size else WHEELS


def calibrate(
    drive: Drive,
    *,
    kind: str | None = None,
    use_truth: bool = True,
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
        integrator: "euler" or "midpoint"; None for the one that explains the motion better.
        segment: Length of the segments to which the alphas are fitted, m; 0 for row by row. None chooses row by row if
            that also predicts the drift over `estimates.SEGMENTS`, and those segments otherwise. With truth only.
        delay: Time by which the motion lags behind the recorded twist, s; None to estimate it.
        start: Start of the search for the alphas; an alpha of which the drive says nothing keeps this value.
        progress: Called with the name of each finished part.

    Raises:
        ValueError: If the drive is too short, or an argument is unknown.
    """
    has_truth = drive.has_truth and use_truth
    kind = detect_kind(drive) if kind is None else choose("kind", kind, dict(zip(KINDS, KINDS, strict=True)))
    if not has_truth and kind == WHEELS:
        raise ValueError(
            "wheel odometry alone says nothing about its error: record the truth, or measured poses (a fix) beside it."
        )
    if kind == POSE and not drive.has_odometry:
        raise ValueError("there are no measured poses to calibrate.")
    drive, delays, frame, remarks = aligned(drive, kind, has_truth, delay)
    progress("alignment")
    started = Noise(process=replace(start, scale=1.0, slip=0.0), odometry=OdometryNoise(wheel=kind == WHEELS))
    if has_truth:
        fit = by_truth(drive, kind, started, integrator, segment, progress)
    else:
        fit = by_innovations(drive, started, integrator, progress)
    estimates, likeliest = dict(fit.estimates), fit.likeliest
    if kind == POSE:
        missing, among = _lost(drive)
        estimates["dropout_probability"] = of_share(missing, among, "record for longer")
        share = missing / max(among, 1)
        likeliest = replace(likeliest, odometry=replace(likeliest.odometry, dropout_probability=share))
    noise = _wary(likeliest, estimates, started, is_certain=fit.segment == 0.0)
    unknown = {} if has_truth and not frame.is_other else dict(ONLY_TRUTH)
    if kind == WHEELS:
        unknown = {}
    return Calibration(
        noise=noise,
        likeliest=likeliest,
        estimates=estimates,
        unknown=unknown,
        kind=kind,
        has_truth=has_truth,
        integrator=fit.integrator,
        segment=fit.segment,
        segments=fit.segments,
        delay=delays[0],
        truth_delay=delays[1],
        frame=frame,
        remarks=(*drive.remarks, *remarks),
        drive=drive,
    )


def _wary(noise: Noise, estimates: dict[str, Estimate], start: Noise, *, is_certain: bool) -> Noise:
    """Return a noise model with the largest execution noise that the drive allows, where the drive does not determine it.

    Correlated errors are not white noise; the upper end then stands for all of them.
    """
    worst = {
        name: max(estimate.value, min(estimate.high, WORST[name]))
        for name, estimate in estimates.items()
        if name.startswith("alpha") and not (is_certain and estimate.is_determined) and math.isfinite(estimate.high)
    }
    worst |= {
        name: value_of(start, name)
        for name, estimate in estimates.items()
        if name.startswith("alpha") and math.isinf(estimate.high)
    }
    return with_values(noise, worst)


def _lost(drive: Drive) -> tuple[int, int]:
    """Return how many measured poses were lost, and out of how many."""
    gaps = np.diff(drive.time[known(drive.odometry)])
    # A gap of n usual intervals has lost n - 1 poses.
    among = np.rint(gaps / np.median(gaps))
    return int((among - 1.0).clip(0.0).sum()), int(among.sum())
