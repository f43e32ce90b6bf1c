"""Gazebo worlds: what stands on the ground in an SDF file, cut at a LiDAR's height, as a map of cells.

The robot stands on the ground: z = 0, or a box below everything else. What it drives over (up to `STEP`) and what it passes
below (from `HEADROOM` on) is left out. Everything else is an obstacle with its outline at `SCAN_HEIGHT`; what does not reach
that height has the outline in the middle of its part between the two, and the LiDAR of a plane sees it, too.
"""

from __future__ import annotations

import math
import warnings
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from turtlebot_gym.rooms.grid import FREE, OCCUPIED, SIDE, UNKNOWN, GridMap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.sdf import MISSING, Collision, MalformedError, numbers_of, read_sdf
from turtlebot_gym.values import Pose

SCAN_HEIGHT = 0.18
"""Height of a LiDAR's plane, m: TurtleBot3 Burger 0.182, by its URDF."""
STEP = 0.02
"""Height that a TurtleBot's wheels climb, m."""
HEADROOM = 0.35
"""Height of the highest TurtleBot, m: TurtleBot 4 Standard 0.341."""
FLOOR = (2.0, 0.3)
"""Least extents of a box that may be the floor, and greatest height of its top, m."""
APRON = 1.0
"""Free space between the contents of a world and the walls around them, m."""
CELLS = 2_000_000
"""Cells of a map; larger worlds have larger ones than `grid.SIDE`."""
NARROW = 0.2
"""Width of a gap through which no robot passes, m: a Burger is 0.18 m wide."""
ENOUGH = 1.0
"""Least enclosed ground in which starts and goals are drawn, m^2."""
_SIDES = 48
"""Corners of what is round."""
_NAMED = 6
"""Most names in a warning."""


_Surface = tuple[NDArray[np.float64], bool]
"""Triangles in the world, shape (n, 3, 3), m, or segments, shape (n, 2, 2); and whether they enclose what is solid."""


def read_gazebo(path: str | Path, *, start: Pose | None = None, goal: Pose | None = None) -> FloorPlan:
    """Read a Gazebo world: the collisions of all its models, those included by it as well, cut at a LiDAR's height.

    Models are searched for along the variables `sdf.SEARCHED`, in ROS's packages, in Gazebo's own folder of downloaded models,
    and beside the world. Robots are left out; other models that can be moved stand still. Starts and goals are drawn in what
    the contents enclose, if they do; walls are added around everything.

    A warning names each thing that is left out but may be an obstacle, and models that can be moved.

    Args:
        path: An SDF file, ``.world`` or ``.sdf``.
        start: Start pose of the robot; None to draw it.
        goal: Goal pose of the robot; None to draw it.

    Raises:
        ValueError: If a file cannot be read, or nothing in it is an obstacle.
    """
    unread: dict[str, str] = {}
    try:
        world = read_sdf(Path(path))
        contents = [(each, _bodies(each, unread)) for each in world.collisions]
        ground = _ground(contents)
    except (ArithmeticError, MalformedError) as error:
        raise ValueError(f"{str(path)!r} holds a shape or a pose with missing or malformed numbers: {error}.") from error
    notices = [f"{what} is left out: {reason}" for what, reason in unread.items()]
    if ground:
        notices.append(f"the ground is the top of a box, at {ground:g} m")
    for text, names in world.notices.items():
        listed = list(dict.fromkeys(names))
        if listed:
            notices.append(f"{text}: {', '.join(listed[:_NAMED])}{', ...' * (len(listed) > _NAMED)}")
    outlines = [outline for _, bodies in contents for body in bodies if (outline := _outline(body, ground)) is not None]
    if not outlines:
        said = f" ({'; '.join(notices)})" if notices else ""
        raise ValueError(f"{str(path)!r} holds no obstacle at the height of a robot{said}.")
    for text in notices:
        warnings.warn(f"{Path(path).name}: {text}.", stacklevel=2)
    grid = _map_of(outlines, [pose for pose in (start, goal) if pose is not None])
    return FloorPlan(walls=grid.walls(), map=grid, start=start, goal=goal)


