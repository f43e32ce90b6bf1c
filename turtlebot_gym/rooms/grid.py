"""A map of square cells: occupied, free or unknown."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import FINITE, POSITIVE, Numbers
from turtlebot_gym.mounts import yaw_of_rotation
from turtlebot_gym.rooms.cells import LARGEST
from turtlebot_gym.rooms.field import field_of_cells, field_of_hits
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
ROWS = 256
"""Rows whose squares are sought at once."""
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
    squares: NDArray[np.int8] = field(init=False, repr=False)
    """See `scene.RoomShape.squares`."""
    known: NDArray[np.uint8] = field(init=False, repr=False)
    """See `scene.RoomShape.known`."""
    frame: NDArray[np.float64] = field(init=False, repr=False)
    """See `scene.RoomShape.frame`."""

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
        open_cells = np.pad(cells != OCCUPIED, 1)
        squares = np.empty((4, *open_cells.shape), np.int8)
        for at, (up, right) in enumerate(product(_BOTH_WAYS, _BOTH_WAYS)):
            squares[at] = _squares(open_cells[up, right])[up, right]
        derived: dict[str, Any] = {
            "cells": cells.astype(np.int8),
            "origin": Pose(x, y, yaw),
            "squares": squares,
            "known": np.pad(cells == FREE, 1).astype(np.uint8),
            "frame": np.array([x, y, math.cos(yaw), math.sin(yaw), resolution]),
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

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
        return scenes._replace(room=scenes.room._replace(squares=self.squares, known=self.known, frame=self.frame))

    def field(self, *, hits: bool = False) -> NDArray[np.float32]:
        """Return the distances to the map's surfaces, shape (rows, columns), see `rooms.field`; their frame is the map's.

        Args:
            hits: Whether occupied cells say where a LiDAR's hits fell, as in maps by SLAM, and not what is solid.

        Returns:
            The distances, m; NaN in unknown cells that are farther than `BESIDE` from a surface.
        """
        field = np.empty(self.cells.shape, np.float32)
        (field_of_hits if hits else field_of_cells)(self.cells == OCCUPIED, self.resolution, field)
        field[(self.cells != FREE) & (self.cells != OCCUPIED) & (field > BESIDE)] = np.nan
        return field


def charted(scene: Scene, cut: int = 0) -> GridMap:
    """Return a localizer's map of a drawn room, whose occupied cells follow from its distance field.

    Args:
        scene: The room.
        cut: Width of the border that is left out, cells.
    """
    (rows, columns), (x, y, cosine, sine, side) = scene.memory.field.shape, scene.memory.field_frame.tolist()
    inside = scene.memory.field[cut : rows - cut, cut : columns - cut]
    corner = Pose(x + cut * side * (cosine - sine), y + cut * side * (sine + cosine), math.atan2(sine, cosine))
    return GridMap(cells=np.where(inside < 0.0, OCCUPIED, FREE).astype(np.int8), resolution=side, origin=corner)


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


_BOTH_WAYS = slice(None), slice(None, None, -1)


def _squares(is_open: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Return the side of the largest open square that begins at each cell."""
    sides = np.zeros(is_open.shape, np.int8)
    for first in range(0, len(sides), ROWS):  # in parts that stay in the cache
        fits, part = is_open[first : first + ROWS + LARGEST].copy(), sides[first : first + ROWS]
        for _ in range(LARGEST):
            part += fits[:ROWS]
            # A square fits if four squares that are one cell smaller fit, shifted by a row, a column or both.
            both = fits[:-1] & fits[1:]
            fits = fits[:-1]
            np.logical_and(both[:, :-1], both[:, 1:], out=fits[:, :-1])
            fits[:, -1] = False
            part = part[: len(fits)]
            if not fits.any():
                break
    return sides
