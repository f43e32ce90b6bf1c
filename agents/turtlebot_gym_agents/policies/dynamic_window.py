"""The dynamic window: choose an arc instead of a direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.systems import ROOM_LAYOUT
from turtlebot_gym.validation import NON_NEGATIVE, POSITIVE, Range
from turtlebot_gym_agents.policies.geometric import Baseline, action_of
from turtlebot_gym_agents.policies.reactive import Lag, Margin
from turtlebot_gym_agents.policies.sight import arc, look

_BENDS = np.geomspace(0.3, 25.0, 10)
_CURVATURES = np.concatenate([-_BENDS[::-1], [0.0], _BENDS])
"""Curvatures of the arcs, 1/m, from straight ahead to nearly on the spot; shape (21,)."""
_POINTS = 20
"""Number of points at which each arc is checked."""
_AT_ONCE = 16
"""Number of robots whose distances from all points are computed at once, so that these fit into the processor's cache."""
_SPEEDS = np.array([0.25, 0.5, 1.0])
"""Shares of the highest speed of each arc."""


@dataclass(eq=False, kw_only=True)
class DynamicWindowPolicy(Baseline):
    """The dynamic window: choose the pair of speed and turning rate whose arc scores best.

    The score combines the heading at the arc's end, the time to contact on it, and the speed. Pairs from which the robot could
    not stop in time are excluded.

    References:
        Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", *IEEE Robotics & Automation Magazine* 4
        (1997).
    """

    layout: ClassVar[int] = ROOM_LAYOUT
    """Layout of its observations."""
    heading: Annotated[float, NON_NEGATIVE, Range(0.3, 10.0, log=True)] = 0.94
    """Weight of the heading to the goal at the end; the speed has the weight 1."""
    clear: Annotated[float, NON_NEGATIVE, Range(0.1, 10.0, log=True)] = 1.6
    """Weight of the time to contact."""
    horizon: Annotated[float, POSITIVE, Range(1.0, 8.0)] = 4.7
    """Length of an arc, s; contacts beyond it are ignored."""
    aim: Annotated[float, POSITIVE, Range(0.2, 3.0)] = 1.46
    """Time after which the heading is judged, s."""
    brake: Annotated[float, POSITIVE, Range(0.15, 1.5)] = 0.58
    """Least time to contact of an admissible arc, s."""
    margin: Margin = 0.075
    """Clearance to keep around the robot, m."""
    lag: Lag = 0.06
    """Mean age of the beams beyond the stated age of the scan, s."""

    def __post_init__(self) -> None:
        super().__post_init__()
        radius = self._robot.radius + self.margin
        length = self._robot.max_linear * self.horizon * np.arange(1, _POINTS + 1) / _POINTS
        path, _ = arc(1.0, _CURVATURES[:, None], length)
        path = path.ravel()
        self._path = np.stack([-2.0 * path.real, -2.0 * path.imag, np.ones_like(path.real)]).astype(np.float32)
        self._near = (radius**2 - np.abs(path) ** 2).astype(np.float32)
        self._length = np.append(length, np.inf)
        turning = np.abs(_CURVATURES)[:, None]
        fastest = np.minimum(
            self._robot.max_wheel / (1.0 + turning * self._robot.wheel_separation / 2.0), self._robot.max_linear
        )
        fastest = np.minimum(fastest, self._robot.max_angular / np.maximum(turning, 1e-9))
        self._v = fastest * _SPEEDS
        self._omega = self._v * _CURVATURES[:, None]

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        to, robot = look(observations, self._robot, self.dt, self.lag), self._robot
        time = self._free_length(to.points)[..., None] / self._v
        arrival = np.abs(to.goal)[..., None, None] / robot.max_linear  # obstacles beyond the goal do not matter
        ends, headings = arc(self._v, self._omega, np.minimum(time, self.aim))
        off = np.abs(np.angle((to.goal[..., None, None] - ends) * np.conj(headings)))
        score = self.heading * (1.0 - off / np.pi) + self._v / robot.max_linear
        score = score + self.clear * np.minimum(np.where(time > arrival, np.inf, time) / self.horizon, 1.0)
        score = np.where(time >= self.brake, score, -np.inf).reshape(*to.goal.shape, -1)
        best = np.argmax(score, axis=-1)
        spot = np.where(np.angle(to.goal) >= 0.0, 1.0, -1.0)
        stuck = ~np.isfinite(score).any(axis=-1)
        v, omega = self._v.ravel()[best] / robot.max_linear, self._omega.ravel()[best] / robot.max_angular
        return action_of(np.where(stuck, 0.0, v), np.where(stuck, spot, omega))

    def _free_length(self, points: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the free distance on each curve before the robot meets a point, shape (..., curvatures), m."""
        rows = points.reshape(-1, points.shape[-1])
        meets = np.empty((len(rows), self._near.size), np.bool_)
        for at in range(0, len(rows), _AT_ONCE):
            some = rows[at : at + _AT_ONCE]
            # |path - point|^2 <= radius^2, with |path|^2 on the other side: one product and one comparison.
            p = np.stack([some.real, some.imag, some.real**2 + some.imag**2], axis=-1).astype(np.float32)
            meets[at : at + _AT_ONCE] = (p @ self._path).min(axis=-2) <= self._near
        meets = meets.reshape(*points.shape[:-1], len(_CURVATURES), _POINTS)
        first = np.where(meets.any(axis=-1), meets.argmax(axis=-1), _POINTS)
        return self._length[first] - np.where(first < _POINTS, self._length[0], 0.0)
