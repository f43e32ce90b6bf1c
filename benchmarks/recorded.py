"""Fit the preset `recorded` to recordings of real robots: what wheel odometry gets wrong, each with a 95 % interval.

Ways and turns of pieces of about a metre are compared with the truth: motion capture, or poses of a map. Blocks of pieces are
drawn anew for the intervals. The preset takes, over the robots, the root mean square of each systematic error, and the mean
variance of the noise. Events are counted; one that was never seen counts as half an event (Jeffreys), since its interval does
not end at zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy import stats
from scipy.optimize import nnls

from harness.study import Study, each, run
from turtlebot_gym.drive import Drive, known
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.evaluation.replay import dead_reckoning

Array = NDArray[np.float64]
STEP = 0.1
"""Interval to which probabilities refer, s."""
WINDOW = 0.5
"""Windows in which slip is looked for, s."""
ASIDE, TURN, TURN_RATE = 0.1, 0.5, 3.0
"""Wheels cannot move a robot aside by more, m, nor turn it by more in a row, rad, faster than this, rad/s: a leap."""
RECORDINGS = ("wifibot1.txt", "wifibot2.txt", "carmen/aces.npz", "carmen/intel.npz", "turtlebot3")
"""Files in the folder."""
ROBOTS = {"wifibot": ("wifibot1", "wifibot2"), "aces": ("aces",), "intel": ("intel",)}
"""Recordings with a truth, by robot."""
EXACT = {"scale": 1.0, "turn_scale": 1.0, "veer": 0.0}
"""Systematic errors of wheels that have none."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Fit the preset `recorded`."""

    data: Path = Path("data")
    """Folder of the recordings, see the page on records."""
    resamples: int = 400
    """Number of draws for the intervals."""
    seed: int = 0
    """Seed of the draws."""


class Pieces(NamedTuple):
    """Pieces of a recording: way and turn by the wheels and in truth, and what the noise of a twist is proportional to."""

    way: Array
    turn: Array
    true_way: Array
    true_turn: Array
    speed: Array
    """``0.1 s`` times the integral of the squared speed, m^2 ..."""
    rate: Array
    """... and of the squared turning rate, rad^2."""
    blurred: Array
    """1 where the truth has an error of its own, as poses in a map do; 0 for motion capture."""


def relative(poses: Array, first: NDArray[np.intp], last: NDArray[np.intp]) -> Array:
    """Return the poses of some rows in the frames of others."""
    x, y = (poses[last, :2] - poses[first, :2]).T
    cosine, sine = np.cos(poses[first, 2]), np.sin(poses[first, 2])
    turn = np.angle(np.exp(1j * (poses[last, 2] - poses[first, 2])))
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, turn], axis=1)


def pieces_of(drive: Drive, wheels: Array, blurred: bool) -> Pieces:
    """Return pieces of at least a metre or a radian between true poses."""
    rows = np.flatnonzero(known(drive.truth))
    dt = np.clip(np.diff(drive.time, prepend=drive.time[0]), 0.0, 1.0)
    v, omega = drive.twist.T
    way, turned = np.cumsum(np.abs(v) * dt), np.cumsum(np.abs(omega) * dt)
    ends = [rows[0]]
    for row in rows[1:]:
        if way[row] - way[ends[-1]] >= 1.0 or turned[row] - turned[ends[-1]] >= 1.0:
            ends.append(row)
    first, last = np.array(ends[:-1]), np.array(ends[1:])
    told, true = relative(wheels, first, last), relative(drive.truth, first, last)
    speed, rate = (np.cumsum(values**2 * dt) * STEP for values in (v, omega))
    sign = np.sign(told[:, 0])
    return Pieces(
        sign * np.hypot(told[:, 0], told[:, 1]),
        told[:, 2],
        sign * np.hypot(true[:, 0], true[:, 1]),
        told[:, 2] + np.angle(np.exp(1j * (true[:, 2] - told[:, 2]))),
        speed[last] - speed[first],
        rate[last] - rate[first],
        np.full(len(first), float(blurred)),
    )


