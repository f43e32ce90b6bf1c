"""Whether a filter may trust its own model: what the last ten seconds of odometry say about the twist, the noise and the time.

A wrong unit or a frozen sensor is a contradiction within a second (`agreement`). Smaller mistakes show only on average: a
twist that is a fifth too large, a gyro with a bias, a pose that comes late, measurements that are noisier than R says. Once a
second the poses of a window are compared with dead reckoning by the twists. What remains is explained by one cause at a time,
each a line through the residuals; the one that explains most is named, if it is significant and large enough to matter.

The headings are explained first. Dead reckoning then uses the headings so explained, so that a bias of the gyro is not taken
for a mistake of the speed. The normalized innovation squared of the filter itself says whether its noise is right. Where wheels
slip, a cause but the last must hold for two windows: a burst of slip looks like any of them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.parameters import Noise
from turtlebot_gym.values import STOP, Odometry

LEAST_VARIANCE = 1e-5
"""Variance of a measurement up to which nothing is said about noise, m^2 or rad^2: floors of the filter's R are not noise."""
WINDOW, SPACING, PERIOD = 10.0, 0.1, 1.0
"""Time that counts, least time between two of its messages, and time between two judgements, s."""
SHIFT = 0.3
"""Delay with which a late pose is compared, s."""
USUAL = 0.1
"""Delay of a pose after its twist that is no mistake, s: a message, or a step of a simulation. A longer one is significant."""
FEWEST = 40
"""Number of messages from which something is said."""
FLOOR = 0.01, 0.02
"""Standard deviations that a pose has at least, m and rad: real wheels and stamps."""
SIGNIFICANT = 36.0
"""Reduction of the sum of squared residuals, in variances, from which a cause is significant: six standard deviations."""
SCALE, BIAS, LATE, ASIDE = 0.1, 0.02, 0.15, 0.2
"""Least errors that are named: of a scale, 1, a turning rate, rad/s, a time, s, and the direction of motion, rad."""
NOISY, QUIET = 2.0, 0.4
"""Median NIS, as a multiple of `MEDIAN`, above and below which R does not describe the measurements."""
CONVINCING = 0.5
"""Share of the squared residuals that a mistake of the axes may leave."""
MEDIAN = {2: 1.386, 3: 2.366}
"""Median of the NIS of a consistent filter, by degrees of freedom; spikes leave the median as it is."""
INNOVATIONS = "the filter's innovations"
"""Beginning of the cause of a filter that is wrong by more than it states."""
WRONG = 4.0
"""Mean squared residual, in variances, above which the poses contradict the twists though no cause explains them."""


class Doubts(NamedTuple):
    """What the last window says."""

    cause: str = ""
    """What is wrong with the model, or an empty text."""
    nis: float = math.nan
    """Mean normalized innovation squared of the filter over the window."""
    position: float = math.nan
    """Mean squared residual of the positions against the twists, in variances and per axis ..."""
    heading: float = math.nan
    """... and of the headings; 1 if the noise is as assumed."""


class _Cause(NamedTuple):
    """A mistake of the model, and how poses show it."""

    direction: NDArray[Any]
    """Change of the residuals by a mistake of size 1: m as complex numbers, or rad."""
    least: float
    """Least size that is named."""
    text: str
    """Description, with a place for its number."""
    number: float = 0.0
    """What is added to the size for that number."""
    late: bool = False
    """Whether it is a delay."""


class _Found(NamedTuple):
    """What explains residuals."""

    cause: _Cause
    size: float
    left: NDArray[Any]
    """What remains of the residuals."""

    @property
    def number(self) -> float:
        """The number in the cause's text."""
        return self.cause.number + self.size

    def __str__(self) -> str:
        return self.cause.text.format(self.number)


