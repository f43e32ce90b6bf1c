"""SDF files: the collisions of a world's models, and of those in them or included by them, with their poses."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Sequence
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
MISSING = f"left out, since not found ({', '.join(SEARCHED)}, beside the world, and in models there and above)"
"""What is said of included models that are not found."""
_LEVELS = 3
"""Folders above a file in which models are searched for."""
_DEEPEST = 20
"""Most files that include one another."""
_NO_OBSTACLES = ("ground plane", "sun")
_DRIVES = ("diff_drive", "diffdrive", "diff-drive", "skid", "ackermann", "mecanum", "omni", "planar_move", "planarmove")
_OWN_FRAME = ("", "__model__", "__root__", "world")


class MalformedError(ValueError):
    """A number, a shape or a pose in a file is missing, malformed or not read here."""


class Collision(NamedTuple):
    """A collision of a model."""

    pose: NDArray[np.float64]
    """In the world, shape (4, 4)."""
    geometry: Element
    """Each ``<mesh>`` in it has the attribute ``path``: its file, empty if there is none."""


class SdfWorld(NamedTuple):
    """What an SDF file holds."""

    collisions: list[Collision]
    notices: defaultdict[str, list[str]]
    """Names of models that are left out, or taken in another way than by Gazebo, by what is to be said of them."""


def read_sdf(path: Path) -> SdfWorld:
    """Read the collisions of a world, or of a model.

    Raises:
        ValueError: If a file cannot be read, or a pose is malformed or relative to a named frame.
    """
    root = _parse(path)
    world = root.find("world")
    world = root if world is None else world
    found = SdfWorld([], defaultdict(list))
    for actor in world.findall("actor"):
        found.notices["left out, since their ways are not read"].append(actor.get("name", ""))
    saved = {model.get("name"): model for model in world.findall("state/model")}  # of classic Gazebo
    for model in world.findall("model"):
        _override(model, saved.get(model.get("name"), model), "pose")
    _add(found, world, np.eye(4), (path,), is_static=False)
    return found


def _parse(path: Path) -> Element:
    try:
        return parse(path).getroot()
    except OSError as error:
        raise ValueError(f"There is no Gazebo world {str(path)!r}: {error.strerror}.") from error
    except (ParseError, LookupError, ValueError) as error:  # the last two: an encoding that is unknown
        raise ValueError(f"{str(path)!r} is not a Gazebo world: {error}.") from error


def _add(found: SdfWorld, parent: Element, pose: NDArray[np.float64], files: tuple[Path, ...], *, is_static: bool) -> None:
    """Add a model or a world with a pose, and what it holds; ``files`` are its own and those that include that one."""
    for link in parent.findall("link"):
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            if geometry is not None:
                for mesh in geometry.findall("mesh"):
                    mesh.set("path", str(_find(mesh.findtext("uri", ""), files) or ""))
                found.collisions.append(Collision(pose @ _pose_of(link) @ _pose_of(collision), geometry))
    for child in parent:
        model, inside = (child, files) if child.tag == "model" else (None, files)
        if child.tag == "include":
            model, inside = _included(child, files, found.notices[MISSING])
        if model is None:
            continue
        stands, name = is_static or model.findtext("static", "0").strip().lower() in ("1", "true"), model.get("name", "")
        if not stands and _drives(model):
            found.notices["left out as robots"].append(name)
            continue
        if not stands and model.find("link/collision") is not None:
            found.notices["models that are not static stand still here"].append(name)
        _add(found, model, pose @ _pose_of(model), inside, is_static=stands)


def _included(include: Element, files: tuple[Path, ...], missing: list[str]) -> tuple[Element | None, tuple[Path, ...]]:
    """Return the model that is included, with what ``<include>`` overrides, and its files; None without one."""
    uri = include.findtext("uri", "").strip()
    path = _find(uri, files)
    path = _sdf_in(path) if path is not None and path.is_dir() else path
    if path is None or not path.is_file():
        if uri.rstrip("/").rpartition("/")[2].replace("_", " ").lower() not in _NO_OBSTACLES:
            missing.append(uri)
        return None, files
    if len(files) > _DEEPEST:
        raise ValueError(f"{str(files[-1])!r} holds models that include one another more than {_DEEPEST} deep.")
    if include.find("placement_frame") is not None:
        raise MalformedError(f"the placement_frame of {uri!r} is not read here: state the pose of the model itself")
    model = _parse(path).find("model")
    if model is not None:
        for tag in ("pose", "static"):
            _override(model, include, tag)
        model.set("name", include.findtext("name", model.get("name", "")).strip())
    return model, (path, *files)


def _override(model: Element, other: Element, tag: str) -> None:
    """Put the element with a tag into a model in place of its own, if there is one."""
    element = other.find(tag)
    if element is not None:
        for old in model.findall(tag):
            model.remove(old)
        model.append(element)


def _find(uri: str, files: Sequence[Path]) -> Path | None:
    """Return the file or folder that a URI names; None if there is none.

    Models are searched for along `SEARCHED`, beside the file that names them and those that include that one, in ``models``
    there, in both of the folders above, and in ROS's packages; those of Gazebo's library in Gazebo's own folder.
    """
    parts = urlsplit(uri.strip())
    if parts.scheme in ("http", "https"):
        return _downloaded(parts.netloc, unquote(parts.path))
    name = unquote(f"{parts.netloc}{parts.path}")
    name = name.lstrip("/") if parts.scheme in ("model", "package") else name
    folders = [Path(folder) for variable in SEARCHED for folder in os.environ.get(variable, "").split(os.pathsep) if folder]
    for file in files:
        folders += [part for above in file.resolve().parents[: _LEVELS + 1] for part in (above, above / "models")]
    folders += [Path(prefix, "share") for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    return next((folder / name for folder in folders if name and (folder / name).exists()), None)


def _downloaded(host: str, path: str) -> Path | None:
    """Return where Gazebo keeps a model from its library, the newest version."""
    owner, _, name = re.sub(r"^/([\d.]+/)?", "", path).lower().partition("/models/")
    caches = [os.environ.get("GZ_FUEL_CACHE_PATH", ""), Path.home() / ".gz" / "fuel", Path.home() / ".ignition" / "fuel"]
    folders = [Path(cache, host, owner, "models", name.partition("/")[0]) for cache in caches if cache]
    versions = [part for folder in folders for part in folder.glob("*") if part.name.isdecimal()]
    return max(versions, key=lambda part: int(part.name), default=None)


def _sdf_in(folder: Path) -> Path:
    """Return the SDF file of a model's folder: of those in its ``model.config`` that of the newest version."""
    config = folder / "model.config"
    files = _parse(config).findall("sdf") if config.is_file() else []
    newest = max(files, key=lambda file: [int(part) for part in file.get("version", "1").split(".")], default=None)
    return folder / ("model.sdf" if newest is None else (newest.text or "").strip())


