"""SDF files: the collisions of a world's models, and of those in them or included by them, with their poses."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element, ParseError, parse

import numpy as np
from numpy.typing import NDArray
from trimesh.transformations import euler_matrix

from turtlebot_gym.config import LARGEST

SEARCHED = ("GZ_SIM_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
"""Environment variables with folders of models, of new and of classic Gazebo."""
MISSING = f"it is not found ({', '.join(SEARCHED)}, beside the world, and in models there and above)"
"""What is said of models and meshes that are not found."""
_LEVELS = 3
"""Folders above a world in which models are searched for."""
_OWN_FRAME = ("", "__model__", "__root__", "world")


class Collision(NamedTuple):
    """A collision of a model."""

    pose: NDArray[np.float64]
    """In the world, shape (4, 4)."""
    geometry: Element
    """Each ``<mesh>`` in it has the attribute ``path``: its file, empty if there is none."""


def read_sdf(path: Path) -> list[Collision]:
    """Read the collisions of a world, or of a model.

    Models are searched for along `SEARCHED`, in ROS's packages, beside the world and above it, in ``models`` there, and, those
    of Gazebo's library, in Gazebo's own folder. A ``ValueError`` says that a file cannot be read, or that a pose is malformed
    or relative to a named frame; warnings name models that are left out, or that can be moved: they stand still.
    """
    root = _parse(path)
    folders = [Path(folder) for variable in SEARCHED for folder in os.environ.get(variable, "").split(os.pathsep) if folder]
    folders += [part for above in path.resolve().parents[: _LEVELS + 1] for part in (above, above / "models")]
    folders += [Path(prefix, "share") for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    world = root.find("world")
    return [*_collisions(root if world is None else world, np.eye(4), folders, is_static=False)]


def _parse(path: Path) -> Element:
    try:
        return parse(path).getroot()
    except (OSError, ParseError, LookupError, ValueError) as error:  # the last two: an encoding that is unknown
        raise ValueError(f"{str(path)!r} is not a Gazebo world: {error}.") from error


def _collisions(parent: Element, pose: NDArray[np.float64], folders: Sequence[Path], *, is_static: bool) -> Iterator[Collision]:
    """Yield the collisions of a model or a world with a pose, and of what it holds."""
    for link in parent.findall("link"):
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            if geometry is not None:
                for mesh in geometry.findall("mesh"):
                    mesh.set("path", str(_find(mesh.findtext("uri", ""), folders) or ""))
                yield Collision(pose @ _pose_of(link) @ _pose_of(collision), geometry)
    for child in parent:
        model, inside = (child, folders) if child.tag == "model" else (None, folders)
        if child.tag == "include":
            model, inside = _included(child, folders)
        if model is None:
            continue
        stands, name = is_static or model.findtext("static", "0").strip().lower() in ("1", "true"), model.get("name", "")
        if not stands and any(joint.get("type") in ("revolute", "continuous") for joint in model.iter("joint")):
            warnings.warn(f"the model {name!r} is left out: it is a robot", stacklevel=2)
            continue
        if not stands and model.find("link/collision") is not None:
            warnings.warn(f"the model {name!r} can be moved: here it stands still", stacklevel=2)
        yield from _collisions(model, pose @ _pose_of(model), inside, is_static=stands)


def _included(include: Element, folders: Sequence[Path]) -> tuple[Element | None, Sequence[Path]]:
    """Return the model that is included, with what ``<include>`` overrides, and where it searches; None without one."""
    uri = include.findtext("uri", "").strip()
    path = _find(uri, folders)
    if path is None:
        if uri.rpartition("/")[2].replace("_", " ").lower() not in ("ground plane", "sun"):
            warnings.warn(f"{uri} is left out: {MISSING}", stacklevel=2)
        return None, folders
    path = path / "model.sdf" if path.is_dir() else path
    model = _parse(path).find("model")
    for element in (include.find(tag) for tag in ("pose", "static")):
        if model is not None and element is not None:
            for old in model.findall(element.tag):
                model.remove(old)
            model.append(element)
    return model, (path.parent, *folders)


def _find(uri: str, folders: Sequence[Path]) -> Path | None:
    """Return the file or folder that a URI names; None if there is none."""
    parts = urlsplit(uri.strip())
    path = unquote(parts.path).strip("/")
    if parts.scheme in ("http", "https"):  # where Gazebo keeps a model of its library, by its version
        cache = os.environ.get("GZ_FUEL_CACHE_PATH") or Path.home() / ".gz" / "fuel"
        versions = Path(cache, parts.netloc, *path.lower().split("/")[-3:]).glob("[0-9]*")
        return max(versions, key=lambda version: int(version.name), default=None)
    name = Path(unquote(parts.netloc), path if parts.scheme in ("model", "package") else unquote(parts.path))
    return next((folder / name for folder in folders if name.parts and (folder / name).exists()), None)


def numbers_of(text: str | None, count: int, default: Sequence[float] = ()) -> list[float]:
    """Return the finite numbers of a text, or the default if it is empty; a ``ValueError`` refuses another count of them."""
    values = [float(word) for word in (text or "").split()] or list(default)
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        raise ValueError(f"{' '.join((text or '').split())!r} must be {count} finite numbers of at most {LARGEST:g}")
    return values


def _pose_of(element: Element) -> NDArray[np.float64]:
    """Return the pose of a model, link or collision in what holds it, shape (4, 4)."""
    pose = element.find("pose")
    if pose is None:
        return np.eye(4)
    frame = pose.get("relative_to", pose.get("frame", "")).strip()
    if frame not in _OWN_FRAME:
        raise ValueError(f"the pose of {element.get('name', '')!r} is relative to {frame!r}: state it in what holds it")
    x, y, z, roll, pitch, yaw = numbers_of(pose.text, 6, (0.0,) * 6)
    unit = math.pi / 180.0 if pose.get("degrees", "").strip().lower() in ("1", "true") else 1.0
    matrix = euler_matrix(unit * roll, unit * pitch, unit * yaw)
    matrix[:3, 3] = x, y, z
    return matrix
