"""Wheels watched while a robot is localized: a tyre or a floor that changes shows in how far odometry and the belief moved.

Between two beliefs that scans have confirmed, odometry says that the robot went a way d and turned by t; the belief went
``scale d`` and turned by ``turn t + veer d``. Recursive least squares follow these three numbers slowly: what was seen more
than some tens of metres ago is forgotten, and a window that differs by far more than its noise, such as slip or a leap of the
belief, counts for nothing. The watch reports; it does not change what the localizer assumes.

References:
    Ljung, *System Identification* (1999), section 11.2: recursive least squares with forgetting.
    Larsen, Hansen, Andersen, Ravn, "Location estimation for an autonomously guided vehicle using an augmented Kalman filter to
    autocalibrate the odometry", FUSION (1998).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from turtlebot_gym.models.angles import wrap
from turtlebot_gym.values import Pose

WAY, TURN = 1.0, 2.0
"""Distance or turn after which a window ends, m and rad."""
MEMORY = 30.0
"""Way after which a window counts 1/e, m; a turn by 1 rad counts as half a metre."""
LEVER = 0.5
"""m per rad."""
PRIOR = 0.1
"""Standard deviation of the three numbers before anything is seen."""
MOST = 0.3
"""Largest change that is believed."""
BELIEF = (0.03, 0.015)
"""Standard deviations of a window's ends by the belief, m and rad ..."""
WHEELS = (0.03, 0.03)
"""... and by the noise of wheels, m and rad per root of m."""
GATE = 5.0
"""Standard deviations beyond which a window counts for nothing."""
CHANGED = (0.03, 3.0)
"""Change that is reported, if it is so many standard deviations."""


class Wheels(NamedTuple):
    """How a robot's wheels differ from what its odometry assumes."""

    scale: float
    """Way over that by odometry."""
    turn: float
    """Turn over that by odometry."""
    veer: float
    """Turn per metre driven, rad/m."""
    deviations: tuple[float, float, float]
    """Standard deviations of the three."""
    windows: int
    """Number of windows that counted."""

    @property
    def has_changed(self) -> bool:
        """Whether one of them is clearly not as assumed."""
        off = (abs(self.scale - 1.0), abs(self.turn - 1.0), abs(self.veer))
        return any(by > CHANGED[0] and by > CHANGED[1] * s for by, s in zip(off, self.deviations, strict=True))

    @property
    def text(self) -> str:
        """The numbers with their 95 % intervals."""
        halves = [1.96 * deviation for deviation in self.deviations]
        parts = zip(("scale", "turn", "veer"), (self.scale, self.turn, self.veer), halves, strict=True)
        return ", ".join(f"{name} {value:.3f} +- {half:.3f}" for name, value, half in parts)


class WheelWatch:
    """Follows `Wheels` from beliefs and odometry."""

    def __init__(self) -> None:
        self._x, self._P, self._windows = np.array([1.0, 1.0, 0.0]), PRIOR**2 * np.eye(3), 0
        self._begin: tuple[Pose, Pose] | None = None

    @property
    def wheels(self) -> Wheels:
        """What was found so far."""
        deviations = np.sqrt(np.diag(self._P)).tolist()
        scale, turn, veer = self._x.tolist()
        return Wheels(scale, turn, veer, (deviations[0], deviations[1], deviations[2]), self._windows)

    def see(self, belief: Pose, odometry: Pose, *, is_confirmed: bool) -> None:
        """Take a belief after a scan, and the odometry at the same time.

        Args:
            belief: Pose in the map; m, m, rad.
            odometry: Pose by the wheels.
            is_confirmed: Whether the scan confirms the belief; if not, a new window begins.
        """
        if not is_confirmed:
            self._begin = None
            return
        if self._begin is None:
            self._begin = belief, odometry
            return
        way, turn = _moved(self._begin[0], belief)
        by_wheels, turn_by_wheels = _moved(self._begin[1], odometry)
        if abs(by_wheels) < WAY and abs(turn_by_wheels) < TURN:
            return
        self._begin = belief, odometry
        size = abs(by_wheels) + LEVER * abs(turn_by_wheels)
        rows = (
            (np.array([by_wheels, 0.0, 0.0]), way, BELIEF[0] ** 2 + WHEELS[0] ** 2 * size),
            (np.array([0.0, turn_by_wheels, by_wheels]), turn, BELIEF[1] ** 2 + WHEELS[1] ** 2 * size),
        )
        if any(abs(y - h @ self._x) > GATE * math.sqrt(h @ self._P @ h + R) for h, y, R in rows):
            return
        forget = math.exp(size / MEMORY)
        # Forgetting ends at the prior: what a drive does not show again is not known less than at first.
        self._P = self._P * forget
        shrink = np.minimum(PRIOR / np.sqrt(np.diag(self._P)), 1.0)
        self._P = self._P * np.outer(shrink, shrink)
        for h, y, R in rows:
            gain = self._P @ h / (h @ self._P @ h + R)
            self._x = self._x + gain * (y - h @ self._x)
            self._P = self._P - np.outer(gain, h @ self._P)
        self._x = np.clip(self._x, [1.0 - MOST, 1.0 - MOST, -MOST], [1.0 + MOST, 1.0 + MOST, MOST])
        self._windows += 1


def _moved(first: Pose, last: Pose) -> tuple[float, float]:
    """Return the signed way and the turn from a pose to another one, on an arc; m, rad."""
    turn = wrap(last.theta - first.theta)
    dx, dy, middle = last.x - first.x, last.y - first.y, first.theta + 0.5 * turn
    chord = dx * math.cos(middle) + dy * math.sin(middle)
    half = 0.5 * turn
    return chord * (half / math.sin(half) if abs(half) > 1e-6 else 1.0), turn
