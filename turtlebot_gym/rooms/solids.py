"""Solid shapes of SDF, cut at the height of a LiDAR: circles, boxes, and outlines.

The robot stands on the ground: z = 0, or a box below everything else. What it drives over (up to `STEP`) and what it passes
below (from `HEADROOM` on) is left out. Everything else is an obstacle with its outline at `SCAN_HEIGHT`; what does not reach
that height has the outline in the middle of its part between the two, and the LiDAR of a plane sees it, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.meshes import Body
from turtlebot_gym.transforms import MalformedError, numbers_of

SCAN_HEIGHT = 0.18
"""Height of a LiDAR's plane, m: TurtleBot3 Burger 0.182, by its URDF."""
STEP = 0.02
"""Height that a TurtleBot's wheels climb, m."""
HEADROOM = 0.35
"""Height of the highest TurtleBot, m: TurtleBot 4 Standard 0.341."""
_SIDES = 48
"""Corners that stand for a circle where a round shape is tilted."""
_LEVEL = 1e-4
"""Tilt up to which a shape counts as upright, rad: poses state a right angle with a few digits."""

FLOOR = (2.0, 0.3)
"""Least extents of a box that may be the floor, and greatest height of its top, m."""

LoadMesh = Callable[[Element], "list[Body]"]
"""Returns the bodies of a ``<mesh>``, in its own frame."""


class Outline(NamedTuple):
    """The cut through a body."""

    segments: NDArray[np.float64]
    """Shape (n, 2, 2): both ends' x and y, m."""
    is_solid: bool
    """Whether points with an odd number of segments on each side are solid."""


class Cut(NamedTuple):
    """Shapes in the plane."""

    circles: list[tuple[float, ...]]
    """x, y, radius; m."""
    boxes: list[tuple[float, ...]]
    """x, y, length, width, heading; m, rad."""
    outlines: list[Outline]

    def __add__(self, other: object) -> Cut:
        assert isinstance(other, Cut)
        return Cut(self.circles + other.circles, self.boxes + other.boxes, self.outlines + other.outlines)


def height_of_cut(low: float, high: float) -> float | None:
    """Return the height at which a shape between two heights is cut, m; None if it is no obstacle."""
    if high <= STEP or low >= HEADROOM:
        return None
    return SCAN_HEIGHT if low < SCAN_HEIGHT < high else 0.5 * (max(low, STEP) + min(high, HEADROOM))


def top_of_floor(geometry: Element, pose: NDArray[np.float64], others: NDArray[np.float64]) -> float | None:
    """Return the height of a level box on which everything else stands, m; None for anything else.

    Args:
        geometry: The element ``<geometry>``.
        pose: Its pose in the world, shape (4, 4).
        others: Places of all other shapes, shape (n, 3), m.
    """
    box = geometry.find("box")
    if box is None or abs(pose[2, 2]) <= math.cos(_LEVEL) or not len(others):
        return None
    size = np.array(_sizes(box, "size", 3))
    top = float(pose[2, 3] + 0.5 * size[2])
    apart = np.abs((others - pose[:3, 3]) @ pose[:3, :2])
    carries = bool((apart <= 0.5 * size[:2]).all()) and bool((others[:, 2] >= top - 1e-6).all())
    return top if carries and size[:2].min() >= FLOOR[0] and STEP < top <= FLOOR[1] else None


def cut(geometry: Element, pose: NDArray[np.float64], load_mesh: LoadMesh) -> Cut:
    """Cut a geometry.

    Args:
        geometry: The element ``<geometry>``.
        pose: Its pose in the world, shape (4, 4).
        load_mesh: Loads what a ``<mesh>`` names.

    Raises:
        MalformedError: If a number is missing or malformed.
    """
    result = Cut([], [], [])
    for shape in geometry:
        if shape.tag == "box":
            _cut_box(_sizes(shape, "size", 3), pose, result)
        elif shape.tag == "cylinder":
            _cut_cylinder(_size(shape, "radius"), _size(shape, "length", 1.0), pose, result)
        elif shape.tag == "sphere":
            _cut_sphere(_size(shape, "radius"), pose, result)
        elif shape.tag == "polyline":
            result.outlines.extend(_cut_bodies([_prism(shape)], pose))
        elif shape.tag == "mesh":
            result.outlines.extend(_cut_bodies(load_mesh(shape), pose))
        elif shape.tag in ("capsule", "ellipsoid", "cone"):
            _cut_hull(_points_of(shape), pose, result)
    return result


def _size(shape: Element, name: str, *default: float) -> float:
    return _sizes(shape, name, 1, default)[0]


def _sizes(shape: Element, name: str, count: int, default: Sequence[float] = ()) -> list[float]:
    """Return positive numbers of an SDF element."""
    values = numbers_of(shape.findtext(name), count, default)
    if min(values) <= 0.0:
        raise MalformedError(f"{name} must be positive, not {min(values):g}")
    return values


