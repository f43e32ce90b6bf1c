"""A policy's view of a room: obstacles and goal at the time its command acts, and the time at which an arc meets them.

Points of the plane are complex numbers in the body frame: ahead + 1j left, m. This module needs only numpy.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.observations import ROOM
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym_agents.policies.geometric import Upcoming
from turtlebot_gym_agents.policies.policy import numbers_of

HALF_SECTOR = np.pi / SECTORS
"""Half the angle of a sector, rad."""
DIRECTIONS = np.exp(2j * np.pi * np.arange(SECTORS) / SECTORS)
"""The middles of the sectors, as unit vectors; shape (`SECTORS`,)."""
EDGE = np.exp(1j * HALF_SECTOR)
"""From the middle of a sector to its edge."""
_TRAIL = 0.5
"""Time over which a robot's speeds are remembered, s: the age of its oldest scans."""
_REVOLUTION = 0.1
"""Least time that a LiDAR for robots of this size takes for a revolution, s."""
UNSEEN = 1e3
"""Distance of the point that represents a sector without an obstacle, m."""


class Sight(NamedTuple):
    """Goal and obstacles at the time the next command acts."""

    goal: NDArray[np.complex128]
    """The goal, shape (...)."""
    points: NDArray[np.complex128]
    """The nearest point of each sector, shape (..., `SECTORS`), or three per sector; `UNSEEN` away if there is none."""
    omega: NDArray[np.float64]
    """Turning rate until then, shape (...), rad/s."""


class SightMotion:
    """Recent speeds of each robot, for its motion since a scan: in bends they differ from the current ones.

    Observed speeds hold for a control interval, ``dt``; before the first one, the same speeds are assumed. A scan is stamped
    with the time of its first or of its last beam: the last, if a scan was ever younger than a revolution takes, of which
    ``lag`` is half; s.
    """

    def __init__(self, dt: float, lag: float) -> None:
        self._dt, self._lag = dt, lag
        self._times = dt * np.arange(max(round(_TRAIL / dt), 1))
        self._speeds, self._youngest = np.full((len(self._times) + 1, 2), np.nan), np.full((), np.inf)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget everything where an episode begins."""
        self._youngest = np.where(mask, np.inf, self._youngest)
        self._speeds = np.where(np.asarray(mask)[..., None, None], np.nan, self._speeds)

    def since(self, age: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return place and heading in the frame of the pose when the beams of a scan of this age were measured, on average."""
        self._youngest = np.minimum(self._youngest, age)
        return self.over(np.maximum(age + np.where(self._youngest < _REVOLUTION, self._lag, -self._lag), 0.0))

    def over(self, time: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return place and heading in the frame of the pose some time ago, s; before, the oldest speeds are assumed."""
        parts = np.maximum(time[..., None] - self._times, 0.0)
        parts[..., :-1] = np.minimum(parts[..., :-1], self._dt)
        steps, turns = arc(self._speeds[..., 1:, 0], self._speeds[..., 1:, 1], parts)
        moved, turned = np.zeros(time.shape, np.complex128), np.ones(time.shape, np.complex128)
        for k in range(len(self._times)):  # from the last step back: an earlier one comes before the way so far
            moved, turned = steps[..., k] + turns[..., k] * moved, turns[..., k] * turned
        return moved, turned

    def note(self, v: NDArray[np.float64], omega: NDArray[np.float64]) -> None:
        """Remember the speeds until the next observation, m/s and rad/s."""
        now = np.stack([v, omega], axis=-1)[..., None, :]
        before = np.where(np.isnan(self._speeds[..., :-1, :]), now, self._speeds[..., :-1, :])
        self._speeds = np.concatenate([now, before], axis=-2)


def look(
    observations: ArrayLike,
    robot: Robot,
    dt: float,
    lag: float,
    *,
    edges: bool = False,
    lidar_x: float = 0.0,
    since: tuple[NDArray[np.complex128], NDArray[np.complex128]] | None = None,
) -> Sight:
    """Return a policy's view in observations (..., n) that have the terms of a room.

    The robot has moved since the scan was measured, by ``since`` as `SightMotion.since` returns it, otherwise with its current
    speeds over the scan's age and ``lag``, s. A command acts one control interval ``dt``, s, late. With ``edges`` an obstacle
    is also at both edges of its sector, which makes three points per sector. The LiDAR is ``lidar_x``, m, ahead of the axle.
    """
    rows = numbers_of(observations, ROOM).astype(np.float64)
    shares, age = rows[..., -1 - SECTORS : -1], rows[..., -1]
    v, omega = rows[..., 5] * robot.max_linear, rows[..., 6] * robot.max_angular
    if since is None:
        moved, turned = arc(v, omega, age + lag + dt)
    else:
        (before, bent), (step, turn) = since, arc(v, omega, dt)
        moved, turned = before + bent * step, bent * turn
    points = np.where(shares < 1.0, shares * SIGHT, UNSEEN) * DIRECTIONS
    if edges:
        points = np.concatenate([points * EDGE, points, points * np.conj(EDGE)], axis=-1)
    return Sight(Upcoming(rows, robot, dt).waypoint, (points + lidar_x - moved[..., None]) * np.conj(turned)[..., None], omega)


def arc(v: Any, omega: Any, time: Any) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return a robot's place after a time at constant speeds, and its heading."""
    half = 0.5 * omega * time
    return v * time * np.sinc(half / np.pi) * np.exp(1j * half), np.exp(2j * half)


def time_to_contact(points: NDArray[np.complex128], v: Any, omega: Any, radius: Any) -> NDArray[np.float64]:
    """Return the time at which a round robot on an arc meets points (..., n), s; infinite if never, 0 if it already does.

    Speed ``v``, m/s, turning rate ``omega``, rad/s, and ``radius``, m, have the shape (..., 1), or are numbers.
    """
    v, omega = np.broadcast_arrays(np.asarray(v, np.float64), np.asarray(omega, np.float64))
    ahead, left = points.real * np.where(v < 0.0, -1.0, 1.0), points.imag  # driving backwards mirrors driving forwards
    speed, rate = np.abs(v), np.where(v < 0.0, -omega, omega)
    with np.errstate(divide="ignore", invalid="ignore"):
        straight = (ahead - np.sqrt(radius * radius - left * left)) / speed
        straight = np.where(straight >= 0.0, straight, np.inf)  # also for the root of a negative number
        turn = speed / rate  # distance of the arc's centre to the left
        from_centre = ahead + 1j * (left - turn)
        away = np.abs(from_centre)
        # The robot's and the point's directions from the centre differ by this when the two are a radius apart.
        apart = np.arccos((turn * turn + away * away - radius * radius) / (2.0 * np.abs(turn) * away))
        to_point = _positive(np.angle(from_centre * np.where(turn > 0.0, 1j, -1j)) * np.sign(turn))
        curved = _positive(to_point - apart) / np.abs(rate)
        curved = np.where(np.isfinite(apart), curved, np.inf)
    time = np.where(np.abs(rate) > 1e-3, curved, straight)
    time = np.where(speed > 1e-6, time, np.inf)  # a round robot that turns on the spot meets nothing
    in_contact = np.where(points.real * v > 0.0, 0.0, np.inf)  # a robot may leave a point to which it does not drive
    return np.where(np.abs(points) <= radius, in_contact, time)


def _positive(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles between -2 pi and 2 pi as positive ones, rad; `numpy.mod` takes ten times as long."""
    return angle + 2.0 * np.pi * (angle < 0.0)
