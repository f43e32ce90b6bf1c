"""What is wrong with a recorded drive, by a test of its own on the data for each cause.

A twist, the measured poses and the true ones describe the same motion. Over windows of a second, the turns and the ways of any
two of them are compared by regression: each mistake makes one of them a certain multiple of the others, or moves it in another
direction. Of three that are there, two that agree convict the third. Where no mistake explains the difference, nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.estimation.contradiction import DEGREES, UNITS
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym_lab.drives.compared import (
    FEWEST,
    SURE,
    Array,
    Source,
    explained,
    factor_of,
    matches,
    share_of,
    sources_of,
    without_lost,
)

TURNED, WENT = 3.0, 0.5
"""Turn, rad, and way, m, in all from which something is said."""
STILL = 0.02
"""Share of the others' motion up to which one stands still."""
ALIKE = 2.0
"""Factor up to which wheels may be wrong; more is another unit."""
GAIN, ENOUGH = 0.3, 0.6
"""Explained share of the motion that an explanation must add to the usual one, and have."""
TURN = 0.35
"""Angle between a robot's direction of motion and its heading from which the heading is that of another frame, rad."""
REACH = 0.6, 30.0
"""Clock offsets that are found, s: smaller ones are estimated by a calibration."""
EXACT = 20.0
"""Ratio of misfits from which poses are added up from a twist, beside others that are not."""
ROWS, FAR = 7, 10.0
"""Rows on either side of a jump that are compared, and standard deviations of that difference from which it is one."""
WORDS = {"mm": "millimetres", "cm": "centimetres"}
JUMP = 0.1, 0.35
"""Least jumps of odometry, m and rad."""


WORLD = "the speed is that along x of the world, and not along the robot: the twist is in another frame. Turn it by the heading"


def cause_of(drive: Drive) -> str:
    """Return what is wrong with a drive, and what to do, in a clause; an empty text if nothing is, or the data cannot tell."""
    with np.errstate(all="ignore"):  # a recording may state any number
        for poses, name in ((drive.odometry, "measured"), (drive.truth, "true")):
            if text := _rotation(drive, poses, name):
                return text
        sources = sources_of(drive)
        if len(sources) < 2 or len(sources[0].turn) < FEWEST:
            return ""
        tests = (_still, _clock, _turns, _directions, _ways, _swapped)
        return next((text for test in tests if (text := test(drive, sources))), "")


def jump_of(drive: Drive) -> str:
    """Return where the measured poses jump against the twist and stay there, or an empty text."""
    rows = known(drive.odometry) & known(drive.twist) & np.isfinite(drive.time)
    poses, twist, time = drive.odometry[rows], drive.twist[rows], drive.time[rows]
    if len(time) < 10 * ROWS:
        return ""
    with np.errstate(all="ignore"):
        turned = wrap_all(np.diff(poses[:, 2]))
        middle = poses[:-1, 2] + 0.5 * turned
        step = np.diff(poses[:, 0]) + 1j * np.diff(poses[:, 1])
        off = step - twist[1:, 0] * np.diff(time) * np.exp(1j * middle)
        errors = np.cumsum(np.stack([off.real, off.imag, wrap_all(turned - twist[1:, 1] * np.diff(time))]), axis=1)
        errors = np.pad(errors, ((0, 0), (1, 0)))
        medians = np.median(np.lib.stride_tricks.sliding_window_view(errors, ROWS, axis=1), axis=2)
        jumps = medians[:, ROWS:] - medians[:, :-ROWS]
        size = np.hypot(jumps[0], jumps[1]), np.abs(jumps[2])
        limits = [max(least, FAR * 1.4826 * float(np.median(each))) for each, least in zip(size, JUMP, strict=True)]
        far = np.maximum(size[0] / limits[0], size[1] / limits[1])
    if not np.nanmax(far, initial=0.0) > 1.0:
        return ""
    at = int(np.nanargmax(far))
    text = (
        f"the measured pose jumps by {size[0][at]:.2f} m and {size[1][at]:.2f} rad at {time[at + ROWS] - drive.time[0]:.1f} s"
    )
    return f"{text}: was odometry reset, was the robot moved, or are there two sources?"


def _rotation(drive: Drive, poses: Array, name: str) -> str:
    """Return whether headings are those of quaternions whose scalar part is missing."""
    heading = poses[known(poses), 2]
    turn = float(np.nansum(np.abs(drive.twist[1:, 1] * np.diff(drive.time) * drive.joined[1:])))
    flat = np.isin(np.round(np.abs(heading), 6), (0.0, round(math.pi, 6)))
    if len(heading) < FEWEST or turn < TURNED or not flat.all() or not np.ptp(np.abs(heading)) > 1.0:
        return ""
    return f"the {name} heading is 0 or pi in every row, as that of quaternions whose w was never set: set w, or leave it out"


