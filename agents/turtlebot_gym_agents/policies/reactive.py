"""VFH+, which crosses a room by the current observation only, and with which every learned policy is compared.

It drives forwards only, and uses the inputs of `sight.look`. Its defaults are the best of 30 tries in the world "dense", with
the LiDAR "lds01" and the noise "tutorial".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import FINITE
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.observations import ROOM, ObservationTerm
from turtlebot_gym_agents.policies.geometric import Baseline, NonNegative, Positive, action_of
from turtlebot_gym_agents.policies.sight import HALF_SECTOR, Sight, look, time_to_contact

_TURNS = 72
_ANGLES = wrap_all(2.0 * np.pi * np.arange(_TURNS) / _TURNS)
"""Candidate directions, the first one ahead, rad; shape (72,)."""


@dataclass(eq=False, kw_only=True)
class VectorFieldHistogramPolicy(Baseline):
    """VFH+: choose the free direction for the robot's size with the least weighted angle to the goal, to the current direction
    and to the last choice; if none is free, turn on the spot towards the last choice.

    Ulrich, Borenstein, "VFH+: reliable obstacle avoidance for fast mobile robots", ICRA 1998.
    """

    terms: ClassVar[tuple[ObservationTerm, ...]] = ROOM
    """The terms of an observation that it reads."""
    ahead: Annotated[float, FINITE] = 0.1
    """Weight of the angle to the current direction; the angle to the goal has the weight 1."""
    last: Annotated[float, FINITE] = 0.64
    """Weight of the angle to the last direction chosen."""
    margin: NonNegative = 0.07
    """Clearance to keep around the robot, m."""
    lag: NonNegative = 0.01
    """Mean age of the beams beyond the stated age of the scan, s."""
    sight: Positive = 0.4
    """Distance beyond which obstacles are ignored, m."""
    gain: Positive = 1.6
    """Turning rate per angle to turn, 1/s."""
    focus: NonNegative = 1.7
    """How strictly the robot turns before it drives: the speed is proportional to this power of the cosine of the angle to
    turn."""
    caution: Positive = 0.6
    """Time to contact below which the speed is proportional to it, s."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._last: Any = np.nan

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last direction where an episode begins."""
        self._last = np.where(mask, np.nan, np.broadcast_to(self._last, np.shape(mask)))

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        to = self._look(observations)
        goal, last = np.angle(to.goal), wrap_all(np.asarray(self._last - to.omega * self.dt))
        last = np.where(np.isfinite(last), last, goal)
        cost = np.abs(wrap_all(_ANGLES - goal[..., None])) + self.ahead * np.abs(_ANGLES)
        cost = cost + self.last * np.abs(wrap_all(_ANGLES - last[..., None]))
        blocked = self._blocked(to, self.margin)
        angle = _ANGLES[np.argmin(np.where(blocked, np.inf, cost), axis=-1)]
        angle = np.where(np.abs(wrap_all(angle - goal)) <= np.pi / _TURNS, goal, angle)  # exactly to the goal
        stuck = blocked.all(axis=-1)
        self._last = np.where(stuck, last, angle)
        return self._drive(to, np.where(stuck, np.where(last >= 0.0, 0.5 * np.pi, -0.5 * np.pi), angle))

    def _look(self, observations: ArrayLike) -> Sight:
        return look(observations, self._robot, self.dt, self.lag)

    def _blocked(self, to: Sight, margin: float) -> NDArray[np.bool_]:
        """Return which candidates lead nearer to an obstacle than a margin, shape (..., 72)."""
        away = np.abs(to.points).reshape(-1, to.points.shape[-1])
        # Only few obstacles count: over all sectors, the products with the candidates would take most of the time.
        row, sector = np.nonzero(away < np.minimum(self.sight, np.abs(to.goal) + self._robot.radius).reshape(-1, 1))
        near, away = to.points.reshape(away.shape)[row, sector], away[row, sector]
        wide = np.arcsin(np.minimum((self._robot.radius + margin) / np.maximum(away, 1e-9), 1.0)) + HALF_SECTOR
        unit = (near / np.maximum(away, 1e-9))[:, None]
        between = np.cos(_ANGLES) * unit.real + np.sin(_ANGLES) * unit.imag
        leads = between > np.cos(np.minimum(wide, np.pi))[:, None]
        blocked, first = np.zeros((to.goal.size, _TURNS), np.bool_), np.flatnonzero(np.diff(row, prepend=-1))
        blocked[row[first]] = np.logical_or.reduceat(leads, first)
        return blocked.reshape(*to.goal.shape, _TURNS)

    def _drive(self, to: Sight, angle: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return actions (..., 2) towards directions (...), slower near contact."""
        robot = self._robot
        v = np.maximum(np.cos(angle), 0.0) ** self.focus * robot.max_linear
        omega = np.clip(self.gain * angle, -robot.max_angular, robot.max_angular)
        time = time_to_contact(to.points, v[..., None], omega[..., None], robot.radius).min(axis=-1)
        return action_of(v * np.minimum(time / self.caution, 1.0) / robot.max_linear, omega / robot.max_angular)
