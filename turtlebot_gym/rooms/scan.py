"""A room's data outside of the step: LiDAR scans and their pooling for a policy, clearance and obstacles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.rooms.lidar import SECTORS, Lidar, divide, pool
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.values import Pose, State


class Scan(NamedTuple):
    """The ranges of a full revolution, counter-clockwise."""

    ranges: NDArray[np.float32]
    """Ranges, shape (B,), m; infinite where nothing was returned."""
    first: float
    """Direction of the first beam in the LiDAR's frame, rad."""
    increment: float
    """Angle between two beams, rad."""
    range_min: float
    """Shorter ranges are not returned, m."""
    range_max: float
    """Longer ranges are not returned, m."""
    beam_period: float = 0.0
    """Time between two beams, s; 0 if unknown."""
    period: float = 0.0
    """Time between two scans, s; 0 if unknown."""


class Clearance(NamedTuple):
    """Clearance of a robot in a room."""

    distance: float
    """Distance from the footprint to the nearest surface, m; negative on contact."""


class Obstacles(NamedTuple):
    """Walls and obstacles, seen from above."""

    walls: tuple[float, float, float, float]
    """x, y, half length and half width of the room, m."""
    circles: tuple[tuple[float, float, float], ...]
    """x, y and radius of each, m."""
    boxes: tuple[tuple[float, float, float, float, float], ...]
    """x, y, length, width and heading of each; m, rad."""


def mounted(state: State, lidar: Lidar) -> Pose:
    """Return the pose of a LiDAR's frame on a robot."""
    sine, cosine = sincos(state.theta)
    x, y = state.x + lidar.x * cosine - lidar.y * sine, state.y + lidar.x * sine + lidar.y * cosine
    return Pose(x, y, wrap(state.theta + lidar.yaw))


def obstacles_of(scene: Scene) -> Obstacles:
    """Return the walls and obstacles of a scene, with walkers at their current positions."""
    circles, boxes = scene.circles[: scene.counts[0], :3].tolist(), scene.boxes[: scene.counts[1]].tolist()
    return Obstacles(
        tuple(scene.walls.tolist()),
        tuple((x, y, radius) for x, y, radius in circles),
        tuple((x, y, 2.0 * a, 2.0 * b, math.atan2(sine, cosine)) for x, y, a, b, cosine, sine in boxes),
    )


class Pooling:
    """Pools scans into the sectors of a policy, as the environment does.

    Args:
        yaw: Direction of the LiDAR's frame in the robot's frame, rad.
        beams: Number of beams that a scan must have; 0 for any.
    """

    def __init__(self, *, yaw: float = 0.0, beams: int = 0) -> None:
        self._yaw, self._beams = yaw, beams
        self._divided: tuple[float, int] | None = None
        self._spans = np.zeros((SECTORS, 2), np.int64)

    def __call__(self, scan: Scan) -> list[float]:
        """Return the shortest range in each sector, as shares of `lidar.SIGHT`.

        Raises:
            ValueError: If the scan has another number of beams than ``beams``.
        """
        beams = len(scan.ranges)
        if self._beams not in (0, beams):
            raise ValueError(f"the scan has {beams} beams, but lidar_beams says {self._beams}")
        first = self._yaw + scan.first
        if self._divided != (first, beams):
            divide(self._spans, first, beams)
            self._divided = first, beams
        sectors = np.zeros(SECTORS, np.float32)
        pool(scan.ranges, self._spans, beams, sectors)
        return sectors.tolist()