def _near(off: Array) -> NDArray[np.bool_]:
    """Return which residuals are not outliers."""
    return np.abs(off) < 4.0 * stats.median_abs_deviation(off, scale="normal")


def fitted(pieces: Pieces) -> dict[str, float]:
    """Return the systematic errors and the noise of a recording's wheels, by least squares without the outermost pieces."""
    scale = float(pieces.way @ pieces.true_way / (pieces.way @ pieces.way))
    by_motion = np.stack([pieces.turn, pieces.way], axis=1)
    off, by = pieces.true_turn - pieces.turn, np.zeros(2)
    for _ in range(3):
        keep = _near(off)
        by = np.linalg.lstsq(by_motion[keep], pieces.true_turn[keep], rcond=None)[0]
        off = pieces.true_turn - by_motion @ by
    turning, veer = by.tolist()
    keep = _near(off)
    ahead = pieces.true_way - scale * pieces.way
    among = np.stack([pieces.speed, pieces.rate, pieces.blurred], axis=1)
    near = _near(ahead)
    along, about = nnls(among[near], ahead[near] ** 2)[0], nnls(among[keep], off[keep] ** 2)[0]
    return {
        "scale": scale,
        "turn_scale": turning / scale,
        "veer": veer / scale,
        "alpha1": float(along[0]),
        "alpha2": float(along[1]),
        "alpha3": float(about[0]),
        "alpha4": float(about[1]),
    }


