"""Which mistake of a driver makes the motion of its poses differ from that of its twists. Each mistake predicts one motion."""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.models.angles import wrap

UNITS = {1000.0: "mm", 100.0: "cm", 39.37: "inches", 3.281: "feet"}
"""Units of length that are taken for metres, by their number in one."""
DEGREES = math.degrees(1.0)
FROZEN = "the pose does not move though the wheels are said to turn"
NO_HEADING = "the heading stands still though the robot is said to turn: is the IMU alive?"


class Compared(NamedTuple):
    """A robot's motion over a window, by its poses and by its twists, in the frame of the window's first pose."""

    theta: float
    """Heading of the first pose, rad."""
    ahead: float
    """Motion of the pose, m ..."""
    left: float
    turn: float
    """... and rad."""
    told: tuple[float, float, float]
    """The same by the twists; m, m, rad."""
    allowed: tuple[float, float, float]
    """Differences that are tolerated: ahead, aside and of the turn; m, m, rad."""

    def excess(self, told: tuple[float, float, float]) -> float:
        """Return by how many times the motion of the pose differs from another one by more than is tolerated."""
        most, aside, wide = self.allowed
        away = math.hypot((self.ahead - told[0]) / most, (self.left - told[1]) / aside)
        return max(away, abs(wrap(self.turn - told[2])) / wide)


def explanation(compared: Compared) -> str:
    """Return which mistake of a driver makes a window's pose and twist differ as they do, or an empty text."""
    theta, ahead, left, _, (x, y, omega), (most, _, wide) = compared
    factor = math.hypot(ahead, left) / max(math.hypot(x, y), 1e-9)
    units = [((x, y, DEGREES * omega), "the heading changes 57 times as fast as the turning rate says: in degrees?")]
    ratio = factor if factor > 1.0 else 1.0 / max(factor, 1e-9)
    many = "the pose moves {:.3g} times as far as the twist says" if factor > 1.0 else "the twist is {:.3g} times too large"
    text = many.format(ratio) + unit_of(ratio)
    scaled = (factor * x, factor * y, omega), text
    sine, cosine, along = math.sin(2.0 * theta), math.cos(2.0 * theta), math.cos(theta)
    guesses = [
        ((0.0, 0.0, 0.0), FROZEN),
        ((0.0, 0.0, omega), "the position does not move though the wheels are said to turn"),
        ((x, y, 0.0), NO_HEADING),
        ((-x, -y, omega), "the pose moves against the speed: one of them has the wrong sign"),
        ((x, -y, -omega), "the heading turns against the turning rate: one of them has the wrong sign"),
        ((x * sine + y * cosine, x * cosine - y * sine, omega), "the pose moves as if x and y were swapped"),
        ((x * cosine - y * sine, -x * sine - y * cosine, omega), "the pose moves as if y had the wrong sign"),
        ((x, y, omega / DEGREES), "the turning rate is 57 times as large as the heading's change: in degrees/s?"),
    ]
    if 0.2 < abs(along) < 0.9:
        guesses.append(((x / along, y / along, omega), "the twist is in the world's frame"))
    guesses.append(scaled)
    if math.hypot(x, y) < 0.5 * most and abs(omega) < 0.5 * wide:  # hardly any motion, of which most mistakes make the same
        guesses = [scaled] if text.endswith("?") else []
    most = min(1.0, 0.5 * compared.excess((x, y, omega)))
    fits = [(round(compared.excess(told), 6), text) for told, text in (*units, *guesses)]
    return min((fit for fit in fits if fit[0] < most), default=(0.0, ""), key=lambda fit: fit[0])[1]  # the first of the best


def unit_of(factor: float, within: float = 0.1) -> str:
    """Return the unit that makes odometry larger by about a factor, as a question, or an empty text."""
    return next((f": in {unit}?" for many, unit in UNITS.items() if abs(factor / many - 1.0) < within), "")
