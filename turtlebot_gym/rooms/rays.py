"""Rays and distances in a room of circles, boxes and walls, and in a map of square cells, which are occupied or free.

A ray has an origin and a unit direction; its length is the distance to the nearest surface ahead, `FAR` if there is none. A ray
from inside an obstacle has the length 0. Everywhere (x, y) is the centre of a shape seen from the ray's origin or from the
point, m; distances are negative inside.

In a map all lengths are in cells, and everything outside of it is occupied. There a ray walks from cell to cell by the method
of Amanatides and Woo, but in strides: for each cell and each quadrant of directions the map stores the largest square without
an occupied cell that begins there, and a ray jumps to the border of that square.

References:
    Amanatides, Woo, "A fast voxel traversal algorithm for ray tracing", *Eurographics* (1987).
"""

from __future__ import annotations

from typing import Any

from turtlebot_gym.kernel import kernel, sqrt

LARGEST = 127
"""Side of the largest square that a map stores."""
FAR = 1e9
"""Length of a ray that meets nothing, m."""
_TINY = 1e-30
"""Least magnitude of a divisor: a ray along an axis meets the planes parallel to it beyond `FAR`."""


@kernel
def ray_to_circle(x: float, y: float, dx: float, dy: float, squared_radius: float) -> float:
    """Return the length of a ray along the unit vector (dx, dy) to a circle; its squared radius in m^2."""
    # Where the line comes closest, and how close.
    along = x * dx + y * dy
    across = x * dy - y * dx
    half_chord = squared_radius - across * across
    half = sqrt(max(half_chord, 0.0))
    near, far = along - half, along + half
    length = max(near, 0.0) if half_chord >= 0.0 else FAR
    return length if far >= 0.0 else FAR


@kernel
def inverse(component: float) -> float:
    """Return the inverse of a direction's component, finite even if that is 0."""
    return 1.0 / (component if abs(component) > _TINY else _TINY)


@kernel
def ray_to_box(x: float, y: float, inverse_dx: float, inverse_dy: float, half_length: float, half_width: float) -> float:
    """Return the length of a ray to a box, in the frame of the box; `inverse` gives the inverse of the ray's direction."""
    middle_x, middle_y = x * inverse_dx, y * inverse_dy
    reach_x, reach_y = half_length * abs(inverse_dx), half_width * abs(inverse_dy)
    # Inside from the last entry on to the first exit.
    near = max(middle_x - reach_x, middle_y - reach_y)
    far = min(middle_x + reach_x, middle_y + reach_y)
    length = max(near, 0.0) if near <= far else FAR
    return length if far >= 0.0 else FAR


@kernel
def ray_to_walls(x: float, y: float, inverse_dx: float, inverse_dy: float, half_length: float, half_width: float) -> float:
    """Return the length of a ray to the walls of a room around its origin; 0 outside of them. Arguments as in `ray_to_box`."""
    across_x = x * inverse_dx + half_length * abs(inverse_dx)
    across_y = y * inverse_dy + half_width * abs(inverse_dy)
    length = max(min(across_x, across_y), 0.0)
    return min(length, FAR) if max(abs(x) - half_length, abs(y) - half_width) <= 0.0 else 0.0


@kernel
def distance_to_circle(x: float, y: float, radius: float) -> float:
    """Return the distance to a circle."""
    return sqrt(x * x + y * y) - radius


@kernel
def distance_to_box(x: float, y: float, box) -> float:
    """Return the distance to a box, a row of `scene.RoomShape.boxes`."""
    cosine, sine = box[4], box[5]
    out_x, out_y = abs(x * cosine + y * sine) - box[2], abs(y * cosine - x * sine) - box[3]
    beside_x, beside_y = max(out_x, 0.0), max(out_y, 0.0)
    return sqrt(beside_x * beside_x + beside_y * beside_y) + min(max(out_x, out_y), 0.0)


@kernel
def distance_to_walls(x: float, y: float, half_length: float, half_width: float) -> float:
    """Return the distance to the walls of a room; negative outside."""
    return min(half_length - abs(x), half_width - abs(y))


@kernel
def to_cells(frame: Any, x: float, y: float) -> tuple[float, float]:
    """Return the column and the row of a point, m, as fractional numbers; ``frame`` is `scene.RoomShape.frame`."""
    dx, dy = x - frame[0], y - frame[1]
    return (dx * frame[2] + dy * frame[3]) / frame[4] + 1.0, (dy * frame[2] - dx * frame[3]) / frame[4] + 1.0


@kernel
def is_on_map(squares: Any, column: float, row: float) -> bool:
    """Return whether a point is on the map rather than on the border of cells around it."""
    return 1.0 <= column < squares.shape[2] - 1.0 and 1.0 <= row < squares.shape[1] - 1.0


@kernel
def ray_to_cells(squares: Any, column: float, row: float, dx: float, dy: float, reach: float) -> float:
    """Return the length of a ray to the first occupied cell; `FAR` beyond ``reach``; 0 inside an occupied cell.

    The direction (dx, dy) is a unit vector in the map's frame; ``squares`` are `scene.RoomShape.squares`.
    """
    if not is_on_map(squares, column, row):
        return 0.0
    inverse_dx, inverse_dy = inverse(dx), inverse(dy)
    right, up = inverse_dx > 0.0, inverse_dy > 0.0
    ahead = squares[(0 if right else 1) + (0 if up else 2)]
    i, j = int(row), int(column)
    length, side = 0.0, int(ahead[i, j])
    while side > 0 and length < reach:
        border_x, border_y = j + side if right else j - side + 1, i + side if up else i - side + 1
        length_x, length_y = (border_x - column) * inverse_dx, (border_y - row) * inverse_dy
        if length_x < length_y:
            length, at = length_x, int(row + length_x * dy)
            # Rounding must lead neither out of the square nor back, or the ray could circle around a corner forever.
            i = min(max(at, i), i + side - 1) if up else min(max(at, i - side + 1), i)
            j = border_x if right else border_x - 1
        else:
            length, at = length_y, int(column + length_y * dx)
            j = min(max(at, j), j + side - 1) if right else min(max(at, j - side + 1), j)
            i = border_y if up else border_y - 1
        side = int(ahead[i, j])
    return length if side == 0 else FAR


@kernel
def distance_to_cells(squares: Any, column: float, row: float, reach: float) -> float:
    """Return the distance from a point to the nearest occupied cell, at most ``reach``.

    Inside an occupied cell it is minus the distance to its border; outside of the map, minus the distance to the map.
    """
    rows, columns = squares.shape[1], squares.shape[2]
    border = min(min(column, columns - column), min(row, rows - row)) - 1.0
    if not is_on_map(squares, column, row):
        return min(border, 0.0)
    i, j = int(row), int(column)
    ring = min(min(int(squares[0, i, j]), int(squares[1, i, j])), min(int(squares[2, i, j]), int(squares[3, i, j])))
    nearest = min(border, reach)
    if ring == 0:
        return -min(min(column - j, j + 1 - column), min(row - i, i + 1 - row))
    while ring - 1.0 < nearest:  # cells of a ring are at least so far away
        for at in range(max(i - ring, 0), min(i + ring + 1, rows)):
            for to in range(j - ring, j + ring + 1, 1 if abs(at - i) == ring else 2 * ring):
                if 0 <= to < columns and squares[0, at, to] == 0:
                    across, along = max(max(at - row, row - at - 1.0), 0.0), max(max(to - column, column - to - 1.0), 0.0)
                    nearest = min(nearest, sqrt(across * across + along * along))
        ring += 1
    return nearest
