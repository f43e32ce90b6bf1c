"""Analytic rays and distances in a room of circles, boxes and walls.

A ray has an origin and a unit direction; its length is the distance to the nearest surface ahead, `FAR` if there is none. A ray
from inside an obstacle has the length 0.
"""

from __future__ import annotations

from turtlebot_gym.kernel import kernel, sqrt

FAR = 1e9
"""Length of a ray that meets nothing, m."""
_TINY = 1e-30
"""Least magnitude of a divisor: a ray along an axis meets the planes parallel to it beyond `FAR`."""


@kernel
def ray_to_circle(x: float, y: float, dx: float, dy: float, squared_radius: float) -> float:
    """Return the length of a ray to a circle.

    Args:
        x: x of the circle's centre relative to the ray's origin, m.
        y: y of the circle's centre, likewise.
        dx: x component of the ray's direction, a unit vector.
        dy: y component of the direction.
        squared_radius: m^2.
    """
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
    """Return the length of a ray to a box, in the frame of the box.

    Args:
        x: x of the box's centre relative to the ray's origin, m.
        y: y of the box's centre, likewise.
        inverse_dx: Inverse of the direction's x component, see `inverse`.
        inverse_dy: Inverse of its y component.
        half_length: Half the box's extent along its x axis, m.
        half_width: Half its extent along its y axis, m.
    """
    middle_x, middle_y = x * inverse_dx, y * inverse_dy
    reach_x, reach_y = half_length * abs(inverse_dx), half_width * abs(inverse_dy)
    # Inside from the last entry on to the first exit.
    near = max(middle_x - reach_x, middle_y - reach_y)
    far = min(middle_x + reach_x, middle_y + reach_y)
    length = max(near, 0.0) if near <= far else FAR
    return length if far >= 0.0 else FAR


@kernel
def ray_to_walls(x: float, y: float, inverse_dx: float, inverse_dy: float, half_length: float, half_width: float) -> float:
    """Return the length of a ray to the walls around its origin; 0 outside of them.

    Args:
        x: x of the room's centre relative to the ray's origin, m.
        y: y of the room's centre, likewise.
        inverse_dx: Inverse of the direction's x component, see `inverse`.
        inverse_dy: Inverse of its y component.
        half_length: Half the room's extent along x, m.
        half_width: Half its extent along y, m.
    """
    across_x = x * inverse_dx + half_length * abs(inverse_dx)
    across_y = y * inverse_dy + half_width * abs(inverse_dy)
    length = max(min(across_x, across_y), 0.0)
    return min(length, FAR) if max(abs(x) - half_length, abs(y) - half_width) <= 0.0 else 0.0


@kernel
def distance_to_circle(x: float, y: float, radius: float) -> float:
    """Return the distance to a circle centred at (x, y); negative inside."""
    return sqrt(x * x + y * y) - radius


@kernel
def _distance_to_box(x: float, y: float, half_length: float, half_width: float) -> float:
    """Return the distance to a box centred at (x, y), in its frame; negative inside."""
    out_x, out_y = abs(x) - half_length, abs(y) - half_width
    beside_x, beside_y = max(out_x, 0.0), max(out_y, 0.0)
    return sqrt(beside_x * beside_x + beside_y * beside_y) + min(max(out_x, out_y), 0.0)


@kernel
def distance_to_turned_box(x: float, y: float, box) -> float:
    """Return the distance to a rotated box centred at (x, y); negative inside.

    Args:
        x: m.
        y: m.
        box: A row of `scene.RoomShape.boxes`.
    """
    cosine, sine = box[4], box[5]
    return _distance_to_box(x * cosine + y * sine, y * cosine - x * sine, box[2], box[3])


@kernel
def distance_to_walls(x: float, y: float, half_length: float, half_width: float) -> float:
    """Return the distance to the walls of a room centred at (x, y); negative outside."""
    return min(half_length - abs(x), half_width - abs(y))
