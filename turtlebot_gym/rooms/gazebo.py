"""Gazebo worlds: what stands on the ground in an SDF file, cut at a LiDAR's height, as a map of cells.

What the robot drives over (up to `STEP`) and what it passes below (from `HEADROOM` on) is left out. Everything else is an
obstacle with its outline at `SCAN_HEIGHT`; what does not reach that height has the outline in the middle of its part between
the two, and the LiDAR of a plane sees it, too.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import label
from trimesh.intersections import mesh_plane

from turtlebot_gym.rooms.grid import FREE, OCCUPIED, SIDE, UNKNOWN, GridMap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.sdf import MISSING, Collision, numbers_of, read_sdf
from turtlebot_gym.values import Pose

SCAN_HEIGHT = 0.18
"""Height of a LiDAR's plane, m: TurtleBot3 Burger 0.182, by its URDF."""
STEP = 0.02
"""Height that a TurtleBot's wheels climb, m."""
HEADROOM = 0.35
"""Height of the highest TurtleBot, m: TurtleBot 4 Standard 0.341."""
APRON = 1.0
"""Free space between the contents of a world and the walls around them, m."""
ENOUGH = 1.0
"""Least enclosed ground in which starts and goals are drawn, m^2."""
_SIDES = 48
"""Corners of what is round."""


def read_gazebo(path: str | Path) -> FloorPlan:
    """Read a Gazebo world: the collisions of all its models, those included by it as well, cut at a LiDAR's height.

    Robots are left out; other models that can be moved stand still. Starts and goals are drawn in what the contents enclose, if
    they do; walls are added around everything. For where models are searched for, see `sdf.read_sdf`. A ``ValueError`` says
    that a file cannot be read, or holds no obstacle; warnings name what is left out but may be one, and models that can be
    moved.
    """
    bodies = [body for collision in read_sdf(Path(path)) for body in _bodies(collision)]
    outlines = [(outline, body.is_volume) for body in bodies if len(outline := _outline(body))]
    if not outlines:
        raise ValueError(f"{str(path)!r} holds no obstacle at the height of a robot.")
    grid = _map_of(outlines)
    return FloorPlan(walls=grid.walls(), map=grid)


def _bodies(collision: Collision) -> list[trimesh.Trimesh]:
    """Return the connected bodies of a collision in the world; a warning names what cannot be read."""
    bodies: list[Any] = []
    for shape in collision.geometry:
        if shape.tag == "box":
            bodies.append(trimesh.creation.box(numbers_of(shape.findtext("size"), 3)))
        elif shape.tag == "cylinder":
            (radius,), (length,) = numbers_of(shape.findtext("radius"), 1), numbers_of(shape.findtext("length"), 1)
            bodies.append(trimesh.creation.cylinder(radius, length, sections=_SIDES))
        elif shape.tag == "sphere":
            bodies.append(trimesh.creation.uv_sphere(*numbers_of(shape.findtext("radius"), 1), count=(_SIDES // 2, _SIDES)))
        elif shape.tag == "mesh":
            scale = numbers_of(shape.findtext("scale"), 3, (1.0, 1.0, 1.0))
            try:
                bodies.extend(body for mesh in _meshes(shape) for body in mesh.apply_scale(scale).split(only_watertight=False))
            except Exception as error:  # each format has errors of its own, and a missing reader yet another
                warnings.warn(f"the mesh {shape.findtext('uri', '').strip()!r} is left out: {error!r}", stacklevel=2)
        elif shape.tag not in ("plane", "empty"):
            warnings.warn(f"a {shape.tag} is left out: it is not read here", stacklevel=2)
    return [body.apply_transform(collision.pose) for body in bodies]


def _meshes(shape: Element) -> list[Any]:
    """Return the parts of a ``<mesh>``, without its scale.

    A DAE file is scaled to metres by the unit that it states, and its up axis is ignored, as Gazebo does
    (gz-common 5, ``ColladaLoader.cc``).
    """
    if not shape.get("path"):
        raise ValueError(MISSING)
    meshes: list[Any] = [mesh for mesh in trimesh.load_scene(shape.get("path")).dump() if len(getattr(mesh, "faces", ()))]
    if not meshes or shape.find("submesh") is not None:
        raise ValueError("it has no triangles, or only a part of it counts, which is not read here")
    for mesh in meshes:
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        unit = str(mesh.metadata.get("units") or "meters").split("*")[0].strip()  # "0.0254 * meters" of a DAE file
        mesh.apply_scale(float(unit) if unit.replace(".", "", 1).isdecimal() else 1.0)
    return meshes


def _outline(body: trimesh.Trimesh) -> NDArray[np.float64]:
    """Return the segments of a body's outline where a LiDAR sees it, shape (n, 2, 2), m; none of a body that is no obstacle."""
    low, high = body.bounds[:, 2].tolist()
    if high <= STEP or low >= HEADROOM:
        return np.empty((0, 2, 2))
    height = SCAN_HEIGHT if low < SCAN_HEIGHT < high else 0.5 * (max(low, STEP) + min(high, HEADROOM))
    height += 1e-7  # beside the corners of most bodies
    return np.asarray(mesh_plane(body, (0.0, 0.0, 1.0), (0.0, 0.0, height)))[:, :, :2]


def _map_of(outlines: list[tuple[NDArray[np.float64], bool]]) -> GridMap:
    """Return the map of outlines, `APRON` wider than they are; each with whether it encloses what is solid.

    Cells are occupied whose centre is in a solid outline, or which a thin or an open one touches; unknown is the ground on
    which no robot starts.
    """
    points = np.concatenate([segments.reshape(-1, 2) for segments, _ in outlines])
    low, high = points.min(axis=0) - APRON, points.max(axis=0) + APRON
    corner = np.floor(low / SIDE + 1e-6) * SIDE
    columns, rows = np.ceil((high - corner) / SIDE - 1e-6).astype(int).tolist()
    occupied = np.zeros((rows, columns), np.bool_)
    for segments, is_solid in outlines:
        placed = (segments - corner) / SIDE
        inside = _filled(placed, occupied.shape)
        length = np.linalg.norm(placed[:, 1] - placed[:, 0], axis=1).sum()
        if is_solid:
            occupied |= inside
        if not is_solid or 2.0 * inside.sum() < length:  # such a strip is narrower than a cell
            _draw(occupied, placed)
    cells = np.where(occupied, OCCUPIED, np.where(_enclosed(occupied), FREE, UNKNOWN))
    return GridMap(cells=cells, resolution=SIDE, origin=Pose(float(corner[0]), float(corner[1]), 0.0))


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


def _enclosed(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the largest ground that cells enclose; all if it is less than `ENOUGH`."""
    labels: Any = label(~occupied)[0]  # pyright: ignore[reportIndexIssue]
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        sizes[edge] = 0
    largest = int(sizes.argmax())
    return labels == largest if sizes[largest] * SIDE * SIDE >= ENOUGH else ~occupied
