"""Gazebo worlds: the static cylinders and boxes of an SDF file as a floor plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from turtlebot_gym.files import in_bounds
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import Walls
from turtlebot_gym.values import Pose

APRON = 1.0
"""Free space between the contents of a world and the walls added around them, m."""


class _GazeboFrame(NamedTuple):
    x: float
    y: float
    yaw: float

    def __add__(self, other: object) -> _GazeboFrame:
        assert isinstance(other, _GazeboFrame)
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return _GazeboFrame(
            self.x + cosine * other.x - sine * other.y, self.y + sine * other.x + cosine * other.y, self.yaw + other.yaw
        )


def read_gazebo(path: str | Path, *, start: Pose | None = None, goal: Pose | None = None) -> FloorPlan:
    """Read the static cylinders and boxes of a Gazebo world.

    Objects that lie flat on the ground or hang, and other shapes, are ignored. Walls are added around everything.

    Args:
        path: An SDF file, ``.world`` or ``.sdf``.
        start: Start pose of the robot; None to draw it.
        goal: Goal pose of the robot; None to draw it.

    Raises:
        ValueError: If the file cannot be read, or holds no static cylinder or box.
    """
    circles, boxes = _shapes(path)
    return enclosed(circles, boxes, start=start, goal=goal)


@in_bounds
def _shapes(path: str | Path) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    """Return the circles and the boxes of a world."""
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise ValueError(f"There is no Gazebo world {str(path)!r}: {error.strerror}.") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the last two: an encoding that is unknown
        raise ValueError(f"{str(path)!r} is not a Gazebo world: {error}.") from error
    circles: list[tuple[float, ...]] = []
    boxes: list[tuple[float, ...]] = []
    try:
        for frame, geometry in _geometries(root):
            cylinder, box = geometry.find("cylinder"), geometry.find("box")
            if cylinder is not None:
                circles.append((frame.x, frame.y, float(cylinder.findtext("radius", "nan"))))
            elif box is not None:
                length, width, _ = map(float, box.findtext("size", "").split())
                boxes.append((frame.x, frame.y, length, width, frame.yaw))
    except ValueError as error:
        raise ValueError(f"{str(path)!r} holds a shape or a pose with missing or malformed numbers: {error}.") from error
    if not circles and not boxes:
        raise ValueError(f"{str(path)!r} holds no static cylinder and no static box.")
    return circles, boxes


def enclosed(
    circles: Sequence[tuple[float, ...]],
    boxes: Sequence[tuple[float, ...]],
    *,
    start: Pose | None = None,
    goal: Pose | None = None,
) -> FloorPlan:
    """Return a floor plan with walls `APRON` away from its contents; the arguments are those of `FloorPlan`."""
    reach = [(x, y, radius) for x, y, radius in circles]
    reach += [(x, y, math.hypot(length, width) / 2.0) for x, y, length, width, _ in boxes]
    reach += [(pose.x, pose.y, 0.0) for pose in (start, goal) if pose is not None]
    left, right = min(x - r for x, _, r in reach) - APRON, max(x + r for x, _, r in reach) + APRON
    bottom, top = min(y - r for _, y, r in reach) - APRON, max(y + r for _, y, r in reach) + APRON
    walls = Walls((left + right) / 2.0, (bottom + top) / 2.0, (right - left) / 2.0, (top - bottom) / 2.0)
    return FloorPlan(walls=walls, circles=tuple(circles), boxes=tuple(boxes), start=start, goal=goal)


def _geometries(root: ElementTree.Element) -> Iterator[tuple[_GazeboFrame, ElementTree.Element]]:
    """Yield the frame and the geometry of each collision of each static model."""
    for model in root.iter("model"):
        if model.findtext("static", "0").strip() in ("1", "true"):
            for link in model.iter("link"):
                for collision in link.iter("collision"):
                    geometry = collision.find("geometry")
                    if geometry is not None:
                        yield _frame(model) + _frame(link) + _frame(collision), geometry


def _frame(element: ElementTree.Element) -> _GazeboFrame:
    x, y, _, _, _, yaw = map(float, element.findtext("pose", "0 0 0 0 0 0").split())
    return _GazeboFrame(x, y, yaw)