@cache
def _unit(tag: str) -> NDArray[np.float64]:
    """Return the triangles of a box with sides of 1, of a cylinder of radius and length 1, or of a unit sphere."""
    if tag == "box":
        return np.asarray(trimesh.creation.box((1.0, 1.0, 1.0)).triangles)
    if tag == "cylinder":
        return np.asarray(trimesh.creation.cylinder(1.0, 1.0, sections=_SIDES).triangles)
    return np.asarray(trimesh.creation.uv_sphere(count=(_SIDES // 2, _SIDES)).triangles)


def _bodies(collision: Collision, unread: dict[str, str]) -> list[_Surface]:
    """Return the connected bodies of a collision; what cannot be read is noted with the reason."""
    made: list[_Surface] = []
    for shape in collision.geometry:
        if shape.tag == "box":
            made.append((_unit("box") * _sizes(shape, "size", 3), True))
        elif shape.tag == "cylinder":
            (radius,), (length,) = _sizes(shape, "radius"), _sizes(shape, "length")
            made.append((_unit("cylinder") * (radius, radius, length), True))
        elif shape.tag in ("sphere", "ellipsoid"):
            radii = _sizes(shape, "radius") * 3 if shape.tag == "sphere" else _sizes(shape, "radii", 3)
            made.append((_unit("sphere") * radii, True))
        elif shape.tag == "mesh" and (uri := f"the mesh {shape.findtext('uri', '').strip()!r}") not in unread:
            try:
                made.extend(_read_mesh(shape))
            except MalformedError:
                raise
            except Exception as error:  # each format has errors of its own, and a missing reader yet another
                unread[uri] = " ".join(f"{error or type(error).__name__}".split()).rstrip(".")
        elif shape.tag not in ("plane", "empty", "mesh"):
            unread[f"a {shape.tag}"] = "it is not read here"
    turned, moved = collision.pose[:3, :3].T, collision.pose[:3, 3]
    return [(triangles @ turned + moved, is_solid) for triangles, is_solid in made]


def _sizes(shape: Element, name: str, count: int = 1) -> list[float]:
    """Return positive numbers of an SDF element."""
    values = numbers_of(shape.findtext(name), count)
    if min(values) <= 0.0:
        raise MalformedError(f"{name} must be positive, not {min(values):g}")
    return values


def _read_mesh(shape: Element) -> list[_Surface]:
    """Return the connected bodies of a ``<mesh>``.

    A DAE file is scaled to metres by the unit that it states, and its up axis is ignored, as Gazebo does
    (gz-common 5, ``ColladaLoader.cc``).
    """
    path, part = shape.get("path", ""), shape.findtext("submesh/name", "").strip()
    scale = numbers_of(shape.findtext("scale"), 3, (1.0, 1.0, 1.0))
    if not path:
        raise ValueError(MISSING.removeprefix("left out, since "))
    scene: Any = trimesh.load_scene(path)
    names = [name for name in scene.graph.nodes_geometry if not part or part in (name, scene.graph[name][1])]
    meshes = [scene.geometry[scene.graph[name][1]].copy().apply_transform(scene.graph[name][0]) for name in names]
    meshes = [mesh for mesh in meshes if len(getattr(mesh, "faces", ()))]
    if not meshes:
        raise ValueError(f"it has no submesh {part!r}" if part else "it has no triangles")
    bodies: list[Any] = []
    for mesh in meshes:
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        unit = str(mesh.metadata.get("units") or "meters").split("*")[0].strip()  # "0.0254 * meters" of a DAE file
        mesh.apply_scale(np.array(scale) * (float(unit) if unit.replace(".", "", 1).isdecimal() else 1.0))
        bodies.extend(mesh.split(only_watertight=False))
    return [(np.asarray(body.triangles), bool(body.is_watertight and body.volume > 0.0)) for body in bodies]


def _ground(contents: list[tuple[Collision, list[_Surface]]]) -> float:
    """Return the height of the ground, m: 0, or the top of a level box on which everything else stands, which is removed."""
    solid = [pair for pair in contents if pair[1]]
    for collision, bodies in solid:
        others = np.array([other.pose[:3, 3] for other, _ in solid if other is not collision])
        if collision.geometry.find("box") is None or abs(collision.pose[2, 2]) < 1.0 - 1e-8 or not len(others):
            continue
        size, top = np.array(numbers_of(collision.geometry.findtext("box/size"), 3)), float(bodies[0][0][..., 2].max())
        apart = np.abs((others - collision.pose[:3, 3]) @ collision.pose[:3, :2])
        carries = (apart <= 0.5 * size[:2]).all() and (others[:, 2] >= top - 1e-6).all()
        if carries and size[:2].min() >= FLOOR[0] and STEP < top <= FLOOR[1]:
            bodies.clear()
            return top
    return 0.0


def _outline(body: _Surface, ground: float) -> _Surface | None:
    """Return the segments of a body's outline at the height at which a LiDAR sees it; None for one that is no obstacle."""
    triangles, is_solid = body
    low, high = (float(extreme) - ground for extreme in (triangles[..., 2].min(), triangles[..., 2].max()))
    if high <= STEP or low >= HEADROOM:
        return None
    height = SCAN_HEIGHT if low < SCAN_HEIGHT < high else 0.5 * (max(low, STEP) + min(high, HEADROOM))
    height += ground + 1e-7  # beside the corners of most bodies
    ends = np.roll(triangles, -1, axis=1)
    crossed = (triangles[..., 2] > height) != (ends[..., 2] > height)  # no side of a triangle, or two
    start, end = triangles[crossed], ends[crossed]
    share = (height - start[:, 2:]) / (end[:, 2:] - start[:, 2:])
    return ((start + share * (end - start))[:, :2].reshape(-1, 2, 2), is_solid) if len(start) else None


def _map_of(outlines: list[_Surface], given: list[Pose]) -> GridMap:
    """Return the map of outlines, `APRON` wider than they are.

    Cells are occupied whose centre is in a solid outline, or which a thin or an open one touches; unknown is the ground on
    which no robot starts. All ground counts if a start or goal is given that is not in what is enclosed.
    """
    corners = [segments.reshape(-1, 2) for segments, _ in outlines]
    points = np.concatenate([*corners, *(np.array([pose[:2]]) for pose in given)])
    low, high = points.min(axis=0) - APRON, points.max(axis=0) + APRON
    side = max(SIDE, math.sqrt(float(np.prod(high - low)) / CELLS))
    corner = np.floor(low / side + 1e-6) * side
    columns, rows = np.ceil((high - corner) / side - 1e-6).astype(int).tolist()
    occupied = np.zeros((rows, columns), np.bool_)
    for segments, is_solid in outlines:
        placed = (segments - corner) / side
        inside = _filled(placed, occupied.shape)
        length = np.linalg.norm(placed[:, 1] - placed[:, 0], axis=1).sum()
        if is_solid:
            occupied |= inside
        if not is_solid or 2.0 * inside.sum() < length:  # such a strip is narrower than a cell
            _draw(occupied, placed)
    ground = _enclosed(occupied, side)
    cell = [tuple(np.floor((np.array(pose[:2]) - corner) / side).astype(int)[::-1]) for pose in given]
    ground = ground if all(ground[at] for at in cell) else ~occupied
    cells = np.where(occupied, OCCUPIED, np.where(ground, FREE, UNKNOWN))
    return GridMap(cells=cells, resolution=side, origin=Pose(float(corner[0]), float(corner[1]), 0.0))


def _draw(cells: NDArray[np.bool_], segments: NDArray[np.float64]) -> None:
    """Mark the cells that segments, shape (n, 2, 2), touch; in cells."""
    for start, end in segments:
        steps = math.ceil(2.0 * float(np.abs(end - start).max())) + 1
        column, row = np.floor(start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)).astype(int).T
        cells[row, column] = True


def _filled(segments: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the cells from whose centre an odd number of segments lies to the left; in cells."""
    (x0, y0), (x1, y1) = segments.transpose(1, 2, 0)
    first, after = np.ceil(np.minimum(y0, y1) - 0.5).astype(int), np.ceil(np.maximum(y0, y1) - 0.5).astype(int)
    counts = after - first  # of rows whose middle each segment crosses
    of = np.repeat(np.arange(len(segments)), counts)
    row = np.arange(len(of)) - (np.cumsum(counts) - after)[of]
    x = x0[of] + (row + 0.5 - y0[of]) * (x1 - x0)[of] / (y1 - y0)[of]
    turns = np.zeros((shape[0], shape[1] + 1), np.int32)
    np.add.at(turns, (row, np.ceil(x - 0.5).astype(int)), 1)
    return np.cumsum(turns, axis=1)[:, :-1] % 2 == 1


def _enclosed(occupied: NDArray[np.bool_], side: float) -> NDArray[np.bool_]:
    """Return the largest ground that cells enclose, but for gaps of less than `NARROW`; all if it is less than `ENOUGH`."""
    wide: Any = distance_transform_edt(~occupied)
    labels: Any = label(wide * side > 0.5 * NARROW)[0]  # pyright: ignore[reportIndexIssue]
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        sizes[edge] = 0
    largest = int(sizes.argmax())
    if sizes[largest] * side * side < ENOUGH:
        return ~occupied
    near: Any = distance_transform_edt(labels != largest)
    return (near * side <= 0.5 * NARROW) & ~occupied
