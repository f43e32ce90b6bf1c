"""Meshes, as worlds name them: STL, OBJ and DAE, read by trimesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FORMATS = (".stl", ".obj", ".dae", ".ply", ".off", ".glb", ".gltf")
"""File name endings of meshes."""


class Body(NamedTuple):
    """A connected surface of triangles."""

    triangles: NDArray[np.float64]
    """Shape (n, 3, 3), m."""
    is_solid: bool
    """Whether it encloses what is solid."""


def load_mesh(path: Path, scale: NDArray[np.float64], part: str = "") -> list[Body]:
    """Return the connected bodies of a mesh.

    A DAE file is scaled to metres by the unit that it states, and its up axis is ignored, as Gazebo does
    (gz-common 5, ``ColladaLoader.cc``).

    Args:
        path: The file.
        scale: Factors along the mesh's axes.
        part: Name of a submesh; empty for all.

    Raises:
        ValueError: If the file cannot be read, or has no such submesh.
        ImportError: If trimesh, or pycollada for DAE, is not installed.
    """
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{path.suffix or 'a file without an ending'} is no format of meshes; save it as .stl, .obj or .dae")
    try:
        import trimesh

        if path.suffix.lower() == ".dae":
            import collada  # noqa: F401
    except ImportError as error:
        raise ImportError(f"Meshes need {error.name}: pip install 'turtlebot-gym[gym]'.") from error
    try:
        scene: Any = trimesh.load_scene(path)
        names = [name for name in scene.graph.nodes_geometry if not part or part in (name, scene.graph[name][1])]
        meshes = [(scene.geometry[scene.graph[name][1]].copy(), scene.graph[name][0]) for name in names]
    except Exception as error:  # each format has errors of its own
        raise ValueError(f"{' '.join(str(error).split()) or type(error).__name__}") from error
    if part and not meshes:
        raise ValueError(f"it has no submesh {part!r}")
    bodies: list[Body] = []
    for mesh, transform in meshes:
        if hasattr(mesh, "faces") and len(mesh.faces):
            mesh.apply_transform(transform)
            bodies.extend(_bodies(mesh, scale * _unit(mesh)))
    if not bodies:
        raise ValueError("it has no triangles")
    return bodies


def _unit(mesh: Any) -> float:
    """Return the unit of a DAE file, m; trimesh writes "0.0254 * meters"."""
    unit = str(mesh.metadata.get("units") or "meters").split("*")[0].strip()
    try:
        return float(unit)
    except ValueError:
        return 1.0


def _bodies(mesh: Any, scale: NDArray[np.float64]) -> list[Body]:
    import trimesh

    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    labels = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    order = np.argsort(labels, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
    triangles = np.asarray(mesh.triangles, float)
    return [Body(triangles[group] * scale, _is_solid(mesh.faces[group], triangles[group])) for group in groups]


def _is_solid(faces: NDArray[np.int64], triangles: NDArray[np.float64]) -> bool:
    """Return whether faces are closed, each edge belonging to two, and look outwards."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return bool((count == 2).all()) and volume > 0.0
