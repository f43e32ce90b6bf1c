"""Reactive policies that cross a room by the observation alone, with which every learned policy is compared.

All of them drive forwards only, use the inputs of `sight.look`, and can be tuned by `turtlebot-gym tune-baseline`. Their
defaults are the best of 30 tries each in the world "dense", with the LiDAR "lds01" and the noise "tutorial".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.systems import ROOM_LAYOUT
from turtlebot_gym.validation import FINITE, NON_NEGATIVE, POSITIVE, Range
from turtlebot_gym_agents.policies.geometric import Baseline, action_of, wrap
from turtlebot_gym_agents.policies.sight import HALF_SECTOR, Sight, look, time_to_contact

_TURNS = 72
_ANGLES = wrap(2.0 * np.pi * np.arange(_TURNS) / _TURNS)
"""Candidate directions, the first one ahead, rad; shape (72,)."""
Margin = Annotated[float, NON_NEGATIVE, Range(0.0, 0.15)]
Lag = Annotated[float, NON_NEGATIVE, Range(0.0, 0.3)]
_Sight = Annotated[float, POSITIVE, Range(0.25, 3.0, log=True)]
_Gain = Annotated[float, POSITIVE, Range(1.0, 10.0, log=True)]
_Focus = Annotated[float, NON_NEGATIVE, Range(0.5, 6.0)]
_Caution = Annotated[float, POSITIVE, Range(0.1, 3.0, log=True)]


@dataclass(eq=False, kw_only=True)
class _Reactive(Baseline):
    """Base of the policies that choose a direction."""

    layout: ClassVar[int] = ROOM_LAYOUT
    """Layout of its observations."""
    margin: Margin
    """Clearance to keep around the robot, m."""
    lag: Lag
    """Mean age of the beams beyond the stated age of the scan, s."""
    sight: _Sight
    """Distance beyond which obstacles are ignored, m."""
    gain: _Gain
    """Turning rate per angle to turn, 1/s."""
    focus: _Focus
    """How strictly the robot turns before it drives: the speed is proportional to this power of the cosine of the angle to
    turn."""
    caution: _Caution
    """Time to contact below which the speed is proportional to it, s."""

    def _look(self, observations: ArrayLike) -> Sight:
        return look(observations, self._robot, self.dt, self.lag)

    def _blocked(self, to: Sight) -> NDArray[np.bool_]:
        """Return which of the candidates lead into an obstacle on this side of the goal, shape (..., 72)."""
        away = np.abs(to.points)
        wide = np.arcsin(np.minimum((self._robot.radius + self.margin) / np.maximum(away, 1e-9), 1.0)) + HALF_SECTOR
        counts = away < np.minimum(self.sight, np.abs(to.goal) + self._robot.radius)[..., None]
        cosine = np.where(counts, np.cos(np.minimum(wide, np.pi)), 2.0)
        unit = to.points / np.maximum(away, 1e-9)
        between = np.cos(_ANGLES)[:, None] * unit.real[..., None, :] + np.sin(_ANGLES)[:, None] * unit.imag[..., None, :]
        return np.any(between > cosine[..., None, :], axis=-1)

    def _drive(self, to: Sight, angle: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return actions (..., 2) towards directions (...), slower when contact is closer in time."""
        robot = self._robot
        v = np.maximum(np.cos(angle), 0.0) ** self.focus * robot.max_linear
        omega = np.clip(self.gain * angle, -robot.max_angular, robot.max_angular)
        time = time_to_contact(to.points, v[..., None], omega[..., None], robot.radius).min(axis=-1)
        return action_of(v * np.minimum(time / self.caution, 1.0) / robot.max_linear, omega / robot.max_angular)


