"""Faults in the times of a recording, each reported in one line: clocks that are set back, missing rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.angles import wrap_all

LEAP, SET = 5.0, 86400.0
"""Leaps of a clock backwards, and ahead, that are taken for a clock that was set, s; after a smaller one backwards, rows are
left out until it has caught up, and a smaller one ahead is a pause."""
ROLLED, WRONG, FITS = 3.0, 0.5, 0.8
"""Difference of a message's delay from the usual one, s, from which the recorder's clock may be wrong; largest share of such
messages; and share of them whose stamps must fill holes."""
MISSING = 1.75
"""Ratio to the usual interval from which a row is missing: one makes it 2 ..."""
JITTER = 4.0
"""... but at least so many times what three of four intervals exceed the usual one by, so that jitter is no missing row."""
FARTHER = 1.6
"""Ratio of a true step to that of its surroundings, and to the twist's, from which rows are missing: one makes it 2 ..."""
NOISE = 5.0
"""... if it exceeds them by so many standard deviations of such a step, so that noise is no missing row."""
SMALL = 0.25
"""Least share of a usual step by which one exceeds the others: the noise of a truth at rest is no missing row."""
ROUNDS, TRIMMED = 3, 4.0
"""Rounds in which the variance of steps is fitted, and standard deviations beyond which a step does not count for it."""
AROUND = 11
"""Number of rows whose median is the surroundings."""
FEW = 0.01
"""Share of such steps below which they are left alone: real wheels slip."""
AHEAD = 0.1
"""Time by which two clocks must differ to be taken for different, s, if one of them stamps messages before they arrive ..."""
LATE = 0.5
"""... and if none does, so that it may be a delay: no message that is worth recording is so late."""
STRAY, FEW_ROWS = 10, 0.1
"""Most rows in a row whose stamps are strays, and largest such number as a share of the longest stretch without a leap ..."""
LEAPS = 10.0
"""... where a leap is at least so many times the usual step, so that a slow log has none."""
PAUSE = 600.0
"""Longest pause after the first or before the last few rows, s, if the drive itself is no longer."""
SIMULATED = 86400.0
"""Difference of stamps and the recorder's clock from which the stamps are of a simulation, s."""

OTHER = "its clock is not that of"
"""What a remark says of a topic whose stamps have nothing to do with those of the rows."""


def said(drive: Drive, *marks: str) -> str:
    """Return the first remark on a drive that has one of some marks, without the drive's label; empty if there is none."""
    return next((each.partition(": ")[2] for each in drive.remarks if any(mark in each for mark in marks)), "")


def apart(times: list[float], others: list[float], base: str) -> str:
    """Return that the stamps of two topics have nothing to do with each other; empty if they may be by one clock."""
    if not times or not others or max(times[0] - others[-1], others[0] - times[-1]) < SIMULATED:
        return ""
    here, there = (f"{each[0]:.3f} to {each[-1]:.3f} s" for each in (times, others))
    text = f"{OTHER} the {base}: its stamps are {here}, those of the {base} {there}: wall and simulated time?"
    return f"{text} Record both with use_sim_time, or both without"


class Stamps:
    """The clock of a topic's stamps, beside that of the recorder."""

    def __init__(self) -> None:
        self.ahead = -np.inf
        """Time by which it is ahead of the recorder's, less the shortest delay of a message, s."""
        self.count = 0
        """Number of messages."""
        self.resets: list[float] = []
        """Times by which it was set back, s; negative if ahead."""
        self._last, self._shift = (-np.inf, 0.0), 0.0

    def read(self, stamp: float, received: float) -> float:
        """Return the time of a message, s; once the clock was set back, by that of the recorder."""
        time, (last, heard) = stamp + self._shift, self._last
        if time < last - LEAP or (self.count and time > last + SET):
            self.resets.append(last - time)
            passed = received - heard
            self._shift += (goes_on := last + (passed if 0.0 < passed < SET else 0.0)) - time
            time = goes_on
        self._last, self.ahead, self.count = (time, received), max(self.ahead, time - received), self.count + 1
        return time

    def lead(self, other: Stamps) -> float:
        """Return the time by which this clock is ahead of another one, s; 0 if they cannot be told apart."""
        lead = self.ahead - other.ahead
        if max(abs(self.ahead), abs(other.ahead)) > SIMULATED or min(self.count, other.count) < AROUND:
            return 0.0
        return lead if abs(lead) > (AHEAD if max(self.ahead, other.ahead) > AHEAD else LATE) else 0.0