def _still(drive: Drive, sources: list[Source]) -> str:
    """Return which of the three never moves, while the others do."""
    ways = [float(np.abs(source.moved).sum()) for source in sources]
    turns = [float(np.abs(source.turn).sum()) for source in sources]
    moves, rotates = max(ways[1:]) > WENT, max(turns[1:]) > TURNED
    if moves and not np.any(drive.twist[:, 0]):
        if not np.any(drive.twist[:, 1]):
            return (
                "the twist is 0 in every row while the poses move: nobody fills it in; name another twist, as that of /cmd_vel"
            )
        return "the speed is 0 in every row while the poses move: nobody fills it in; name another twist, as that of /cmd_vel"
    if rotates and not np.any(drive.twist[:, 1]):
        return "the turning rate is 0 in every row while the heading changes: nobody fills it in; name another twist"
    for at, (source, poses) in enumerate(zip(sources[1:], _poses(drive, sources), strict=True), start=1):
        whose = source.name.split()[0]
        stays = ways[at] < STILL * ways[0] and not np.ptp(poses[:, :2], axis=0).any()
        if ways[0] > WENT and stays:
            where = "stays 0" if not poses[:, :2].any() else "never changes"
            return f"the {whose} position {where} while the speed makes {ways[0]:.1f} m: nobody fills it in; leave it out"
        if turns[0] > TURNED and turns[at] < STILL * turns[0] and np.ptp(poses[:, 2]) < 1e-9:
            return f"the {whose} heading never changes while the turning rate makes {turns[0]:.1f} rad: is the IMU alive?"
    return ""


def _poses(drive: Drive, sources: list[Source]) -> Iterator[Array]:
    """Yield the known poses of each source but the twist."""
    for source in sources[1:]:
        poses = drive.odometry if source.name.startswith("measured") else drive.truth
        yield poses[known(poses)]