def _best(
    residuals: NDArray[Any], sigma: float, significant: float, near: NDArray[Any], causes: Sequence[_Cause]
) -> _Found | None:
    """Return the cause that explains residuals best, if it is significant and large enough to be named.

    Args:
        residuals: Poses without what the twists say, m or rad.
        sigma: Their standard deviation.
        significant: Reduction of their sum of squares, in variances, from which a cause is significant.
        near: Change of the residuals by a small delay: pose and twist always lie a little apart in time, so a cause explains
            only what such a delay leaves.
        causes: The causes.
    """
    residuals, near = residuals - residuals.mean(), near - near.mean()
    small, found, most = _part(residuals, near), None, significant * sigma * sigma
    rest = residuals - small * near
    for cause in causes:
        direction, left = cause.direction - cause.direction.mean(), residuals
        if not cause.late:
            direction, left = direction - _part(direction, near) * near, rest
        size = _part(left, direction)
        after = left - size * direction
        known = left - USUAL * direction if cause.late else left
        enough = _square(known) - _square(after) > most and (size if cause.late else abs(size)) >= cause.least
        enough &= not cause.late or small >= cause.least  # fast turns look like many things
        if enough and (found is None or _square(after) < _square(found.left)):
            found = _Found(cause, size, after)
    return found


def _square(values: NDArray[Any]) -> float:
    return float((np.abs(values) ** 2).sum())


def _part(values: NDArray[Any], direction: NDArray[Any]) -> float:
    """Return how many times values hold a direction, by least squares."""
    square = _square(direction)
    return float(np.real(np.conj(direction) * values).sum()) / square if square > 1e-12 else 0.0


def _spread(values: NDArray[Any]) -> float:
    """Return the mean squared distance from the mean."""
    return _square(values - values.mean()) / len(values)