def rolled_over(
    received: NDArray[np.float64], stamps: NDArray[np.float64], topics: NDArray[np.intp]
) -> NDArray[np.float64] | None:
    """Return when messages were received by their stamps, where the recorder's clock is wrong in a few of them.

    It is wrong if its times do not fit, and the stamps fill the holes between those of the same topic.

    Args:
        received: Recorded times, shape (n,), s.
        stamps: Stamps of the messages, shape (n,), s; NaN for none.
        topics: Number of each message's topic, shape (n,).

    Returns:
        Times, shape (n,), s, NaN for a wrong one of a message without a stamp; None if the recorder's clock is right.
    """
    times, right = received.copy(), np.ones(len(received), np.bool_)
    for topic in np.unique(topics[np.isfinite(stamps)]):
        rows = np.flatnonzero((topics == topic) & np.isfinite(stamps))
        delay = received[rows] - stamps[rows]
        usual = float(np.median(delay))
        late = np.abs(delay - usual) > ROLLED
        if late.any() and late.sum() <= WRONG * len(rows):
            good, doubtful = np.sort(stamps[rows[~late]]), stamps[rows[late]]
            after = np.clip(np.searchsorted(good, doubtful), 1, len(good) - 1)
            nearest = np.minimum(np.abs(doubtful - good[after - 1]), np.abs(doubtful - good[after]))
            interval = float(np.median(np.diff(good)))
            if (nearest > 0.5 * interval).mean() > FITS and nearest.min() < MISSING * interval:
                times[rows[late]] = doubtful + usual
                right[rows[late]] = False
    if right.all():
        return None
    known = right & np.isfinite(stamps)
    bare = np.isnan(stamps) & ((received < received[known].min() - LEAP) | (received > received[known].max() + LEAP))
    times[bare] = np.nan
    return times


