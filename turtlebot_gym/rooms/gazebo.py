"""Gazebo worlds: what stands on the ground in an SDF file as a floor plan."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from turtlebot_gym.meshes import Body, load_mesh
from turtlebot_gym.resources import find_resource, searched
from turtlebot_gym.rooms.enclosure import maps_of
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import Walls
from turtlebot_gym.rooms.sdf import Collision, read_sdf
from turtlebot_gym.rooms.solids import Cut, cut, top_of_floor
from turtlebot_gym.transforms import MalformedError, numbers_of
from turtlebot_gym.values import Pose

APRON = 1.0
"""Free space between the contents of a world and the walls added around them, m."""
_UNREAD = ("heightmap", "image")
_NAMED = 6
"""Most names in a notice."""


class _Contents(NamedTuple):
    """The shapes of a world, and what is to be said about it."""

    shapes: Cut
    is_whole: bool
    """Whether nothing is missing that may be an obstacle."""
    notices: list[str]


def read_gazebo(path: str | Path, *, start: Pose | None = None, goal: Pose | None = None) -> FloorPlan:
    """Read a Gazebo world: the collisions of all its models, those included by it as well, cut at a LiDAR's height.

    Models are searched for along ``GZ_SIM_RESOURCE_PATH``, ``IGN_GAZEBO_RESOURCE_PATH`` and ``GAZEBO_MODEL_PATH``, and beside
    the world. What lies flat on the ground or hangs is left out, see `solids`. Robots are left out as well; other models that
    can be moved stand still. Starts and goals are drawn in what the contents enclose (where a mesh or a
    model is missing, and nothing encloses, between the others); walls are added around everything.

    Args:
        path: An SDF file, ``.world`` or ``.sdf``.
        start: Start pose of the robot; None to draw it.
        goal: Goal pose of the robot; None to draw it.

    Raises:
        ValueError: If a file cannot be read, or nothing in it is an obstacle.

    Warns:
        UserWarning: Of each thing that is left out but may be an obstacle, and of models that can be moved.
    """
    contents = _read(Path(path))
    for text in contents.notices:
        warnings.warn(f"{Path(path).name}: {text}.", stacklevel=2)
    return enclosed(contents.shapes, start=start, goal=goal, is_whole=contents.is_whole)


def _read(path: Path) -> _Contents:
    """Return the contents of a world."""
    meshes: dict[str, str] = {}
    shapes, unread = Cut([], [], []), set()
    try:
        world = read_sdf(path)
        ground, collisions = _on_the_ground(world.collisions)
        for collision in collisions:
            unread.update(shape.tag for shape in collision.geometry if shape.tag in _UNREAD)
            shapes = shapes + _cut(collision, meshes)
    except (ArithmeticError, MalformedError) as error:
        message = f"{str(path)!r} holds a shape or a pose with missing or malformed numbers: {error}."
        raise ValueError(message) from error
    notices = [f"the mesh {uri!r} is left out: {reason}" for uri, reason in meshes.items()]
    if ground:
        notices.append(f"the ground is the top of a box, at {ground:g} m")
    if world.missing:
        notices.append(f"left out, since not found ({searched()}): {_listed(world.missing)}")
    if unread:
        notices.append(f"left out, since not read here: {_listed(sorted(unread))}")
    if world.robots:
        notices.append(f"left out as robots: {_listed(world.robots)}")
    if world.actors:
        notices.append(f"left out, since their ways are not read: {_listed(world.actors)}")
    if world.movable:
        notices.append(f"models that are not static stand still here: {_listed(world.movable)}")
    if not any(shapes):
        said = f" ({'; '.join(notices)})" if notices else ""
        raise ValueError(f"{str(path)!r} holds no obstacle at the height of a robot{said}.")
    return _Contents(shapes, not (meshes or world.missing or unread), notices)


def _on_the_ground(collisions: list[Collision]) -> tuple[float, list[Collision]]:
    """Return the height of the ground, m, and the collisions as seen from there, without the box that is the floor."""
    solid = [collision for collision in collisions if collision.geometry.find("plane") is None]
    for at, collision in enumerate(solid):
        others = solid[:at] + solid[at + 1 :]
        places = np.array([other.pose[:3, 3] for other in others]).reshape(-1, 3)
        top = top_of_floor(collision.geometry, collision.pose, places)
        if top is not None:
            down = np.eye(4)
            down[2, 3] = -top
            return top, [other._replace(pose=down @ other.pose) for other in others]
    return 0.0, collisions


def _cut(collision: Collision, meshes: dict[str, str]) -> Cut:
    """Return the shapes of a collision; meshes that cannot be read are noted with the reason."""

    def load(shape: Element) -> list[Body]:
        uri = shape.findtext("uri", "").strip()
        path = find_resource(uri, collision.files)
        if path is None:
            meshes[uri] = f"there is no such file ({searched()})"
        if uri in meshes or path is None:
            return []
        try:
            scale = np.array(numbers_of(shape.findtext("scale"), 3, (1.0, 1.0, 1.0)))
            return load_mesh(path, scale, shape.findtext("submesh/name", "").strip())
        except (ValueError, ImportError) as error:
            meshes[uri] = str(error).rstrip(".")
            return []

    return cut(collision.geometry, collision.pose, load)


def _listed(names: Sequence[str]) -> str:
    """Return names in a row, the last ones as their number."""
    names = list(dict.fromkeys(names))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}"


def enclosed(shapes: Cut, *, start: Pose | None = None, goal: Pose | None = None, is_whole: bool = True) -> FloorPlan:
    """Return a floor plan with walls `APRON` away from its contents; see `enclosure.maps_of` for the arguments."""
    reach = [(x - r, y - r, x + r, y + r) for x, y, r in shapes.circles]
    for x, y, length, width, heading in shapes.boxes:
        a, b = abs(math.cos(heading)), abs(math.sin(heading))
        along, up = 0.5 * (a * length + b * width), 0.5 * (b * length + a * width)
        reach.append((x - along, y - up, x + along, y + up))
    reach += [(*segments.min(axis=(0, 1)), *segments.max(axis=(0, 1))) for segments, _ in shapes.outlines]
    reach += [(pose.x, pose.y, pose.x, pose.y) for pose in (start, goal) if pose is not None]
    (left, bottom), (right, top) = np.min(reach, axis=0)[:2] - APRON, np.max(reach, axis=0)[2:] + APRON
    walls = Walls(*map(float, ((left + right) / 2.0, (bottom + top) / 2.0, (right - left) / 2.0, (top - bottom) / 2.0)))
    seen, known = maps_of(walls, shapes, start, goal, is_whole=is_whole)
    return FloorPlan(
        walls=walls, circles=tuple(shapes.circles), boxes=tuple(shapes.boxes), start=start, goal=goal, map=seen, chart=known
    )
