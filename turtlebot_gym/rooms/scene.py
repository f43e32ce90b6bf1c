"""The surroundings of a robot as arrays: a room, its shortest paths, and the LiDAR's measurements."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rooms.lidar import SECTORS

RESOLUTION = 0.1
"""Side of a cell of the path grid, m."""
GROUP = 8
"""Neighbouring rays that are cast together, as many as the widest vectors hold; loops over whole groups leave no rest, which
would take as long as the whole."""
UNREACHED = 0xFFFF
"""Path length from a cell without a path to the goal."""


class Walls(NamedTuple):
    """The rectangle of walls around a room."""

    x: float
    """Centre, m."""
    y: float
    half_length: float
    """Half the extent along x, m."""
    half_width: float
    """Half the extent along y, m."""


class RoomShape(NamedTuple):
    """What stands and walks around a robot, and the way to its goal; of many robots, with a leading axis."""

    walls: Any
    """Shape (4,): the numbers of `Walls`."""
    counts: Any
    """Shape (2,), int64: numbers of circles and boxes."""
    circles: Any
    """Shape (C, 5): x, y, radius and velocity (0 unless it walks); m, m/s."""
    boxes: Any
    """Shape (B, 6): x, y, half length, half width, and cosine and sine of the heading."""
    people: Any
    """Shape (P, 6): where each person walks to and comes from, x and y, m; pace, m/s; and 1 if the person sees the
    robot, else 0. P is 0 unless circles are people. A person with a pace of 0 feels no forces and walks straight on at the
    velocity in ``circles``: set both in the arrays of `NavigationVectorEnv.truth` to let people walk by another model."""
    ways: Any
    """Shape (rows, columns), uint16: length of the shortest path to the goal from each cell, in `geodesic.UNIT`."""
    squares: Any
    """Shape (4, rows, columns), int8, shared: a map with a border of one cell around it; rows and columns are 0 without a map.
    Each value is the side of the largest square without an occupied cell that begins at a cell and extends to the upper right,
    upper left, lower right and lower left; at most `rays.LARGEST`."""
    known: Any
    """Shape (rows, columns), uint8, shared: whether a cell of the map is known to be free."""
    frame: Any
    """Shape (5,), shared: the map's lower left corner, cosine and sine of its rows' direction, side of a cell; m."""


class LidarBuffers(NamedTuple):
    """What a LiDAR looks at, and what it has measured; of many robots, with a leading axis."""

    beams: Any
    """Shape (3, beams + `GROUP`): cosine and sine of each beam's direction in the robot's frame, and the least range it
    returns, m; zeros at the end, so that whole groups can be read. Of robots with the same LiDAR, with a leading axis of 1: so
    they stay in the processor's cache."""
    spans: Any
    """Shape (`SECTORS`, 2), int64: the beams of each sector, see `sectors.divide`."""
    ranges: Any
    """Shape (2, beams), float32: the revolution in progress, and the newest complete one, m."""
    sectors: Any
    """Shape (`SECTORS`,), float32: the newest scan, pooled, as shares of `lidar.SIGHT`."""


class LocalizerMemory(NamedTuple):
    """The map that a localizer knows, and what it remembers; of many robots, with a leading axis. Empty without a localizer."""

    field: Any
    """Shape (rows, columns), float32: a localizer's map, distances to its surfaces, see `rooms.field`; m. A given map's is
    shared, with a leading axis of 1; rows and columns are 0 without a localizer."""
    field_frame: Any
    """Shape (5,): its frame, like `RoomShape.frame`."""
    trail: Any
    """Shape (K, 4): the odometry of the last steps, see `localization.points.remember`; K is 0 without a localizer."""
    bank: Any
    """Shape (H, 4): where a robot may be that is lost, see `localization.hypotheses`; H is 0 without a localizer."""


class Scene(NamedTuple):
    """The surroundings of one robot, or of many, in arrays that a step updates in place."""

    room: RoomShape
    lidar: LidarBuffers
    memory: LocalizerMemory
    tracker: Any = ()
    """A `tracking.tracker.TrackerMemory`; an empty tuple without a tracker."""


def arrays_of(scene: Any) -> list[NDArray[Any]]:
    """Return all arrays of a scene, which may be a tuple of arrays or of such tuples."""
    return [array for part in scene for array in arrays_of(part)] if isinstance(scene, tuple) else [scene]


@kernel
def whole_groups(n: int) -> int:
    """Return the least multiple of `GROUP` that is not below n."""
    return (n + GROUP - 1) // GROUP * GROUP


@kernel
def scene_at(scenes: Scene, index: int) -> Scene:
    """Return the surroundings of one robot of many, as views; the arrays of a map and of one LiDAR for all are shared."""
    room, lidar, memory = scenes.room, scenes.lidar, scenes.memory
    return Scene(
        RoomShape(*[array[index] for array in room[:6]], *room[6:]),  # pyright: ignore[reportCallIssue]
        LidarBuffers(lidar.beams[min(index, len(lidar.beams) - 1)], *[array[index] for array in lidar[1:]]),
        LocalizerMemory(*[array[min(index, len(array) - 1)] for array in memory]),
    )


@kernel
def cells_along(extent: float) -> int:
    """Return the number of cells of the path grid along an extent in metres."""
    return max(math.ceil(extent / RESOLUTION - 1e-9), 1)


def make_scenes(
    number: int,
    *,
    circles: int,
    boxes: int,
    length: float,
    width: float,
    beams: int,
    people: int = 0,
    same_lidar: bool = False,
) -> Scene:
    """Return empty arrays for a number of rooms with at most so many obstacles, people (circles, too) and beams of a LiDAR.

    Length and width are their largest extents along x and y, m; ``same_lidar`` says whether all robots have the same LiDAR.
    """

    def zeros(*shape: int, dtype: Any = np.float64) -> NDArray[Any]:
        return np.zeros((number, *shape), dtype)

    walls, counts, frame = zeros(4), zeros(2, dtype=np.int64), np.zeros(5)
    shapes = zeros(max(circles, 1), 5), zeros(max(boxes, 1), 6), zeros(people, 6)
    ways = zeros(cells_along(width), cells_along(length), dtype=np.uint16)
    directions = np.zeros((1 if same_lidar else number, 3, beams + GROUP))
    spans, ranges = zeros(SECTORS, 2, dtype=np.int64), zeros(2, beams, dtype=np.float32)
    return Scene(
        RoomShape(walls, counts, *shapes, ways, np.zeros((4, 0, 0), np.int8), np.zeros((0, 0), np.uint8), frame),
        LidarBuffers(directions, spans, ranges, zeros(SECTORS, dtype=np.float32)),
        LocalizerMemory(zeros(0, 0, dtype=np.float32), zeros(5), zeros(0, 4), zeros(0, 7)),
    )
