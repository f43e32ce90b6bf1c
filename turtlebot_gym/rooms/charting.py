"""A localizer's map of a drawn room: obstacles as cells, and their distance field."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import TWO_PI, sincos
from turtlebot_gym.models.random import uniforms
from turtlebot_gym.rooms.field import field_of_cells
from turtlebot_gym.rooms.rays import distance_to_turned_box
from turtlebot_gym.rooms.rules import OFFICE, RoomRules
from turtlebot_gym.rooms.scene import Scene

SIDE = 0.05
"""Side of a cell, m: that of most maps made by robots."""
BORDER = 6
"""Cells around the room's walls: beams that are too long end there."""
_BOXES, _WALLS = 1 << 10, 1 << 11  # first draws for boxes and walls, beyond those for circles


def extent(length: float, width: float) -> tuple[int, int]:
    """Return the rows and columns of the map of a room, m."""
    return math.ceil(width / SIDE - 1e-9) + 2 * BORDER, math.ceil(length / SIDE - 1e-9) + 2 * BORDER


@kernel
def _place(walls: Any, rules: RoomRules, key: int, number: int, copy: int, x: float, y: float) -> tuple[bool, float, float]:
    """Return whether the map has an obstacle, and where, m.

    Args:
        walls: The room's walls.
        rules: How wrong the map is.
        key: Key of the draws.
        number: First draw of the obstacle.
        copy: 0 for the obstacle itself, 1 for a similar one that has vanished from the room.
        x: Its position, m.
        y: The same.
    """
    share, direction = uniforms(key, number, copy)
    if copy == 1:
        along, up = uniforms(key, number, 2)
        return share < rules.vanished, walls[0] + (2.0 * along - 1.0) * walls[2], walls[1] + (2.0 * up - 1.0) * walls[3]
    sine, cosine = sincos(TWO_PI * direction)
    return share >= rules.unmapped, x + rules.map_error * cosine, y + rules.map_error * sine


@kernel
def _mark(occupied: Any, frame: Any, shape: Any, reach_x: float, reach_y: float) -> None:
    """Mark the cells whose centres are in a turned box, or in a circle, whose half width is 0.

    Args:
        occupied: The cells, shape (rows, columns).
        frame: Their frame.
        shape: x, y, half length (the radius of a circle), half width, cosine and sine.
        reach_x: Half its extent along x, m.
        reach_y: Half its extent along y, m.
    """
    rows, columns = occupied.shape
    x, y = (shape[0] - frame[0]) / SIDE - 0.5, (shape[1] - frame[1]) / SIDE - 0.5
    across, up = reach_x / SIDE, reach_y / SIDE
    for row in range(max(int(y - up), 0), min(int(y + up) + 2, rows)):
        for column in range(max(int(x - across), 0), min(int(x + across) + 2, columns)):
            dx, dy = (x - column) * SIDE, (y - row) * SIDE
            round_one = shape[3] == 0.0
            inside = dx * dx + dy * dy <= shape[2] * shape[2] if round_one else distance_to_turned_box(dx, dy, shape) <= 0.0
            occupied[row, column] = occupied[row, column] | inside


@kernel
def chart(scene: Scene, rules: RoomRules, key: int) -> None:
    """Draw a room's walls and static obstacles as cells, and write their distances into ``scene.field``.

    Args:
        scene: The room.
        rules: How wrong the map is; it has all walls of an office, and no others.
        key: Key of the draws.
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