def drawn(pieces: Pieces, random: np.random.Generator) -> Pieces:
    """Return as many pieces, drawn in blocks of five."""
    count, block = len(pieces.way), 5
    starts = random.integers(0, count - block + 1, -(-count // block))
    rows = (starts[:, None] + np.arange(block)).ravel()[:count]
    return Pieces(*(part[rows] for part in pieces))


class Events(NamedTuple):
    """Number of events, and of the steps of 0.1 s in which they could occur."""

    seen: float
    steps: float

    def interval(self) -> tuple[float, float, float]:
        """Return the rate, and its interval."""
        posterior = stats.beta(self.seen + 0.5, max(self.steps - self.seen, 0.0) + 0.5)
        rate = (self.seen or 0.5) / self.steps
        return rate, float(posterior.ppf(0.025)) if self.seen else 0.0, float(posterior.ppf(0.975))


class Recording(NamedTuple):
    """A recording."""

    drive: Drive
    wheels: Array
    """The poses that the wheels integrated, of each row of the drive, (T, 3)."""
    time: Array
    """Stamps of all messages, s, which the drive may hold in part."""
    poses: Array | None
    """The poses that the robot itself integrated, of all messages; None if it did not."""


def recording_of(path: Path) -> Recording:
    """Return a recording."""
    drive = read(path)
    poses = drive.odometry if drive.odometry is not None and bool(known(drive.odometry).any()) else None
    if path.suffix == ".npz" and poses is not None:
        with np.load(path) as log:
            return Recording(drive, poses, log["time"], log["odometry"])
    return Recording(drive, dead_reckoning(drive) if poses is None else poses, drive.time, poses)


def gaps_of(found: Recording) -> dict[str, Events]:
    """Return the gaps in the messages, beyond a step and twice the usual interval; none of a clock that runs backwards."""
    between = np.diff(found.time)
    if between.min() < 0.0:
        return {}
    usual = max(STEP, 2.0 * float(np.median(between)))
    gaps = between[between > 1.5 * usual] - usual
    steps = float(between.sum()) / STEP
    return {"gaps": Events(float(gaps.size), steps), "gap ends": Events(float(gaps.size), float(np.ceil(gaps / STEP).sum()))}


def leaps_of(found: Recording) -> dict[str, Events]:
    """Return the leaps and resets of the poses that a robot integrated."""
    if found.poses is None:
        return {}
    rows, between = np.arange(len(found.poses) - 1), np.diff(found.time)
    ahead, aside, turn = relative(found.poses, rows, rows + 1).T
    resets = (np.hypot(*found.poses[1:, :2].T) < 0.01) & (np.hypot(ahead, aside) > 0.3)
    turned = (np.abs(turn) > TURN) & (np.abs(turn) > TURN_RATE * between)
    leaps = ((np.abs(aside) > ASIDE + np.abs(ahead * turn)) | turned) & ~resets  # an arc ends aside, too
    steps = float(found.time[-1] - found.time[0]) / STEP
    return {"leaps": Events(float(leaps.sum()), steps), "resets": Events(float(resets.sum()), steps)}


def slips_of(found: Recording) -> dict[str, Events]:
    """Return slips, and reverse motion that was counted as forward, where each row has a true pose."""
    time, truth = found.drive.time, found.drive.truth
    at = np.searchsorted(time, np.arange(time[5], time[-1], WINDOW))
    true, told = (relative(poses, at[:-1], at[1:])[:, 0] for poses in (truth, found.wheels))
    per, driven, back = WINDOW / STEP, np.abs(told) > 0.05, true < -0.02
    slips = driven & (true / np.where(driven, told, 1.0) < 0.7)
    begins = slips & ~np.roll(slips, 1)
    return {
        "slips": Events(float(begins.sum()), float(driven.sum()) * per),
        "counted forwards": Events(float((back & (told > 0.0)).sum()), float(back.sum()) * per),
    }


def combined(fits: Sequence[Mapping[str, float]], key: str) -> float:
    """Return a parameter of the preset from those of the robots."""
    values = np.array([fit[key] for fit in fits])
    if key not in EXACT:
        return float(values.mean())
    off = values - EXACT[key]
    return EXACT[key] + float(np.sign(off[np.abs(off).argmax()]) * np.sqrt((off**2).mean()))


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the parameters of each robot and of the preset, with intervals, and their tables."""
    random, events = np.random.default_rng(config.seed), {}
    found = {Path(name).stem: recording_of(config.data / name) for name in each(RECORDINGS, "recordings")}
    for name, recording in found.items():
        by_truth = slips_of(recording) if name in ROBOTS["wifibot"] else {}
        for kind, seen in (gaps_of(recording) | leaps_of(recording) | by_truth).items():
            events.setdefault(kind, {})[name] = seen
    fits, draws = {}, {}
    for robot, names in each(ROBOTS.items(), "robots"):
        parts = [pieces_of(found[name].drive, found[name].wheels, robot != "wifibot") for name in names]
        pieces = Pieces(*(np.concatenate(part) for part in zip(*parts, strict=True)))
        fits[robot], draws[robot] = fitted(pieces), [fitted(drawn(pieces, random)) for _ in range(config.resamples)]
    table, rows = Table("parameter", *ROBOTS, "preset"), {}
    for key in fits["aces"]:
        values = {robot: (fit[key], [draw[key] for draw in draws[robot]]) for robot, fit in fits.items()}
        together = [combined(parts, key) for parts in zip(*draws.values(), strict=True)]
        values["preset"] = combined(list(fits.values()), key), together
        rows[key] = {}
        for name, (value, again) in values.items():
            low, high = np.quantile(again, (0.025, 0.975)).tolist()
            rows[key][name] = {"value": value, "low": low, "high": high}
        table.add_row(key, *("{value:.4g} ({low:.4g}, {high:.4g})".format(**row) for row in rows[key].values()))
    counted, rates = Table("event, per 0.1 s", "seen", "steps", "rate"), {}
    for kind, by_name in events.items():
        total = Events(*np.sum(list(by_name.values()), axis=0).tolist())
        rate, low, high = total.interval()
        rates[kind] = {"seen": total.seen, "steps": total.steps, "value": rate, "low": low, "high": high}
        counted.add_row(kind, f"{total.seen:.0f}", f"{total.steps:.0f}", f"{rate:.3g} ({low:.3g}, {high:.3g})")
    return {"parameters": rows, "events": rates}, [table, counted]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
