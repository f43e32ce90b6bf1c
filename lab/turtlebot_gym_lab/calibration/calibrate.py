"""Calibrate a noise model from a drive: align, fit, and say what remains unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from turtlebot_gym.config import choose
from turtlebot_gym.drive import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.parameters import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym_lab.calibration.alignment import NO_SHIFT, SAME_FRAME, Frame, Shift, aligned
from turtlebot_gym_lab.calibration.coordinates import with_values
from turtlebot_gym_lab.calibration.estimates import (
    ONLY_TRUTH,
    POSE,
    WHEELS,
    CalibrationEstimate,
    by_innovations,
    by_truth,
    of_share,
)
from turtlebot_gym_lab.calibration.execution import fit_execution, lag_of
from turtlebot_gym_lab.calibration.verdict import UNTESTED, Verdict
from turtlebot_gym_lab.calibration.windows import relative

KINDS = (POSE, WHEELS)
"""Kinds of odometry."""

WHITE = 5e-4
"""Least white noise of measured poses, m: less is the rounding of wheel odometry."""


SAME = 1e-6
"""Difference of two steps that is rounding, m and rad."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The noise of a robot, as far as a drive determines it."""

    noise: Noise
    """Model to use: the likeliest values, with alphas as large as `verdict` demands; what the drive does not determine is as
    usual."""
    likeliest: Noise
    """Model of the likeliest values throughout."""
    estimates: dict[str, CalibrationEstimate]
    """Estimate of each parameter that was fitted, by name."""
    unknown: dict[str, str]
    """Parameters that this kind of drive can never determine, with the reason."""
    verdict: Verdict
    """Whether its file may be used, by how it drives each half of the drive if it is fitted to the other."""
    kind: str
    """"pose" or "wheel"."""
    has_truth: bool
    """Whether the truth was used; the innovations alone if not."""
    integrator: str
    """"euler" or "midpoint", whichever explains the motion better."""
    lengths: tuple[float, ...] = ()
    """Lengths of the pieces to which the alphas were fitted, m."""
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
    integrator: str | None = None,
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
        delay: Time by which the motion lags behind the recorded twist, s; None to estimate it.
        start: The usual alphas; one that the drive does not determine is near its value.
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
            "wheel odometry alone says nothing about its error: record the truth or measured poses (a fix) beside it."
        )
    if kind == POSE and not drive.has_odometry:
        raise ValueError("there are no measured poses to calibrate.")
    late, frame, remarks = NO_SHIFT, SAME_FRAME, []
    if has_truth and kind == POSE:
        drive, late, frame, remarks = aligned(drive)
    progress("alignment")
    exact = replace(start, scale=1.0, turn_scale=1.0, veer=0.0, slip=0.0)
    started = Noise(process=exact, odometry=OdometryNoise(wheel=kind == WHEELS))
    lengths, verdict = (), UNTESTED
    if has_truth:
        execution = fit_execution(drive, started, integrator, delay)
        drive, integrator, lag, verdict = execution.drive, execution.integrator, execution.delay, execution.verdict
        lengths, estimates = execution.lengths, dict(execution.estimates)
        likeliest, noise = execution.likeliest, execution.noise
        remarks += execution.remarks
        progress("execution")
        if kind == POSE:
            measured, of_poses = by_truth(drive, likeliest, execution.truth_deviations)
            estimates |= of_poses
            likeliest, noise = (replace(model, odometry=measured.odometry) for model in (likeliest, noise))
            progress("measurements")
    else:
        drive, lag, remarks = lag_of(drive, delay)
        likeliest, estimates, integrator = by_innovations(drive, started, integrator)
        noise = with_values(likeliest, {"scale": 1.0})  # nothing tests another
        progress("innovations")
    if kind == POSE:
        missing, among = _lost(drive)
        estimates["dropout_probability"] = of_share(missing, among, "record for longer")
        lost = missing / max(among, 1)
        likeliest, noise = (
            replace(model, odometry=replace(model.odometry, dropout_probability=lost)) for model in (likeliest, noise)
        )
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
        lengths=lengths,
        delay=lag,
        truth_delay=late,
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
    truth, odometry = (relative(poses[rows - 1], poses[rows]) for poses in (drive.truth, drive.odometry))
    return bool(np.abs(truth).sum() > 0.0 and np.abs(truth - odometry).max() < SAME)


def _lost(drive: Drive) -> tuple[int, int]:
    """Return how many measured poses were lost, and out of how many."""
    gaps = np.diff(drive.time[known(drive.odometry)])
    # A gap of n usual intervals has lost n - 1 poses.
    among = np.rint(gaps / np.median(gaps))
    return int((among - 1.0).clip(0.0).sum()), int(among.sum())
