"""Policies that need no learning: the tutorial's law, and the geometric ones that every learned policy is compared with.

Only numpy is needed here: a robot runs them too.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.tasks import Observation


class ProportionalPolicy:
    """The tutorial's law: ``v = clip(kv d)``, ``omega = clip(komega wrap(theta_ref - theta))``.

    It turns to the *reference's heading*, never to the bearing of the point, so it gets where it should only if the point
    happens to lie ahead. It is here to be shown failing.

    Args:
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot; commands are clipped to its limits, axis by axis.
        kv: Gain on the distance, 1/s.
        komega: Gain on the heading still to turn, 1/s.
    """

    def __init__(self, robot: str | Robot = "burger", *, kv: float = 0.5, komega: float = 1.5) -> None:
        _require_positive(kv=kv, komega=komega)
        self._robot, self._kv, self._komega = make_robot(robot), kv, komega

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 13)."""
        o, robot = _fields(observations), self._robot
        turn = np.arctan2(o.sin_turn, o.cos_turn)
        return _action(self._kv * o.distance / robot.max_linear, self._komega * turn / robot.max_angular)


class BearingPolicy:
    """Steer to the bearing of the waypoint, forwards or backwards, whichever needs the smaller turn.

    A command acts one step late: until then the robot still moves and turns as it was told before. All is therefore decided
    on where the waypoint *will* lie in the body frame. Decided on the present bearing, the direction falls into a cycle of
    two steps where the bearing is near 90 degrees.

    The defaults are what `benchmarks/tune_bearing.py` finds.

    Args:
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot; one that must not reverse is driven forwards only.
        dt: Control interval, s.
        gain: Turning rate per angle to turn, 1/s.
        focus: How strictly to turn first and drive then: the speed goes with this power of the cosine of the angle to turn.
        tolerance: Bearings that pass the waypoint by less than this are left alone, m. Turning takes speed from a robot whose
            wheels are at their limit, and noise would have it turn all the time.
        slow: Distance below which the speed goes with the distance, m. Without it a robot that nobody stops would shuttle
            across its goal.
    """

    def __init__(
        self,
        robot: str | Robot = "burger",
        dt: float = REFERENCE_PERIOD,
        *,
        gain: float = 6.0,
        focus: float = 0.5,
        tolerance: float = 0.03,
        slow: float = 0.05,
    ) -> None:
        _require_positive(dt=dt, gain=gain, slow=slow)
        for name, number in (("focus", focus), ("tolerance", tolerance)):
            if not 0.0 <= number < math.inf:
                raise ValueError(f"{name} must be >= 0 and finite, got {number!r}.")
        self._robot, self._dt = make_robot(robot), dt
        self._gain, self._focus, self._tolerance, self._slow = gain, focus, tolerance, slow

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 13)."""
        robot, to = self._robot, _upcoming(observations, self._robot, self._dt)
        direction = np.where((to.ahead < 0.0) & robot.reverse, -1.0, 1.0)
        angle = np.arctan2(direction * to.left, direction * to.ahead)
        speed = np.maximum(np.cos(angle), 0.0) ** self._focus * np.minimum(to.distance / self._slow, 1.0)
        allowed = np.arcsin(self._tolerance / np.maximum(to.distance, self._tolerance)) if self._tolerance else 0.0
        turn = np.sign(angle) * np.maximum(np.abs(angle) - allowed, 0.0)
        return _action(direction * speed, self._gain * turn / robot.max_angular)


class PolarPolicy:
    """The polar-coordinate law: drive a smooth path that ends in the right heading, forwards or backwards.

    ``v = gamma rho cos(alpha)`` and ``omega = k alpha + gamma sinc(alpha) cos(alpha) (alpha + h phi)``, with rho the distance,
    alpha the bearing and phi the bearing minus the heading still to turn; slower, on the same path, where v is over the limit.

    Args:
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot.
        dt: Control interval, s.
        gamma: Gain on the distance, 1/s.
        k: Gain on the bearing, 1/s.
        h: Weight of the final heading.

    References:
        Aicardi, Casalino, Bicchi, Balestrino, "Closed loop steering of unicycle-like vehicles via Lyapunov techniques" (1995).
    """

    def __init__(
        self,
        robot: str | Robot = "burger",
        dt: float = REFERENCE_PERIOD,
        *,
        gamma: float = 1.0,
        k: float = 2.0,
        h: float = 2.0,
    ) -> None:
        _require_positive(dt=dt, gamma=gamma, k=k, h=h)
        self._robot, self._dt, self._gamma, self._k, self._h = make_robot(robot), dt, gamma, k, h

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 13)."""
        robot, to = self._robot, _upcoming(observations, self._robot, self._dt)
        direction = np.where((to.ahead < 0.0) & robot.reverse, -1.0, 1.0)
        alpha = np.arctan2(direction * to.left, direction * to.ahead)
        phi = _wrap(alpha - to.turn)
        v = self._gamma * to.distance * np.cos(alpha)
        omega = self._k * alpha + self._gamma * np.sinc(alpha / np.pi) * np.cos(alpha) * (alpha + self._h * phi)
        excess = np.maximum(np.abs(v) / robot.max_linear, 1.0)
        return _action(direction * v / excess / robot.max_linear, omega / excess / robot.max_angular)