def strays(time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows have a stamp that is far from those around, such as 0 among times since 1970, shape (T,).

    Between two stretches of a drive, a few rows are strays unless they lie between these in time, as in a pause. At an end they
    are strays if they are farther away than the rest is long, and than `PAUSE`, or the clock runs back to or from them.

    Args:
        time: Shape (T,), s, in the order of the recording; NaN where unknown.
    """
    is_stray, rows = np.zeros(len(time), np.bool_), np.flatnonzero(np.isfinite(time))
    steps = np.diff(time[rows])
    if len(steps) < 2:
        return is_stray
    ends = np.flatnonzero(np.abs(steps) > max(LEAP, LEAPS * float(np.median(np.abs(steps))))) + 1
    parts = np.split(rows, ends)
    most = max(1, min(STRAY, int(FEW_ROWS * max(map(len, parts)))))
    whole = [part for part in parts if len(part) > most]
    if not whole or len(whole) == len(parts):
        return is_stray
    length = max(max(time[part].max() for part in whole) - min(time[part].min() for part in whole), PAUSE)
    begins = [part[0] for part in whole]
    for part in parts:
        if len(part) <= most:
            at = int(np.searchsorted(begins, part[0]))
            before = time[whole[at - 1][-1]] if at else time[whole[0][0]] - length
            after = time[whole[at][0]] if at < len(whole) else time[whole[-1][-1]] + length
            is_stray[part] = not before < time[part[0]] <= time[part[-1]] < after
    return is_stray


def stray_stamps(stamps: NDArray[np.float64], *, is_in_order: bool = True) -> NDArray[np.bool_]:
    """Return which messages of a topic have a stamp that is far from those around, or 0 where others have one, shape (n,).

    Args:
        stamps: Shape (n,), s.
        is_in_order: Whether their order is that in which they were sent; if not, only stamps far from all others are strays.
    """
    is_stray = stamps == 0.0
    if 2 * is_stray.sum() >= len(stamps):  # some drivers set none
        return np.zeros(len(stamps), np.bool_)
    by_stamp = np.argsort(stamps, kind="stable")
    is_stray[by_stamp] |= strays(stamps[by_stamp])
    return is_stray | (is_in_order & strays(np.where(is_stray, np.nan, stamps)))


def continued(time: NDArray[np.float64], where: str) -> tuple[NDArray[np.float64], NDArray[np.bool_], list[str]]:
    """Let the times of rows go on where their clock was set.

    Args:
        time: Shape (T,), s, in the order of the recording; NaN where unknown.
        where: What has these times, for the remark.

    Returns:
        The times, whether a row is the first after its clock was set, shape (T,), and the remarks.
    """
    finite = np.flatnonzero(np.isfinite(time))
    steps = np.diff(time[finite])
    size = float(np.median(np.abs(steps))) if len(steps) else 0.0
    back = (steps < -LEAP) | (steps > max(SET, LEAPS * size))
    usual = float(np.median(steps[~back])) if not back.all() else size
    is_set = np.zeros(len(time), np.bool_)
    if not back.any():
        return time, is_set, []
    is_set[finite[1:][back]] = True
    moved = time.copy()
    moved[finite[1:]] += np.cumsum(np.where(back, usual - steps, 0.0))
    first, by = int(np.argmax(back)), float(-steps[back][0])
    how = "back" if by > 0.0 else "ahead"
    text = f"{where}: the clock was set {how} {back.sum()} times, first by {abs(by):.3f} s"
    return moved, is_set, [f"{text} after {time[finite[first]]:.3f} s: later times are moved"]


def increasing(time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each time is later than all before it, shape (T,); false where it is not finite."""
    finite = np.isfinite(time)
    newest = np.maximum.accumulate(np.where(finite, time, -np.inf))
    return finite & (time > np.concatenate([[-np.inf], newest[:-1]]))


def judged(drive: Drive) -> Drive:
    """Notice the rows that a drive with a measured twist lacks.

    If the times have a gap, the twist of the row after it holds over the gap. If they have none, as of a logger that stamps
    when it writes, a true step shows it, which is longer than the twist and the steps around it. A truth with heavy tails looks
    the same, so it is only reported: a calibration decides what it leaves out.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # a message may state any number
        drive = _unwound(drive)
        remarks = (*_gaps(drive), *_leaps(drive))
    where = f"{drive.around.label}: "
    return replace(drive, remarks=(*drive.remarks, *(where + remark for remark in remarks)))


def _unwound(drive: Drive) -> Drive:
    """Take turning rates of more than half a turn to a row from the measured headings: some drivers fail where these wrap."""
    turn = np.diff(drive.odometry[:, 2], prepend=np.nan)
    interval = np.diff(drive.time, prepend=np.nan)
    wrong = drive.joined & (np.abs(drive.twist[:, 1]) * interval > np.pi) & np.isfinite(turn)
    if not wrong.any():
        return drive
    twist = drive.twist.copy()
    twist[wrong, 1] = wrap_all(turn[wrong]) / interval[wrong]
    text = f"{drive.around.label}: {wrong.sum()} turning rates are more than half a turn to a row, first at "
    remark = f"{text}{drive.time[wrong][0]:.3f} s: the change of the measured heading is taken"
    return replace(drive, twist=twist, remarks=(*drive.remarks, remark))


def _gaps(drive: Drive) -> list[str]:
    """Return the remark on gaps of the time that are too short to interrupt the drive."""
    steps = np.diff(drive.time)
    if len(steps) < AROUND:
        return []
    usual, upper = np.percentile(steps, (50, 75))
    gaps = np.flatnonzero((steps > max(MISSING * usual, usual + JITTER * (upper - usual))) & drive.joined[1:])
    rows = int((np.rint(steps[gaps] / usual) - 1).sum())
    text = f"{rows} rows are missing at {len(gaps)} places, first after "
    return [f"{text}{drive.time[gaps[0]]:.3f} s: the twist after each gap holds over it"] if len(gaps) else []


def _leaps(drive: Drive) -> list[str]:
    """Return the remark on rows that the truth reaches by a leap."""
    leaps = np.zeros(len(drive), np.bool_)
    if known(drive.truth).sum() < 2 * AROUND:
        return []
    moved, dt = np.diff(drive.truth, axis=0), np.diff(drive.time)
    twist = np.where(drive.joined[1:, None], drive.twist[1:], np.nan)
    for axis, steps in enumerate((np.hypot(moved[:, 0], moved[:, 1]), np.abs(wrap_all(moved[:, 2])))):
        leaps[1:] |= _longer(steps, twist, np.abs(drive.twist[:, axis]), dt)
    if leaps.mean() < FEW:
        return []
    text = f"the truth leaps ahead of the twist at {leaps.sum()} rows, first at {drive.time[leaps][0]:.3f} s: "
    return [f"{text}rows are missing there, or the truth is wrong"]


def _longer(
    steps: NDArray[np.float64], twist: NDArray[np.float64], speed: NDArray[np.float64], dt: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which steps are longer than twist, noise and the steps around them explain, shape (T - 1,).

    The noise of wheels grows with both speeds, and a truth has noise of its own, so the variance of a step is fitted to the
    drive. A twist may be a row late.

    Args:
        steps: Lengths of the true steps, shape (T - 1,), m or rad; NaN where unknown.
        twist: Measured twist over each, shape (T - 1, 2); NaN where a row does not continue the one before it.
        speed: Size of the twist in the direction of the steps, shape (T,).
        dt: Duration of each, shape (T - 1,), s.
    """
    comparable = np.isfinite(steps) & np.isfinite(twist).all(axis=1)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(steps / dt, AROUND // 2, constant_values=np.nan), AROUND)
    comparable &= np.isfinite(windows).sum(axis=1) > AROUND // 2
    if not comparable.any():
        return comparable
    fastest = np.maximum(np.maximum(speed[:-1], speed[1:]), np.append(speed[2:], 0.0))
    expected = np.full(len(steps), np.inf)
    expected[comparable] = np.maximum(np.nanmedian(windows[comparable], axis=1), fastest[comparable]) * dt[comparable]
    excess = np.where(comparable, steps - speed[1:] * dt, 0.0)
    parts = np.column_stack([np.nan_to_num(twist) ** 2 * dt[:, None], np.ones(len(steps))])
    parts /= np.maximum(parts[comparable].mean(axis=0), 1e-12)
    kept, variance = comparable, np.zeros(len(steps))
    for _ in range(ROUNDS):
        variance = parts @ nnls(parts[kept], excess[kept] ** 2)[0]
        kept = comparable & (excess**2 < TRIMMED**2 * variance)
        if not kept.any():
            return kept
    usual = float(np.median(fastest[comparable & (fastest > 0.0)] * dt[comparable & (fastest > 0.0)])) if fastest.any() else 0.0
    far = np.maximum(NOISE * np.sqrt(variance), max(SMALL * usual, 1e-6))
    return comparable & (steps > FARTHER * expected) & (steps - expected > far)