def _clock(drive: Drive, sources: list[Source]) -> str:
    """Return by how much the clock of the truth differs from that of the twist, if by more than a calibration finds."""
    if sources[-1].name != "true heading" or float(np.abs(sources[-1].turn).sum()) < TURNED:
        return ""
    grid = max(drive.period, 0.02)
    time = np.arange(drive.time[0], drive.time[-1], grid)
    rows = known(drive.truth)
    true = np.interp(time, drive.time[rows], np.unwrap(drive.truth[rows, 2]))
    told = np.interp(time, drive.time[1:], np.nancumsum(drive.twist[1:, 1] * np.diff(drive.time)))
    apart = max(round(0.5 / grid), 1)
    rates = [each[apart:] - each[:-apart] for each in (true, told)]
    size = len(rates[0])
    if size < 4 * round(REACH[0] / grid) or min(float(rate.std()) for rate in rates) < 1e-3:
        return ""
    a, b = (np.fft.rfft(rate - rate.mean(), 2 * size) for rate in rates)
    cross = np.fft.irfft(a * np.conj(b)) / math.sqrt(float(rates[0].var() * rates[1].var())) / size
    most = min(round(REACH[1] / grid), size // 2)
    lags = np.arange(-most, most + 1)
    score = np.abs(cross[lags])
    best = int(lags[np.argmax(score)])
    if abs(best) * grid <= REACH[0] or score.max() < 0.7 or abs(cross[0]) > 0.5 * score.max():
        return ""
    how, shift = ("behind", "Subtract it from") if best > 0 else ("ahead of", "Add it to")
    return f"the truth is {abs(best) * grid:.2f} s {how} the twist: its clock is another one. {shift} the truth's time"


def _turns(drive: Drive, sources: list[Source]) -> str:
    """Return whose turn has the wrong sign or unit."""
    turning = without_lost([source for source in sources if float(np.abs(source.turn).sum()) > TURNED], lambda each: each.turn)
    for at, source in enumerate(turning):
        others = [other for other in turning if other is not source]
        factors = [factor_of(other.turn, source.turn) for other in others]
        if not others or (len(others) < 2 and at):
            continue
        if all(-ALIKE < factor < -1.0 / ALIKE and -factor > SURE * deviation for factor, deviation in factors):
            by = f"{factors[0][0]:.2f} times as much"
            if len(others) > 1 or (right := _agrees(sources)) is True:
                return f"the {source.name} has the wrong sign: the {others[0].name} turns by {by}. Multiply it by -1"
            if right is None:
                return f"the {source.name} or the {others[0].name} has the wrong sign: this one turns by {by}"
            return f"the {others[0].name} has the wrong sign: it turns by {by} as the {source.name} makes. Multiply it by -1"
        if all(matches(factor, 1.0 / DEGREES) for factor in factors):
            unit = "degrees" if at else "deg/s"
            text = f"the {source.name} turns 57 times as much as the {others[0].name}"
            return f"{text}: if it is in {unit}, multiply it by pi/180"
    return ""


def _agrees(sources: list[Source]) -> bool | None:
    """Return whether poses move as their heading says, or as it says with its other sign; None if neither is clear."""
    told, pose = sources[0].moved.real, sources[-1]
    right = explained(pose.ahead, told)[0]
    mirrored = explained(pose.moved * np.exp(1j * pose.heading), told)[0]
    return right > mirrored if abs(right - mirrored) > GAIN and max(right, mirrored) > ENOUGH else None


def _directions(drive: Drive, sources: list[Source]) -> str:
    """Return which mistake makes poses move in another direction than the twist says."""
    told = sources[0].moved.real
    if float(np.abs(told).sum()) < WENT:
        return ""
    found: list[tuple[float, float, str]] = []
    for source in sources[1:]:
        name = source.name.split()[0]
        share, factor = explained(source.ahead, told)
        turn = float(np.angle(factor))
        if share > ENOUGH and TURN < abs(turn) < math.pi - TURN:
            text = f"the {name} heading is turned by {-math.degrees(turn):.0f} degrees against the direction of motion"
            return f"{text}: it is that of another frame than the robot's. Name the robot's frame, or subtract that from it"
        if float(np.abs(source.turn).sum()) < TURNED:
            continue
        guesses = (
            (f"the {name} x and y are swapped. Exchange them", 1j * np.conj(source.moved)),
            (f"the {name} y has the wrong sign. Multiply it by -1", np.conj(source.moved)),
        )
        mistakes = [(explained(moved * np.exp(-1j * source.heading), told), text) for text, moved in guesses]
        others = [(other, text) for (other, factor), text in mistakes if abs(np.angle(factor)) < TURN]
        others.append((share_of(source.moved.real, told), WORLD))
        best, text = max(others)
        found.append((best, share, text))
    shown = [text for best, share, text in found if best > share + GAIN and best > ENOUGH]
    if WORLD in shown and any(share > best for best, share, _ in found):
        return ""  # the poses disagree on the frame of the twist
    return shown[0] if shown else ""


def _ways(drive: Drive, sources: list[Source]) -> str:
    """Return whose way has the wrong sign or unit."""
    told = sources[0].moved.real
    if not any(float(np.abs(source.moved).sum()) > 0.0 for source in sources[1:]) or not told.any():
        return ""
    sources = without_lost(sources, lambda each: each.ahead.real)
    factors = {source.name.split()[0]: factor_of(source.ahead.real, told) for source in sources[1:]}
    way = float(np.abs(told).sum())
    if way > WENT and all(-ALIKE < factor < -1.0 / ALIKE and -factor > SURE * dev for factor, dev in factors.values()):
        if len(factors) > 1:
            return "the speed has the wrong sign: the poses move the other way. Multiply it by -1"
        (name,) = factors
        return f"the speed has the wrong sign, or the {name} heading is turned by 180 degrees: the pose moves the other way"
    for many, unit in UNITS.items():
        if all(matches(factor, 1.0 / many) for factor in factors.values()):
            text = f"the speed is {many:g} times as large as the motion of the poses"
            return f"{text}: if the speed is in {unit}/s, divide it by {many:g}"
        for name, factor in factors.items():
            if matches(factor, many):
                moved = f"the {name} positions move by {factor[0] * way:.4g} m while the speed makes {way:.4g} m"
                return f"{moved}: if they are in {WORDS.get(unit, unit)}, divide them by {many:g}"
    for name, (factor, deviation) in factors.items():
        is_alone = all(other > SURE * dev for each, (other, dev) in factors.items() if each != name)
        if way > WENT and is_alone and -ALIKE < factor < -1.0 / ALIKE and -factor > SURE * deviation:
            return (
                f"the {name} heading is turned by 180 degrees against the direction of motion, or x and y have the wrong sign"
            )
    return ""


def _swapped(drive: Drive, sources: list[Source]) -> str:
    """Return whether the true poses are those that the wheels add up, and the measured ones are not."""
    if len(sources) < 3:
        return ""
    told = sources[0].moved.real
    measured, true = (source.ahead.real - told for source in sources[1:])
    if float(np.abs(told).sum()) < WENT or np.abs(measured).sum() < 0.01 * np.abs(told).sum():
        return ""
    turned, right = (source.turn - sources[0].turn for source in sources[1:])
    share, factor = explained(sources[1].ahead, sources[0].moved.real)
    is_like = share > ENOUGH and abs(np.angle(factor)) < TURN and 1.0 / ALIKE < abs(factor) < ALIKE
    if (
        _is_white(drive)
        or not is_like
        or np.abs(true).sum() > 0.01 * np.abs(told).sum()
        or any(EXACT * np.abs(b).sum() > np.abs(a).sum() for a, b in ((measured, true), (turned, right)))
    ):
        return ""
    return "the truth is what the wheels add up, and the measured poses are not: the two are swapped. Exchange them"


def _is_white(drive: Drive) -> bool:
    """Return whether the measured poses have white noise: it makes one step too long and the next too short."""
    step = np.diff(drive.odometry, axis=0)
    middle = drive.odometry[:-1, 2] + 0.5 * wrap_all(step[:, 2])
    off = np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1] - drive.twist[1:, 0] * np.diff(drive.time)
    off = np.where(np.isfinite(off) & drive.joined[1:], off, 0.0)
    return float((off[1:] * off[:-1]).sum()) < -0.2 * float((off**2).sum())
