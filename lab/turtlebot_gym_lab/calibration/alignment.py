"""Clocks and frames: the time offset and the frame of the truth beside measured poses, and a twist that is shifted."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.estimation.consistency import difference
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym_lab.drives.streams import between

REACH = 0.6
"""Largest clock offset that is searched, s."""
SURE = 10.0
"""Gain in log-likelihood that a shift must bring to be accepted."""
SAME_PLACE, SAME_DIRECTION = 0.25, 0.1
"""Limits, m and rad: truth that is closer to the measured poses is in their frame."""


class Shift(NamedTuple):
    """Offset between two clocks, s, with its 95 % interval."""

    value: float
    low: float
    high: float
    is_sure: bool
    """Whether the shift is far likelier than none."""


NO_SHIFT = Shift(0.0, 0.0, 0.0, False)


class Frame(NamedTuple):
    """Pose of the measured poses' frame in the truth's frame; m, m, rad."""

    x: float
    y: float
    theta: float
    is_other: bool
    """Whether the two frames differ, rather than one frame with a bias."""


SAME_FRAME = Frame(0.0, 0.0, 0.0, False)


def aligned(drive: Drive) -> tuple[Drive, Shift, Frame, list[str]]:
    """Return a drive whose truth has the clock and frame of its measured poses, with the shift, the frame and remarks."""
    drive, frame, remarks = in_one_frame(drive)
    late = _truth_delay(drive)
    if late.is_sure:
        drive = _shift_truth(drive, late.value)
        remarks.append(f"the measured poses are {late.value:.3f} s behind the truth ({late.low:.3f} to {late.high:.3f})")
        if frame.is_other:
            again = _find_frame(drive)
            drive = _into_measured_frame(drive, again)
    return drive, late, frame, remarks


def in_one_frame(drive: Drive) -> tuple[Drive, Frame, list[str]]:
    """Return a drive with its truth in the frame of the measured poses, that frame in the truth's, and a remark if it moved."""
    frame = _find_frame(drive)
    if not frame.is_other:
        return drive, frame, []
    remark = (
        f"the truth is in another frame: that of the measured poses lies at ({frame.x:.3f} m, {frame.y:.3f} m, "
        f"{frame.theta:.4f} rad) in it; a bias of x and y cannot be distinguished from that"
    )
    return _into_measured_frame(drive, frame), frame, [remark]


def _progress(drive: Drive) -> NDArray[np.float64]:
    """Return the way, m, and the turn, rad, that the twists make up to each row, shape (T, 2)."""
    return np.concatenate([np.zeros((1, 2)), np.cumsum(drive.twist[1:] * np.diff(drive.time)[:, None], axis=0)])


def shift_twist(drive: Drive, delay: float) -> Drive:
    """Return a drive whose twists are delayed; a row that has no twist then does not continue the one before it."""
    if delay == 0.0:
        return drive
    steps, driven = np.diff(drive.time), _progress(drive)
    shifted = drive.time - delay
    moved = np.stack([np.interp(shifted, drive.time, driven[:, k]) for k in (0, 1)], axis=1)
    twist = np.concatenate([drive.twist[:1], np.diff(moved, axis=0) / steps[:, None]])
    covered = (shifted >= drive.time[0] - 1e-9) & (shifted <= drive.time[-1] + 1e-9)
    joined = drive.joined.copy()
    joined[1:] &= covered[1:] & covered[:-1]
    return replace(drive, twist=twist, joined=joined)


def _shifts(step: float) -> NDArray[np.float64]:
    """Return the shifts that are compared, shape (n,), s."""
    reach = math.floor(REACH / step)
    return step * np.arange(-reach, reach + 1.0)


def _best(shifts: NDArray[np.float64], score: NDArray[np.float64]) -> Shift:
    """Return the likeliest shift on a grid of log-likelihoods, refined by a parabola."""
    at = int(np.argmax(score))
    value = float(shifts[at])
    if 0 < at < len(shifts) - 1:
        before, peak, after = score[at - 1 : at + 2]
        bend = before - 2.0 * peak + after
        if bend < 0.0:
            value += 0.5 * (before - after) / bend * (shifts[1] - shifts[0])
    # Half of chi-square: twice the loss is the deviance.
    near = np.flatnonzero(score >= score[at] - 0.5 * stats.chi2.ppf(0.95, 1))
    step = shifts[1] - shifts[0]
    none = float(np.interp(0.0, shifts, score))
    return Shift(value, float(shifts[near[0]] - step), float(shifts[near[-1]] + step), bool(score[at] - none > SURE))


def _at(time: NDArray[np.float64], poses: NDArray[np.float64], then: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses interpolated over all that are unknown, at other times, shape (n, 3)."""
    are_known = known(poses)
    return between(time[are_known], poses[are_known], then)


def _truth_delay(drive: Drive) -> Shift:
    """Return how long the measured poses lag behind the true ones."""
    inside = known(drive.odometry) & (drive.time > drive.time[0] + REACH) & (drive.time < drive.time[-1] - REACH)
    if inside.sum() < 20:
        return NO_SHIFT
    z, time = drive.odometry[inside], drive.time[inside]
    shifts = _shifts(max(0.1 * drive.period, 0.002))
    score = np.zeros(len(shifts))
    for at, shift in enumerate(shifts):
        error = difference(z, _at(drive.time, drive.truth, time - shift))
        score[at] = -0.5 * len(z) * np.log(np.maximum(error.var(axis=0), 1e-12)).sum()
    return _best(shifts, score)


def _shift_truth(drive: Drive, delay: float) -> Drive:
    """Return a drive with its truth on the measured poses' clock."""
    shifted = drive.time - delay
    times = drive.time[known(drive.truth)]
    truth = _at(drive.time, drive.truth, shifted)
    truth[:, 2] = wrap_all(truth[:, 2])
    truth[(shifted < times[0]) | (shifted > times[-1])] = np.nan
    return replace(drive, true_state=truth)


def _find_frame(drive: Drive) -> Frame:
    """Return the pose of the measured poses' frame in the truth's, from positions alone, as headings may be biased.

    References:
        Umeyama, "Least-squares estimation of transformation parameters between two point patterns", *IEEE Transactions on
        Pattern Analysis and Machine Intelligence* 13 (1991): here without a scale, in the plane.
    """
    are_known = known(drive.odometry) & known(drive.truth)
    z = drive.odometry[are_known, 0] + 1j * drive.odometry[are_known, 1]
    true = drive.truth[are_known, 0] + 1j * drive.truth[are_known, 1]
    spread = (np.conj(z - z.mean()) * (true - true.mean())).sum()
    # The angle that turns one set of points onto the other.
    theta = float(np.angle(spread)) if abs(spread) > 0.0 else 0.0
    origin = true.mean() - z.mean() * np.exp(1j * theta)
    apart = abs((true - z).mean())
    is_other = bool(apart > SAME_PLACE or abs(theta) > SAME_DIRECTION)
    return Frame(float(origin.real), float(origin.imag), theta, is_other)


def _into_measured_frame(drive: Drive, frame: Frame) -> Drive:
    """Return a drive with its truth in the measured poses' frame."""
    away = drive.truth[:, 0] - frame.x + 1j * (drive.truth[:, 1] - frame.y)
    turned = away * np.exp(-1j * frame.theta)
    heading = wrap_all(drive.truth[:, 2] - frame.theta)
    return replace(drive, true_state=np.stack([turned.real, turned.imag, heading], axis=1))
