"""Reactive policies that cross a room by the current observation only, with which every learned policy is compared.

All of them drive forwards only, use the inputs of `sight.look`, and can be tuned by `benchmarks/tune_baseline.py`. Their
defaults are the best of 30 tries each in the world "dense", with the LiDAR "lds01" and the noise "tutorial".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.observations import ROOM, ObservationTerm
from turtlebot_gym.validation import FINITE, NON_NEGATIVE, POSITIVE, Range
from turtlebot_gym_agents.policies.geometric import Baseline, action_of
from turtlebot_gym_agents.policies.sight import HALF_SECTOR, Sight, arc, look, time_to_contact

_TURNS = 72
_ANGLES = wrap_all(2.0 * np.pi * np.arange(_TURNS) / _TURNS)
"""Candidate directions, the first one ahead, rad; shape (72,)."""
Ahead = Annotated[float, FINITE, Range(0.0, 1.0)]
Last = Annotated[float, FINITE, Range(0.0, 2.0)]
Margin = Annotated[float, NON_NEGATIVE, Range(0.0, 0.15)]
Lag = Annotated[float, NON_NEGATIVE, Range(0.0, 0.3)]
SightRange = Annotated[float, POSITIVE, Range(0.25, 3.0, log=True)]
Gain = Annotated[float, POSITIVE, Range(1.0, 10.0, log=True)]
Focus = Annotated[float, NON_NEGATIVE, Range(0.5, 6.0)]
Caution = Annotated[float, POSITIVE, Range(0.1, 3.0, log=True)]
_BENDS = np.geomspace(0.3, 25.0, 10)
_CURVATURES = np.concatenate([-_BENDS[::-1], [0.0], _BENDS])
"""Curvatures of the arcs, 1/m, from straight ahead to nearly on the spot; shape (21,)."""
_POINTS = 20
"""Number of points at which each arc is checked."""
_AT_ONCE = 16
"""Robots that are processed together: few, so that their distances fit into the processor's cache."""
_SPEEDS = np.array([0.25, 0.5, 1.0])
"""Shares of the highest speed of each arc."""


@dataclass(eq=False, kw_only=True)
class _Reactive(Baseline):
    """Base of the policies that choose a direction."""

    terms: ClassVar[tuple[ObservationTerm, ...]] = ROOM
    """The terms of an observation that it reads."""
    margin: Margin
    """Clearance to keep around the robot, m."""
    lag: Lag
    """Mean age of the beams beyond the stated age of the scan, s."""
    sight: SightRange
    """Distance beyond which obstacles are ignored, m."""
    gain: Gain
    """Turning rate per angle to turn, 1/s."""
    focus: Focus
    """How strictly the robot turns before it drives: the speed is proportional to this power of the cosine of the angle to
    turn."""
    caution: Caution
    """Time to contact below which the speed is proportional to it, s."""

    def _look(self, observations: ArrayLike) -> Sight:
        return look(observations, self._robot, self.dt, self.lag)

    def _blocked(self, to: Sight, margin: float) -> NDArray[np.bool_]:
        """Return which candidates lead nearer to an obstacle than a margin, shape (..., 72)."""
        away = np.abs(to.points)
        wide = np.arcsin(np.minimum((self._robot.radius + margin) / np.maximum(away, 1e-9), 1.0)) + HALF_SECTOR
        counts = away < np.minimum(self.sight, np.abs(to.goal) + self._robot.radius)[..., None]
        cosine = np.where(counts, np.cos(np.minimum(wide, np.pi)), 2.0)
        unit = to.points / np.maximum(away, 1e-9)
        between = np.cos(_ANGLES)[:, None] * unit.real[..., None, :] + np.sin(_ANGLES)[:, None] * unit.imag[..., None, :]
        return np.any(between > cosine[..., None, :], axis=-1)

    def _drive(self, to: Sight, angle: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return actions (..., 2) towards directions (...), slower near contact."""
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

    ahead: Ahead = 0.1
    """Weight of the angle to the current direction; the angle to the goal has the weight 1."""
    last: Last = 0.64
    """Weight of the angle to the last direction chosen."""
    margin: Margin = 0.07
    lag: Lag = 0.01
    sight: SightRange = 0.4
    gain: Gain = 1.6
    focus: Focus = 1.7
    caution: Caution = 0.6

    def __post_init__(self) -> None:
        super().__post_init__()
        self._last: Any = np.nan

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the last direction where an episode begins."""
        self._last = np.where(mask, np.nan, np.broadcast_to(self._last, np.shape(mask)))

    def keep(self, mask: NDArray[np.bool_]) -> None:
        """Drop the rows where the mask is false."""
        self._last = np.broadcast_to(self._last, np.shape(mask))[mask]

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
    sight: SightRange = 0.4
    gain: Gain = 2.5
    focus: Focus = 1.0
    caution: Caution = 0.7

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        to = self._look(observations)
        goal = np.angle(to.goal)
        outside = np.abs(wrap_all(_ANGLES - goal[..., None])) > self.field
        blocked = self._blocked(to, self.margin)
        gap = _middle_of_widest(~(blocked | outside))
        nearest = np.maximum(np.abs(to.points).min(axis=-1) - self._robot.radius, 1e-3)
        share = self.alpha / (self.alpha + nearest)
        angle = wrap_all(goal + share * wrap_all(np.where(np.isfinite(gap), gap, goal) - goal))
        at = np.round(goal / (2.0 * np.pi) * _TURNS).astype(np.int64) % _TURNS
        is_open = ~np.take_along_axis(blocked, at[..., None], axis=-1)[..., 0]
        angle = np.where(is_open & ~blocked.any(axis=-1), goal, angle)
        stuck = ~np.isfinite(gap)
        return self._drive(to, np.where(stuck, np.where(goal >= 0.0, 0.5 * np.pi, -0.5 * np.pi), angle))


@dataclass(eq=False, kw_only=True)
class DynamicWindowPolicy(Baseline):
    """The dynamic window: choose the pair of speed and turning rate whose arc scores best.

    The score combines the heading at the arc's end, the time to contact on it, and the speed. Pairs from which the robot could
    not stop in time are excluded.

    References:
        Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", *IEEE Robotics & Automation Magazine* 4
        (1997).
    """

    terms: ClassVar[tuple[ObservationTerm, ...]] = ROOM
    """The terms of an observation that it reads."""
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
        """Return the free distance on each curve, shape (..., curvatures), m."""
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


def _middle_of_widest(is_open: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the middle of the widest run of open directions, rad; NaN where none is open."""
    # Twice around, so that a gap behind the robot is one run.
    twice = np.concatenate([is_open, is_open], axis=-1)
    at = np.arange(2 * _TURNS)
    length = np.minimum(at - np.maximum.accumulate(np.where(twice, -1, at), axis=-1), _TURNS)
    end = np.argmax(length, axis=-1)
    longest = np.take_along_axis(length, end[..., None], axis=-1)[..., 0]
    middle = (end - 0.5 * (longest - 1)) * (2.0 * np.pi / _TURNS)
    return np.where(is_open.any(axis=-1), wrap_all(middle), np.nan)