class RotateDriveRotatePolicy:
    """Drive to the point as `BearingPolicy` does, then turn on the spot: near optimal where turning is fast.

    Args:
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot.
        dt: Control interval, s.
        stop: Distance within which it turns instead of driving, m.
    """

    def __init__(self, robot: str | Robot = "burger", dt: float = REFERENCE_PERIOD, *, stop: float = 0.1) -> None:
        _require_positive(dt=dt, stop=stop)
        self._drive, self._robot, self._dt, self._stop = BearingPolicy(robot, dt), make_robot(robot), dt, stop

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 13)."""
        to = _upcoming(observations, self._robot, self._dt)
        turning = _action(np.zeros_like(to.turn), to.turn / (self._dt * self._robot.max_angular))
        return np.where((to.distance < self._stop)[..., None], turning, self._drive(observations))


class _Upcoming(NamedTuple):
    """Where the waypoint will lie, in the body frame, when the next command acts."""

    ahead: NDArray[np.float64]
    left: NDArray[np.float64]
    distance: NDArray[np.float64]
    turn: NDArray[np.float64]
    """Heading still to turn, rad, in [-pi, pi)."""


def _upcoming(observations: ArrayLike, robot: Robot, dt: float) -> _Upcoming:
    o = _fields(observations)
    moved, turned = o.v * robot.max_linear * dt, o.omega * robot.max_angular * dt
    ahead_now, left_now = o.distance * o.cos_bearing - moved, o.distance * o.sin_bearing
    sine, cosine = np.sin(turned), np.cos(turned)
    ahead, left = cosine * ahead_now + sine * left_now, cosine * left_now - sine * ahead_now
    return _Upcoming(ahead, left, np.hypot(ahead, left), _wrap(np.arctan2(o.sin_turn, o.cos_turn) - turned))


def _wrap(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.mod(angles + np.pi, 2.0 * np.pi) - np.pi


def _fields(observations: ArrayLike) -> Observation:
    """Return the observations' components, each of shape (...), in double precision."""
    values = np.asarray(observations, np.float64)
    if values.ndim == 0 or values.shape[-1] != len(Observation._fields):
        raise ValueError(f"observations must have shape (..., {len(Observation._fields)}), got {values.shape}.")
    return Observation(*np.moveaxis(values, -1, 0))


def _action(forward: Any, turn: Any) -> NDArray[np.float32]:
    return np.clip(np.stack([forward, turn], axis=-1), -1.0, 1.0).astype(np.float32)


def _require_positive(**numbers: float) -> None:
    for name, number in numbers.items():
        if not 0.0 < number < math.inf:
            raise ValueError(f"{name} must be positive and finite, got {number!r}.")
