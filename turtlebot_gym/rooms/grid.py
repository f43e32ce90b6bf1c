"""Maps of square cells, occupied, free or unknown: given ones, and a localizer's map of a drawn room."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import FINITE, POSITIVE, Numbers
from turtlebot_gym.kernel import kernel
from turtlebot_gym.mounts import yaw_of_rotation
from turtlebot_gym.rooms.field import field_of_cells, field_of_hits
from turtlebot_gym.rooms.geodesic import Grid, mark_obstacles
from turtlebot_gym.rooms.rays import LARGEST, distance_to_walls
from turtlebot_gym.rooms.scene import Scene, Walls
from turtlebot_gym.values import Pose

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Values of a cell, as in ROS's ``nav_msgs/OccupancyGrid``; values between free and occupied count as unknown."""
BESIDE = 0.3
"""Distance from a surface, m, up to which a field counts unknown cells as free: a beam that is a little too long ends there."""
MAX_CELLS = 30_000_000
"""Most cells of a map: reading it takes 6 s and 400 MB, and looking for ways on it as much again."""
CUT = "cut it (by Pillow's Image.crop; its origin moves to the new lower left corner), or make it coarser"
"""Remedies for a map that is too large."""
SIDE = 0.05
"""Side of a cell, m: that of most maps made by robots."""
BORDER = 6
"""Cells around the room's walls: beams that are too long end there."""
_AT_ZERO = Pose(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridMap:
    """A map of square cells, compared by identity.

    Occupied cells stop rays and the robot. Unknown ones stop neither, but no path leads through them.
    """

    cells: NDArray[np.int8]
    """Shape (rows, columns): `FREE`, `OCCUPIED`, `UNKNOWN`, or a value between; the first row is the lowest."""
    resolution: float
    """Side of a cell, m."""
    origin: Pose = _AT_ZERO
    """The lower left corner of the map in the world, and the direction of its rows."""

    def __post_init__(self) -> None:
        cells = np.asarray(self.cells)
        if cells.ndim != 2 or cells.size == 0:
            raise ValueError(f"GridMap.cells must have rows and columns, got an array of shape {cells.shape}.")
        if cells.size > MAX_CELLS:
            raise ValueError(f"GridMap.cells must be at most {MAX_CELLS:,}, got {cells.size:,}: {CUT}.")
        resolution = POSITIVE.check("GridMap.resolution", self.resolution)
        x, y, yaw = Numbers(FINITE, 3).check("GridMap.origin", self.origin)
        if not (cells == FREE).any():
            raise ValueError(f"GridMap.cells must hold a free cell; of {cells.size} there is none.")
        object.__setattr__(self, "cells", cells.astype(np.int8))
        object.__setattr__(self, "resolution", resolution)
        object.__setattr__(self, "origin", Pose(x, y, yaw))

    @property
    def frame(self) -> NDArray[np.float64]:
        """See `scene.RoomShape.frame`."""
        x, y, yaw = self.origin
        return np.array([x, y, math.cos(yaw), math.sin(yaw), self.resolution])

    def walls(self) -> Walls:
        """Return the rectangle around the map, along the axes of the world."""
        rows, columns = self.cells.shape
        x, y, cosine, sine, resolution = self.frame.tolist()
        length, width = columns * resolution, rows * resolution
        half_length = 0.5 * (abs(cosine) * length + abs(sine) * width)
        half_width = 0.5 * (abs(sine) * length + abs(cosine) * width)
        middle_x, middle_y = 0.5 * (cosine * length - sine * width), 0.5 * (sine * length + cosine * width)
        return Walls(x + middle_x, y + middle_y, half_length, half_width)

    def share(self, scenes: Scene) -> Scene:
        """Return scenes that share the map's arrays."""
        squares, known = _room_arrays(self)
        return scenes._replace(room=scenes.room._replace(squares=squares, known=known, frame=self.frame))

    def field(self, *, hits: bool = False) -> NDArray[np.float32]:
        """Return the distances to the map's surfaces, shape (rows, columns), see `rooms.field`; their frame is the map's.

        With ``hits``, occupied cells say where a LiDAR's hits fell, as in maps by SLAM, and not what is solid. Unknown cells
        that are farther than `BESIDE` from a surface are NaN.
        """
        field = np.empty(self.cells.shape, np.float32)
        (field_of_hits if hits else field_of_cells)(self.cells == OCCUPIED, self.resolution, field)
        field[(self.cells != FREE) & (self.cells != OCCUPIED) & (field > BESIDE)] = np.nan
        return field


@lru_cache(4)
def _room_arrays(grid: GridMap) -> tuple[NDArray[np.int8], NDArray[np.uint8]]:
    """Return `scene.RoomShape.squares` and `scene.RoomShape.known` of a map, which all its scenes share."""
    is_open, both_ways = np.pad(grid.cells != OCCUPIED, 1), (slice(None), slice(None, None, -1))
    squares = [_squares(is_open[up, right])[up, right] for up in both_ways for right in both_ways]
    return np.stack(squares), np.pad(grid.cells == FREE, 1).astype(np.uint8)


def _squares(is_open: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Return the side of the largest open square that begins at each cell."""
    sides, fits = np.zeros(is_open.shape, np.int8), is_open
    for _ in range(LARGEST):
        rows, columns = fits.shape
        sides[:rows, :columns] += fits
        # A square fits if four squares that are one cell smaller fit, shifted by a row, a column or both.
        fits = fits[:-1, :-1] & fits[1:, :-1] & fits[:-1, 1:] & fits[1:, 1:]
        if not fits.any():
            break
    return sides


def extent(length: float, width: float) -> tuple[int, int]:
    """Return the rows and columns of the map of a room, m."""
    return math.ceil(width / SIDE - 1e-9) + 2 * BORDER, math.ceil(length / SIDE - 1e-9) + 2 * BORDER


@kernel
def chart(scene: Scene) -> None:
    """Draw a room's walls and static obstacles as cells, and write their distances into the localizer's field."""
    walls, frame, (rows, columns) = scene.room.walls, scene.memory.field_frame, scene.memory.field.shape
    left, bottom = walls[0] - walls[2] - BORDER * SIDE, walls[1] - walls[3] - BORDER * SIDE
    frame[0], frame[1], frame[2], frame[3], frame[4] = left, bottom, 1.0, 0.0, SIDE
    occupied = np.empty((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            x, y = left + (column + 0.5) * SIDE, bottom + (row + 0.5) * SIDE
            occupied[row, column] = distance_to_walls(walls[0] - x, walls[1] - y, walls[2], walls[3]) <= 0.0
    mark_obstacles(Grid(occupied, rows, columns, left, bottom, SIDE), True, scene, 0.0)
    field_of_cells(occupied, SIDE, scene.memory.field)


def charted(scene: Scene, cut: int = 0) -> GridMap:
    """Return a localizer's map of a drawn room, without a border of so many cells, as its distance field has it."""
    (rows, columns), (x, y, cosine, sine, side) = scene.memory.field.shape, scene.memory.field_frame.tolist()
    inside = scene.memory.field[cut : rows - cut, cut : columns - cut]
    corner = Pose(x + cut * side * (cosine - sine), y + cut * side * (sine + cosine), math.atan2(sine, cosine))
    return GridMap(cells=np.where(inside < 0.0, OCCUPIED, FREE).astype(np.int8), resolution=side, origin=corner)


def grid_in(scene: Scene) -> GridMap | None:
    """Return the map of a scene without its added border; None if there is none."""
    if scene.room.squares.shape[1] == 0:
        return None
    cells = np.where(scene.room.squares[0] == 0, OCCUPIED, np.where(scene.room.known > 0, FREE, UNKNOWN))[1:-1, 1:-1]
    x, y, cosine, sine, resolution = scene.room.frame.tolist()
    return GridMap(cells=cells.astype(np.int8), resolution=resolution, origin=Pose(x, y, math.atan2(sine, cosine)))


def grid_of(message: Any) -> GridMap:
    """Return the map of a ``nav_msgs/OccupancyGrid``; a ``ValueError`` refuses a message that holds none.

    Its resolution is the shortest decimal that is nearest to that of the message.
    """
    info, origin, q = message.info, message.info.origin.position, message.info.origin.orientation
    if len(message.data) != info.height * info.width:
        raise ValueError(f"the map has {len(message.data)} cells, but {info.height} rows of {info.width}")
    return GridMap(
        cells=np.array(message.data, np.int8).reshape(info.height, info.width),
        resolution=float(str(np.float32(info.resolution))),
        origin=Pose(origin.x, origin.y, yaw_of_rotation(q.w, q.x, q.y, q.z)),
    )