def _cut_box(size: list[float], pose: NDArray[np.float64], into: Cut) -> None:
    upright = [axis for axis in range(3) if abs(pose[2, axis]) > math.cos(_LEVEL)]
    corners = 0.5 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * size
    if not upright:
        return _cut_hull(corners, pose, into)
    heights = pose[2, 3] + corners @ pose[2, :3]
    if height_of_cut(heights.min(), heights.max()) is not None:
        first, second = (axis for axis in range(3) if axis != upright[0])
        heading = math.atan2(pose[1, first], pose[0, first])
        into.boxes.append((float(pose[0, 3]), float(pose[1, 3]), size[first], size[second], heading))
    return None


def _cut_cylinder(radius: float, length: float, pose: NDArray[np.float64], into: Cut) -> None:
    if abs(pose[2, 2]) <= math.cos(_LEVEL):
        return _cut_hull(_stack((radius, -0.5 * length), (radius, 0.5 * length)), pose, into)
    if height_of_cut(pose[2, 3] - 0.5 * length, pose[2, 3] + 0.5 * length) is not None:
        into.circles.append((float(pose[0, 3]), float(pose[1, 3]), radius))
    return None


def _cut_sphere(radius: float, pose: NDArray[np.float64], into: Cut) -> None:
    height = height_of_cut(pose[2, 3] - radius, pose[2, 3] + radius)
    if height is not None:
        across = math.sqrt(max(radius**2 - (height - pose[2, 3]) ** 2, 0.0))
        into.circles.append((float(pose[0, 3]), float(pose[1, 3]), across))


def _stack(*rings: tuple[float, float]) -> NDArray[np.float64]:
    """Return the points of circles about the z axis, each with a radius and a height, shape (n, 3)."""
    angles = np.arange(_SIDES) * (2.0 * math.pi / _SIDES)
    circle = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(_SIDES)))
    return np.concatenate([circle * radius + (0.0, 0.0, height) for radius, height in rings])


def _points_of(shape: Element) -> NDArray[np.float64]:
    """Return points whose convex hull is a shape, shape (n, 3), m."""
    if shape.tag == "cone":
        radius, length = _size(shape, "radius"), _size(shape, "length")
        return _stack((radius, -0.5 * length), (0.0, 0.5 * length))
    steps = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _SIDES // 2 + 1)
    ball = _stack(*zip(np.cos(steps).tolist(), np.sin(steps).tolist(), strict=True))
    if shape.tag == "ellipsoid":
        return ball * _sizes(shape, "radii", 3)
    radius, length = _size(shape, "radius"), _size(shape, "length")
    return ball * radius + np.sign(ball[:, 2:]) * (0.0, 0.0, 0.5 * length)


def _cut_hull(points: NDArray[np.float64], pose: NDArray[np.float64], into: Cut) -> None:
    """Cut the convex hull of points, shape (n, 3)."""
    from scipy.spatial import ConvexHull  # worlds from files alone need it

    triangles = points[ConvexHull(points).simplices]
    into.outlines.extend(_cut_bodies([Body(triangles, is_solid=True)], pose))


def _prism(shape: Element) -> Body:
    """Return the sides of a ``<polyline>``, which stands on its origin."""
    corners = np.array([numbers_of(point.text, 2) for point in shape.findall("point")])
    if len(corners) < 3:
        raise MalformedError("a polyline must have 3 points or more")
    height = _size(shape, "height")
    low = np.column_stack((corners, np.zeros(len(corners))))
    after, up = np.roll(low, -1, axis=0), np.array((0.0, 0.0, height))
    sides = np.concatenate((np.stack((low, after, low + up), 1), np.stack((after, after + up, low + up), 1)))
    return Body(sides, is_solid=True)


def _cut_bodies(bodies: list[Body], pose: NDArray[np.float64]) -> list[Outline]:
    """Cut bodies, each at its own height."""
    outlines = []
    for triangles, is_solid in bodies:
        placed = triangles @ pose[:3, :3].T + pose[:3, 3]
        height = height_of_cut(float(placed[..., 2].min()), float(placed[..., 2].max()))
        if height is not None:
            segments = _segments(placed, height)
            outlines += [Outline(segments, is_solid)] if len(segments) else []
    return outlines


def _segments(triangles: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """Return where triangles, shape (n, 3, 3), cross a height; corners at that height count as above it. Shape (m, 2, 2)."""
    above: Any = triangles[..., 2] >= height
    crossing = triangles[above.any(axis=1) & ~above.all(axis=1)]
    above = crossing[..., 2] >= height
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))  # the corner on its own side
    row = np.arange(len(crossing))
    tip = crossing[row, alone]
    ends = []
    for turn in (1, 2):
        other = crossing[row, (alone + turn) % 3]
        share = (height - tip[:, 2]) / (other[:, 2] - tip[:, 2])
        ends.append(tip[:, :2] + share[:, None] * (other[:, :2] - tip[:, :2]))
    return np.stack(ends, axis=1)