@dataclass(eq=False, kw_only=True)
class VectorFieldHistogramPolicy(_Reactive):
    """VFH+: choose the free direction for the robot's size with the least weighted angle to the goal, to the current direction
    and to the last choice.

    If none is free, the robot turns on the spot towards the last choice.

    References:
        Ulrich, Borenstein, "VFH+: reliable obstacle avoidance for fast mobile robots", ICRA 1998.
    """

    ahead: Annotated[float, FINITE, Range(0.0, 1.0)] = 0.1
    """Weight of the angle to the current direction; the angle to the goal has the weight 1."""
    last: Annotated[float, FINITE, Range(0.0, 2.0)] = 0.64
    """Weight of the angle to the last direction chosen."""
    margin: Margin = 0.07
    lag: Lag = 0.01
    sight: _Sight = 0.4
    gain: _Gain = 1.6
    focus: _Focus = 1.7
    caution: _Caution = 0.6

    def __post_init__(self) -> None:
        super().__post_init__()
        self._last: Any = np.nan

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last direction where an episode begins."""
        self._last = np.where(mask, np.nan, np.broadcast_to(self._last, np.shape(mask)))

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        to = self._look(observations)
        goal, last = np.angle(to.goal), wrap(np.asarray(self._last - to.omega * self.dt))
        last = np.where(np.isfinite(last), last, goal)
        cost = np.abs(wrap(_ANGLES - goal[..., None])) + self.ahead * np.abs(_ANGLES)
        cost = cost + self.last * np.abs(wrap(_ANGLES - last[..., None]))
        blocked = self._blocked(to)
        angle = _ANGLES[np.argmin(np.where(blocked, np.inf, cost), axis=-1)]
        angle = np.where(np.abs(wrap(angle - goal)) <= np.pi / _TURNS, goal, angle)  # exactly to the goal
        stuck = blocked.all(axis=-1)
        self._last = np.where(stuck, last, angle)
        return self._drive(to, np.where(stuck, np.where(last >= 0.0, 0.5 * np.pi, -0.5 * np.pi), angle))


@dataclass(eq=False, kw_only=True)
class FollowTheGapPolicy(_Reactive):
    """Follow the gap: steer between the goal and the middle of the widest gap, closer to the gap the nearer an obstacle is.

    References:
        Sezer, Gokasan, "A novel obstacle avoidance algorithm: Follow the Gap Method", *Robotics and Autonomous Systems* 60
        (2012).
    """

    alpha: Annotated[float, FINITE, Range(0.02, 2.0, log=True)] = 0.16
    """Distance of an obstacle at which gap and goal have equal weight, m."""
    field: Annotated[float, FINITE, Range(0.8, 3.1)] = 1.66
    """Angle on both sides of the goal in which gaps are considered, rad."""
    margin: Margin = 0.0
    lag: Lag = 0.09
    sight: _Sight = 0.4
    gain: _Gain = 2.5
    focus: _Focus = 1.0
    caution: _Caution = 0.7

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        to = self._look(observations)
        goal = np.angle(to.goal)
        outside = np.abs(wrap(_ANGLES - goal[..., None])) > self.field
        blocked = self._blocked(to)
        gap = _middle_of_widest(~(blocked | outside))
        nearest = np.maximum(np.abs(to.points).min(axis=-1) - self._robot.radius, 1e-3)
        share = self.alpha / (self.alpha + nearest)
        angle = wrap(goal + share * wrap(np.where(np.isfinite(gap), gap, goal) - goal))
        at = np.round(goal / (2.0 * np.pi) * _TURNS).astype(np.int64) % _TURNS
        is_open = ~np.take_along_axis(blocked, at[..., None], axis=-1)[..., 0]
        angle = np.where(is_open & ~blocked.any(axis=-1), goal, angle)
        stuck = ~np.isfinite(gap)
        return self._drive(to, np.where(stuck, np.where(goal >= 0.0, 0.5 * np.pi, -0.5 * np.pi), angle))


def _middle_of_widest(is_open: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the angle of the middle of the widest run of open directions, shape (...); NaN where none is open."""
    twice = np.concatenate([is_open, is_open], axis=-1)
    at = np.arange(2 * _TURNS)
    length = np.minimum(at - np.maximum.accumulate(np.where(twice, -1, at), axis=-1), _TURNS)
    end = np.argmax(length, axis=-1)
    longest = np.take_along_axis(length, end[..., None], axis=-1)[..., 0]
    middle = (end - 0.5 * (longest - 1)) * (2.0 * np.pi / _TURNS)
    return np.where(is_open.any(axis=-1), wrap(middle), np.nan)