class Doubt:
    """Collect odometry and the filter's innovations, and judge them once a second.

    Args:
        noise: Noise that the filter assumes.
        degrees: Degrees of freedom of the filter's NIS; 0 for a filter that states none.
    """

    def __init__(self, noise: Noise, *, degrees: int) -> None:
        R = noise.odometry.R
        spikes = noise.odometry.spike_probability * noise.odometry.spike**2
        self._sigma = math.hypot(math.sqrt(max(R[:2])), FLOOR[0]), math.hypot(math.sqrt(R[2] + spikes), FLOOR[1])
        slip = noise.process.slip  # it looks like any of these for as long as a burst lasts
        self._least = tuple(least + slip for least in (SCALE, BIAS, LATE, ASIDE))
        self._significant = SIGNIFICANT * (1.0 + 100.0 * slip)
        self._wrong, self._noisy = WRONG * (1.0 + 20.0 * slip), NOISY * (1.0 + 2.0 * slip)
        self._insists = 1 if slip == 0.0 else round(2.0 * WINDOW / PERIOD)  # a burst stays in one window for its length
        self._degrees, self._measures = degrees, max(R) > LEAST_VARIANCE
        self.begin()

    def begin(self) -> None:
        """Forget everything."""
        self._rows: deque[tuple[float, ...]] = deque()
        self._nis: deque[tuple[float, float]] = deque()
        self._time = self._judged = self._way = self._turn = 0.0
        self._twist, self._doubted = STOP, 0
        self.found = Doubts()
        """The last judgement."""

    def add(self, dt: float, odometry: Odometry, nis: float) -> Doubts:
        """Take a message ``dt`` after the one before, s, with the filter's NIS for it; return the newest judgement."""
        (v, omega), before, self._twist = odometry.twist, self._twist, odometry.twist
        self._time += dt
        self._way += 0.5 * (v + before.v) * dt
        self._turn += 0.5 * (omega + before.omega) * dt
        if odometry.measured:
            self._nis.append((self._time, nis))
            if not self._rows or self._time - self._rows[-1][0] >= SPACING - 1e-6:
                self._rows.append((self._time, *odometry.pose, v, omega, self._way, self._turn))
        for kept in (self._rows, self._nis):
            while kept and self._time - kept[0][0] > WINDOW:
                kept.popleft()
        if self._time - self._judged >= PERIOD and len(self._rows) >= FEWEST:
            self._judged = self._time
            found = self._judge()
            self._doubted = self._doubted + 1 if found.cause else 0
            holds = self._doubted >= self._insists or found.cause.startswith(INNOVATIONS)
            self.found = found if holds else found._replace(cause="")
        return self.found

    def _judge(self) -> Doubts:
        time, x, y, theta, _, _, way, turn = np.array(self._rows).T
        (sigma, wide), (scale, bias, late, aside) = self._sigma, self._least
        earlier = lambda values, shift: (np.interp(time - shift, time, values) - values)[counts] / shift  # noqa: E731
        counts = time >= time[0] + SHIFT  # what was before is not known for the others
        off = np.unwrap(theta - turn)
        turns = _best(
            off[counts],
            wide,
            self._significant,
            earlier(turn, SPACING),
            (
                _Cause(turn[counts], scale, "the heading changes {:.2f} times as fast as the turning rate says", 1.0),
                _Cause(time[counts], bias, "the turning rate is off by {:+.3f} rad/s: has the gyro a bias?"),
                _Cause(earlier(turn, SHIFT), late, "the heading comes {:.2f} s late", late=True),
            ),
        )
        heading = turn + off.mean()
        if turns and turns.cause.late:
            heading = np.interp(time - turns.size, time, heading)
        elif turns:
            heading = heading + turns.size * (turn - turn.mean() if turns.cause.number else time - time.mean())
        ahead = np.exp(1j * heading)
        path = np.cumsum(np.diff(way, prepend=way[0]) * 0.5 * (ahead + np.roll(ahead, 1)))
        place = x + 1j * y
        apart = (place - path)[counts]
        moves = _best(
            apart,
            sigma,
            self._significant,
            earlier(path, SPACING),
            (
                _Cause(path[counts], scale, "the pose moves {:.2f} times as far as the speed says", 1.0),
                _Cause(1j * path[counts], aside, "the robot moves {:+.2f} rad beside its heading"),
                _Cause(earlier(path, SHIFT), late, "the position comes {:.2f} s late", late=True),
            ),
        )
        nis = sum(value for _, value in self._nis) / len(self._nis)
        position, left = (0.5 * _spread(each) / sigma**2 for each in (apart, moves.left if moves else apart))
        others = (
            (0.5 * _spread((y + 1j * x - path)[counts]), "the pose moves as if x and y were swapped"),
            (0.5 * _spread((np.conj(place) - path)[counts]), "the pose moves as if y had the wrong sign"),
            (_spread((x - way)[counts]), "the twist is in the world's frame"),
        )
        cause = self._named(turns, moves, position, left, min((misfit / sigma**2, text) for misfit, text in others))
        return Doubts(cause, nis, position, _spread(off) / wide**2)

    def _named(self, turns: _Found | None, moves: _Found | None, position: float, left: float, other: tuple[float, str]) -> str:
        """Return the cause to name, if any."""
        if (moves or left > self._wrong) and other[0] < min(1.3 * left, CONVINCING * position):
            return other[1]
        found = [each for each in (turns, moves) if each]
        scales = [each for each in found if each.cause.number]
        for each in scales:
            if each.number < -0.5:
                return f"{str(each).split(' times')[0]} times: a wrong sign"
        if len(scales) == 2 and abs(scales[0].number / scales[1].number - 1.0) < 0.1:
            return f"poses change {scales[1].number:.2f} times as fast as the twist says: is the time between messages wrong?"
        if found and left < max(self._wrong, 0.1 * position):
            return ", and ".join(map(str, found))
        if self._degrees and self._measures:
            ratio, noisy = median(nis for _, nis in self._nis) / MEDIAN[self._degrees], self._noisy
        else:
            ratio, noisy = left, self._wrong
        if ratio > noisy:
            return f"{INNOVATIONS} are {ratio:.1f} times its variance: is R too small, or are there two sources?"
        if ratio < QUIET and self._measures:
            return f"{INNOVATIONS} are {ratio:.2f} times its variance: is R too large?"
        return ""
