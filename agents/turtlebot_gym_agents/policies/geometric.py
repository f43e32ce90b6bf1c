"""Policies without learning: the tutorial's law, and the geometric ones with which every learned policy is compared.

They need only numpy, so that a robot can run them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import NON_NEGATIVE, POSITIVE, Range, check_fields
from turtlebot_gym.observations import OPEN_GROUND, Observation, ObservationTerm
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym_agents.policies.policy import numbers_of

Positive = Annotated[float, POSITIVE]
NonNegative = Annotated[float, NON_NEGATIVE]
"""Types of the numbers of a policy."""
_TINY = 1e-12  # instead of zero in a denominator


@dataclass(eq=False)
class Baseline:
    """Base of the policies without learning: robot and control interval."""

    terms: ClassVar[tuple[ObservationTerm, ...]] = OPEN_GROUND
    """The terms of an observation that it reads."""
    robot: str | Robot = "burger"
    """A name in `turtlebot_gym.ROBOTS`, or a robot."""
    dt: Positive = REFERENCE_PERIOD
    """Control interval, s."""

    def __post_init__(self) -> None:
        self._robot = make_robot(self.robot)
        check_fields(self, "")

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n)."""
        raise NotImplementedError


@dataclass(eq=False, kw_only=True)
class ProportionalPolicy(Baseline):
    """The tutorial's law: ``v = clip(kv d)``, ``omega = clip(komega wrap(theta_ref - theta))``.

    It turns to the *reference's heading*, never to the bearing of the point, so it arrives only if the point happens to lie
    ahead. It is included to show how it fails.
    """

    kv: Positive = 0.5
    """Gain on the distance, 1/s."""
    komega: Positive = 1.5
    """Gain on the remaining turn, 1/s."""

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        o, robot = _fields(observations), self._robot
        turn = np.arctan2(o.sin_turn, o.cos_turn)
        return action_of(self.kv * o.distance / robot.max_linear, self.komega * turn / robot.max_angular)


@dataclass(eq=False, kw_only=True)
class BearingPolicy(Baseline):
    """Steer to the bearing of the waypoint, forwards or backwards, whichever needs the smaller turn.

    A command acts one step late, so all decisions use where the waypoint *will* lie in the body frame. With the current bearing
    instead, the direction would alternate every step at bearings near 90 degrees. The defaults suit Nav under most noises.
    """

    gain: Positive = 6.0
    """Turning rate per angle to turn, 1/s."""
    focus: NonNegative = 0.5
    """How strictly the robot turns before it drives: the speed is proportional to this power of the cosine of the angle to
    turn."""
    tolerance: NonNegative = 0.03
    """Bearings that miss the waypoint by less than this are not corrected, m. Turning costs speed when the wheels are at their
    limit, and noise would cause constant turning."""
    slow: Positive = 0.05
    """Distance below which the speed is proportional to the distance, m. Without it a robot that is not stopped would shuttle
    across its goal."""

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        return self.steer(Upcoming(observations, self._robot, self.dt).waypoint)

    def steer(self, point: NDArray[np.complex128]) -> NDArray[np.float32]:
        """Return actions (..., 2) that steer to points (...), given in the body frame: ahead + 1j left, m."""
        direction = np.where((point.real < 0.0) & self._robot.reverse, -1.0, 1.0)
        angle, distance = np.angle(direction * point), np.abs(point)
        speed = np.maximum(np.cos(angle), 0.0) ** self.focus * np.minimum(distance / self.slow, 1.0)
        allowed = np.arcsin(self.tolerance / np.maximum(distance, self.tolerance)) if self.tolerance else 0.0
        turn = np.sign(angle) * np.maximum(np.abs(angle) - allowed, 0.0)
        return action_of(direction * speed, self.gain * turn / self._robot.max_angular)


@dataclass(eq=False, kw_only=True)
class CornerPolicy(BearingPolicy):
    """Cut corners: steer as `BearingPolicy` does, but to a point inside the bend towards the following waypoint, if there is
    one.

    The point lies on the bisector of the angle at the waypoint, where, to first order, a shortest path touches a circle around
    the waypoint. It is ``cut`` away, but no further than a share of the distance to the nearer of robot and following waypoint:
    so a robot whose estimate is in the circle while its true pose is not still comes nearer.
    """

    cut: Positive = 0.26
    """Distance of the aim point from the waypoint, m; less than the radius of arrival."""
    depth: Annotated[float, Range(0.0, 1.0, open_high=True)] = 0.75
    """The share of the distance, less than 1."""

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        to = Upcoming(observations, self._robot, self.dt)
        to_robot, onward = -to.waypoint, to.following - to.waypoint  # from the waypoint
        robot_away, next_away = np.abs(to_robot), np.abs(onward)
        bisector = to_robot / np.maximum(robot_away, _TINY) + onward / np.maximum(next_away, _TINY)
        twice_cosine = np.abs(bisector)  # of half the angle
        nearer = 0.5 * twice_cosine * np.minimum(robot_away, next_away)
        inwards = np.minimum(self.cut, self.depth * nearer) / np.maximum(twice_cosine, _TINY)
        return self.steer(to.waypoint + inwards * bisector)


class Upcoming:
    """Positions when the next command acts, after a control interval ``dt``, s, at the current speeds, in the body frame:
    ahead + 1j left, m; for observations (..., n).
    """

    def __init__(self, observations: ArrayLike, robot: Robot, dt: float) -> None:
        self._observed = o = _fields(observations)
        self._moved = o.v * robot.max_linear * dt
        self._frame = np.exp(-1j * (o.omega * robot.max_angular * dt))

    @cached_property
    def waypoint(self) -> NDArray[np.complex128]:
        """The waypoint, shape (...)."""
        o = self._observed
        return (o.distance * (o.cos_bearing + 1j * o.sin_bearing) - self._moved) * self._frame

    @cached_property
    def following(self) -> NDArray[np.complex128]:
        """The waypoint after it, shape (...); the same one if it is the last."""
        o = self._observed
        return (o.next_distance * (o.cos_next + 1j * o.sin_next) - self._moved) * self._frame


def _fields(observations: ArrayLike) -> Observation:
    """Return the components of observations, without a room's ranges."""
    return Observation(*np.moveaxis(numbers_of(observations, OPEN_GROUND).astype(np.float64), -1, 0))


def action_of(forward: Any, turn: Any) -> NDArray[np.float32]:
    """Return actions (..., 2) from shares of the robot's limits."""
    return np.clip(np.stack([forward, turn], axis=-1), -1.0, 1.0).astype(np.float32)