def _drives(model: Element) -> bool:
    """Return whether a model is a robot: it has a plugin for driving, or wheels that turn."""
    plugins = (f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower() for plugin in model.iter("plugin"))
    if any(word in text for text in plugins for word in _DRIVES):
        return True
    turning = (joint for joint in model.iter("joint") if joint.get("type") in ("revolute", "continuous"))
    return any("wheel" in joint.get("name", "").lower() for joint in turning)


def numbers_of(text: str | None, count: int, default: Sequence[float] = ()) -> list[float]:
    """Return the finite numbers of a text; the default if there is no text.

    Raises:
        MalformedError: If there is another count of numbers, or one is malformed or not finite.
    """
    if not (text or "").strip() and default:
        return list(default)
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError as error:
        raise MalformedError(str(error)) from error
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        raise MalformedError(f"{' '.join((text or '').split())!r} must be {count} finite numbers of at most {LARGEST:g}")
    return values


def _pose_of(element: Element) -> NDArray[np.float64]:
    """Return the pose of a model, link or collision in what holds it, shape (4, 4)."""
    pose = element.find("pose")
    if pose is None:
        return np.eye(4)
    frame = pose.get("relative_to", pose.get("frame", "")).strip()
    if frame not in _OWN_FRAME:
        raise MalformedError(f"the pose of {element.get('name', '')!r} is relative to {frame!r}: state it in what holds it")
    numbers = numbers_of(pose.text, 6, (0.0,) * 6)
    in_degrees = pose.get("degrees", "false").strip().lower() in ("1", "true")
    roll, pitch, yaw = np.radians(numbers[3:]) if in_degrees else numbers[3:]
    matrix = euler_matrix(roll, pitch, yaw)
    matrix[:3, 3] = numbers[:3]
    return matrix
