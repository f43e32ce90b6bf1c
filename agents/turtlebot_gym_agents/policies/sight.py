"""What a policy sees in a room: where obstacles and goal will be when its command acts, and when an arc would meet them.

Points of the plane are complex numbers in the body frame: ahead + 1j left, m. Only numpy is needed here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym.systems import ROOM_LAYOUT, SIZES
from turtlebot_gym.tasks import Observation
from turtlebot_gym_agents.policies.geometric import upcoming

HALF_SECTOR = np.pi / SECTORS
"""Half the angle that a sector's range stands for, rad."""
DIRECTIONS = np.exp(2j * np.pi * np.arange(SECTORS) / SECTORS)
"""The middles of the sectors, as unit vectors; shape (`SECTORS`,)."""
EDGE = np.exp(1j * HALF_SECTOR)
"""From the middle of a sector to its edge."""
UNSEEN = 1e3
"""Distance at which a point lies that stands for a sector without an obstacle, m."""


class Sight(NamedTuple):
    """What will lie where when the next command acts."""

    goal: NDArray[np.complex128]
    """The goal, shape (...)."""
    points: NDArray[np.complex128]
    """The nearest point of each sector, shape (..., `SECTORS`), or three of each; `UNSEEN` away where there is none."""
    omega: NDArray[np.float64]
    """Turning rate until then, shape (...), rad/s."""


def look(observations: ArrayLike, robot: Robot, dt: float, lag: float, *, edges: bool = False) -> Sight:
    """Return what a policy sees.

    A scan is old: since it was measured the robot has driven and turned, by and large as it does now.

    Args:
        observations: Shape (..., 50), layout 2.
        robot: The robot.
        dt: Control interval, s; a command acts one interval late.
        lag: How much older the beams are, on average, than the scan says, s.
        edges: Whether an obstacle is at both edges of its sector as well, so that there are three points for each.

    Raises:
        ValueError: If the observations are of another layout.
    """
    rows = np.asarray(observations, np.float64)
    if rows.ndim == 0 or rows.shape[-1] != SIZES[ROOM_LAYOUT]:
        raise ValueError(f"observations must have shape (..., {SIZES[ROOM_LAYOUT]}), layout {ROOM_LAYOUT}, got {rows.shape}.")
    shares, age = rows[..., len(Observation._fields) : -1], rows[..., -1]
    v, omega = rows[..., 5] * robot.max_linear, rows[..., 6] * robot.max_angular
    moved, turned = arc(v, omega, age + lag + dt)
    points = np.where(shares < 1.0, shares * SIGHT, UNSEEN) * DIRECTIONS
    if edges:
        points = np.concatenate([points * EDGE, points, points * np.conj(EDGE)], axis=-1)
    return Sight(upcoming(rows, robot, dt).waypoint, (points - moved[..., None]) * np.conj(turned)[..., None], omega)


def arc(v: Any, omega: Any, time: Any) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return where a robot is after a time at constant speeds, and its heading as a unit vector."""
    half = 0.5 * omega * time
    return v * time * np.sinc(half / np.pi) * np.exp(1j * half), np.exp(2j * half)


def time_to_contact(points: NDArray[np.complex128], v: Any, omega: Any, radius: float) -> NDArray[np.float64]:
    """Return when a round robot that drives an arc meets points, s; infinite where it never does, 0 where it does already.

    Args:
        points: Shape (..., n).
        v: Speed, shape (..., 1) or such, m/s.
        omega: Turning rate, as ``v``, rad/s.
        radius: Of the robot, m.

    Returns:
        Shape (..., n).
    """
    v, omega = np.broadcast_arrays(np.asarray(v, np.float64), np.asarray(omega, np.float64))
    ahead, left = points.real * np.where(v < 0.0, -1.0, 1.0), points.imag  # backwards is forwards in a mirror
    speed, rate = np.abs(v), np.where(v < 0.0, -omega, omega)
    with np.errstate(divide="ignore", invalid="ignore"):
        straight = (ahead - np.sqrt(radius * radius - left * left)) / speed
        straight = np.where(straight >= 0.0, straight, np.inf)  # also where the root is of a negative number
        turn = speed / rate  # the centre of the arc lies so far to the left
        from_centre = ahead + 1j * (left - turn)
        away = np.abs(from_centre)
        # The robot's and the point's directions from the centre differ by this when the two are a radius apart.
        apart = np.arccos((turn * turn + away * away - radius * radius) / (2.0 * np.abs(turn) * away))
        to_point = np.mod(np.angle(from_centre * np.where(turn > 0.0, 1j, -1j)) * np.sign(turn), 2.0 * np.pi)
        curved = np.mod(to_point - apart, 2.0 * np.pi) / np.abs(rate)
        curved = np.where(np.isfinite(apart), curved, np.inf)
    time = np.where(np.abs(rate) > 1e-3, curved, straight)
    time = np.where(speed > 1e-6, time, np.inf)  # a round robot turns on the spot and meets nothing
    return np.where(np.abs(points) <= radius, np.where(is_towards(points, v), 0.0, np.inf), time)


def is_towards(points: NDArray[np.complex128], v: Any) -> NDArray[np.bool_]:
    """Return whether points lie on the side to which a robot drives."""
    return points.real * v > 0.0
