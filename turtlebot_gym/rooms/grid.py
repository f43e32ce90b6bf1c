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
from turtlebot_gym.models.angles import TWO_PI, sincos
from turtlebot_gym.models.random import uniforms
from turtlebot_gym.mounts import yaw_of_rotation
from turtlebot_gym.rooms.field import field_of_cells, field_of_hits
from turtlebot_gym.rooms.rays import LARGEST, distance_to_box
from turtlebot_gym.rooms.rules import OFFICE, RoomRules
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
_BOXES, _WALLS = 1 << 10, 1 << 11  # first draws for boxes and walls, beyond those for circles
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
def _place(walls: Any, rules: RoomRules, key: int, number: int, copy: int, x: float, y: float) -> tuple[bool, float, float]:
    """Return whether the map has an obstacle that is at (x, y), and where, m.

    ``number`` is its first draw; ``copy`` is 1 for a similar one that has vanished from the room, else 0.
    """
    share, direction = uniforms(key, number, copy)
    if copy == 1:
        along, up = uniforms(key, number, 2)
        return share < rules.vanished, walls[0] + (2.0 * along - 1.0) * walls[2], walls[1] + (2.0 * up - 1.0) * walls[3]
    sine, cosine = sincos(TWO_PI * direction)
    return share >= rules.unmapped, x + rules.map_error * cosine, y + rules.map_error * sine


@kernel
def _mark(occupied: Any, frame: Any, shape: Any, reach_x: float, reach_y: float) -> None:
    """Mark the cells whose centres are in a box, a row of `scene.RoomShape.boxes`, or in a circle, whose half width is 0.

    It reaches so far from its centre along x and y, m.
    """
    rows, columns = occupied.shape
    x, y = (shape[0] - frame[0]) / SIDE - 0.5, (shape[1] - frame[1]) / SIDE - 0.5
    across, up = reach_x / SIDE, reach_y / SIDE
    for row in range(max(int(y - up), 0), min(int(y + up) + 2, rows)):
        for column in range(max(int(x - across), 0), min(int(x + across) + 2, columns)):
            dx, dy = (x - column) * SIDE, (y - row) * SIDE
            round_one = shape[3] == 0.0
            inside = dx * dx + dy * dy <= shape[2] * shape[2] if round_one else distance_to_box(dx, dy, shape) <= 0.0
            occupied[row, column] = occupied[row, column] | inside


@kernel
def chart(scene: Scene, rules: RoomRules, key: int) -> None:
    """Draw a room's walls and static obstacles as cells, as wrong as its rules say, and write their distances into its field.

    The map has all walls of an office, and no others.
    """
    walls, frame, (rows, columns), error = scene.room.walls, scene.memory.field_frame, scene.memory.field.shape, rules.map_error
    frame[0], frame[1] = walls[0] - walls[2] - BORDER * SIDE, walls[1] - walls[3] - BORDER * SIDE
    frame[2], frame[3], frame[4] = 1.0, 0.0, SIDE
    (left, right), (bottom, top) = uniforms(key, _WALLS, 0), uniforms(key, _WALLS, 1)
    occupied = np.ones((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            x, y = (column + 0.5 - BORDER) * SIDE, (row + 0.5 - BORDER) * SIDE
            in_x = (2.0 * left - 1.0) * error < x < 2.0 * walls[2] + (2.0 * right - 1.0) * error
            in_y = (2.0 * bottom - 1.0) * error < y < 2.0 * walls[3] + (2.0 * top - 1.0) * error
            occupied[row, column] = not (in_x and in_y)
    shape = np.zeros(6)
    for k in range(scene.room.counts[0]):
        circle = scene.room.circles[k]
        for copy in range(2 if circle[3] == 0.0 and circle[4] == 0.0 else 0):
            mapped, x, y = _place(walls, rules, key, k, copy, circle[0], circle[1])
            if mapped:
                shape[0], shape[1], shape[2], shape[3] = x, y, circle[2], 0.0
                _mark(occupied, frame, shape, circle[2], circle[2])
    certain = rules.kind == OFFICE
    for k in range(scene.room.counts[1]):
        box = scene.room.boxes[k]
        for copy in range(1 if certain else 2):
            mapped, x, y = _place(walls, rules, key, _BOXES + k, copy, box[0], box[1])
            if mapped or certain:
                for at in range(2, 6):
                    shape[at] = box[at]
                shape[0], shape[1] = x, y
                a, b = abs(box[4]), abs(box[5])
                _mark(occupied, frame, shape, a * box[2] + b * box[3], b * box[2] + a * box[3])
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
    """Return the map of a ``nav_msgs/OccupancyGrid``; its resolution is the shortest decimal nearest to that of the message.

    Raises:
        ValueError: If the message does not hold a map.
    """
    info, origin, q = message.info, message.info.origin.position, message.info.origin.orientation
    if info.height * info.width > MAX_CELLS:
        number = f"{info.height * info.width:,} cells, more than {MAX_CELLS:,}"
        raise ValueError(f"the map has {number}: save it at a coarser resolution, or cut it")
    if len(message.data) != info.height * info.width:
        raise ValueError(f"the map has {len(message.data)} cells, but {info.height} rows of {info.width}")
    return GridMap(
        cells=np.array(message.data, np.int8).reshape(info.height, info.width),
        resolution=float(str(np.float32(info.resolution))),
        origin=Pose(origin.x, origin.y, yaw_of_rotation(q.w, q.x, q.y, q.z)),
    )
