"""SDF files: models, those that they hold or include, and the poses of their collisions in the world.

References:
    SDFormat 1.12, *Pose frame semantics*; libsdformat 14, ``src/parser.cc``: the file that a ``model.config`` names, and what
    ``<include>`` overrides.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element, ParseError, parse

import numpy as np
from numpy.typing import NDArray
from trimesh.transformations import euler_matrix

from turtlebot_gym.config import LARGEST

SEARCHED = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH")
"""Environment variables with folders of models, of new and of classic Gazebo."""
_LEVELS = 3
"""Folders above a file in which models are searched for."""
_DEEPEST = 20
"""Most models that are in one another, or include one another, and most frames that are relative to one another."""
_NEWEST = (1, 12)
"""Newest version of SDF that is chosen in a ``model.config``."""
_NO_OBSTACLES = ("ground plane", "sun")
_DRIVES = ("diff_drive", "diffdrive", "diff-drive", "skid", "ackermann", "mecanum", "omni", "planar_move", "planarmove")
_FRAMES = ("link", "frame", "joint", "model")
_ORIGIN = ("", "__model__", "__root__", "world")


class MalformedError(ValueError):
    """A number, a shape or a frame in a file is missing or malformed."""


class Collision(NamedTuple):
    """A collision of a model."""

    pose: NDArray[np.float64]
    """In the world, shape (4, 4)."""
    geometry: Element
    """Each ``<mesh>`` in it has the attribute ``path``: its file, empty if there is none."""


class SdfWorld(NamedTuple):
    """What an SDF file holds."""

    collisions: list[Collision]
    robots: list[str]
    """Names of models that drive by themselves, which are left out."""
    movable: list[str]
    """Names of models that are not static."""
    missing: list[str]
    """Included models that were not found."""
    actors: list[str]
    """Names of people, who are left out."""


def read_sdf(path: Path) -> SdfWorld:
    """Read the collisions of a world, or of a model.

    Raises:
        ValueError: If a file cannot be read, or a pose is malformed or relative to an unknown frame.
    """
    missing: list[str] = []
    root = _parse((path,), missing)
    world = root.find("world")
    world = root if world is None else world
    saved = {model.get("name"): model.find("pose") for model in world.findall("state/model")}  # of classic Gazebo
    result = SdfWorld([], [], [], missing, [actor.get("name", "") for actor in world.findall("actor")])
    for model in world.findall("model"):
        name = model.get("name", "")
        if not _is_static(model) and _drives(model):
            result.robots.append(name)
            continue
        _override(model, saved.get(name))
        found = list(_collisions(model, _pose_in(world, model)))
        if found and not _is_static(model):
            result.movable.append(name)
        result.collisions.extend(found)
    return result


def _parse(files: tuple[Path, ...], missing: list[str]) -> Element:
    """Return an SDF file with the models that it includes in it; ``files`` are that file and those that include it."""
    path = files[0]
    if len(files) > _DEEPEST:
        raise ValueError(f"{str(files[-1])!r} holds models that are nested, or include themselves, more than {_DEEPEST} deep.")
    try:
        root = parse(path).getroot()
    except OSError as error:
        raise ValueError(f"There is no Gazebo world {str(path)!r}: {error.strerror}.") from error
    except (ParseError, LookupError, ValueError) as error:  # the last two: an encoding that is unknown
        raise ValueError(f"{str(path)!r} is not a Gazebo world: {error}.") from error
    for mesh in root.iter("mesh"):
        mesh.set("path", str(_find(mesh.findtext("uri", ""), files) or ""))
    for parent in [element for element in root.iter() if element.find("include") is not None]:
        for at, child in enumerate(list(parent)):
            if child.tag == "include":
                parent[at] = _included(child, files, missing)
    return root


def _included(include: Element, files: tuple[Path, ...], missing: list[str]) -> Element:
    """Return the model that is included, with what ``<include>`` overrides."""
    uri = include.findtext("uri", "").strip()
    path = _find(uri, files)
    path = _sdf_in(path) if path is not None and path.is_dir() else path
    if path is None or not path.is_file():
        if uri.rstrip("/").rpartition("/")[2].replace("_", " ").lower() not in _NO_OBSTACLES:
            missing.append(uri)
        return Element("include")
    model = _parse((path, *files), missing).find("model")
    if model is None:
        return Element("include")  # a light, or an actor
    if include.find("placement_frame") is not None:
        raise MalformedError(f"the placement_frame of {uri!r} is not read here: state the pose of the model itself")
    for tag in ("pose", "static"):
        _override(model, include.find(tag))
    model.set("name", include.findtext("name", model.get("name", "")).strip())
    return model


def _override(model: Element, element: Element | None) -> None:
    """Put an element into a model in place of those with its tag."""
    if element is not None:
        for old in model.findall(element.tag):
            model.remove(old)
        model.append(element)


def _find(uri: str, files: Sequence[Path]) -> Path | None:
    """Return the file or folder that a URI names; None if there is none.

    Args:
        uri: ``model://``, ``package://``, ``file://``, a relative path, or an address in Gazebo's library of models.
        files: The file that states it, and those that include that one: models are searched for beside them, in ``models``
            there, and in both of the folders above.
    """
    parts = urlsplit(uri.strip())
    if parts.scheme in ("http", "https"):
        return _downloaded(parts.netloc, unquote(parts.path))
    if not parts.scheme:
        return next((file.parent / uri.strip() for file in files if (file.parent / uri.strip()).exists()), None)
    name = unquote(f"{parts.netloc}{parts.path}")
    name = name if parts.scheme == "file" else name.lstrip("/")
    folders = [Path(folder) for variable in SEARCHED for folder in os.environ.get(variable, "").split(os.pathsep) if folder]
    for file in files:
        folders += [part for above in file.resolve().parents[: _LEVELS + 1] for part in (above, above / "models")]
    folders += [Path(prefix, "share") for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    return next((folder / name for folder in folders if (folder / name).exists()), None)


def _downloaded(host: str, path: str) -> Path | None:
    """Return where Gazebo keeps a model from its library, the newest version."""
    found = re.fullmatch(r"/(?:[\d.]+/)?([^/]+)/models/([^/]+)(?:/[^/]+)?/?", path)
    caches = [os.environ.get("GZ_FUEL_CACHE_PATH", ""), Path.home() / ".gz" / "fuel", Path.home() / ".ignition" / "fuel"]
    for cache in filter(None, caches if found else ()):
        folder = Path(cache, host, found[1].lower(), "models", found[2].lower()) if found else Path()
        versions = [part for part in folder.glob("*") if part.name.isdecimal()]
        if versions:
            return max(versions, key=lambda part: int(part.name))
    return None


def _sdf_in(folder: Path) -> Path:
    """Return the SDF file of a model's folder: of those in its ``model.config`` that of the newest version."""
    config = folder / "model.config"
    files = parse(config).getroot().findall("sdf") if config.is_file() else []
    versions = [
        (tuple(int(part) for part in file.get("version", "1.0").split(".") if part.isdecimal()), (file.text or "").strip())
        for file in files
    ]
    known = sorted(pair for pair in versions if pair[0] <= _NEWEST)
    return folder / (known[-1][1] if known else "model.sdf")


def _is_static(model: Element) -> bool:
    if model.findtext("static", "0").strip().lower() in ("1", "true"):
        return True
    nested = model.findall("model")
    return bool(nested) and not model.findall("link") and all(map(_is_static, nested))


def _drives(model: Element) -> bool:
    """Return whether a model is a robot: it has a plugin for driving, or wheels that turn."""
    plugins = (f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower() for plugin in model.iter("plugin"))
    if any(word in text for text in plugins for word in _DRIVES):
        return True
    turning = (joint for joint in model.iter("joint") if joint.get("type") in ("revolute", "continuous"))
    return any("wheel" in joint.get("name", "").lower() for joint in turning)


def _collisions(model: Element, pose: NDArray[np.float64]) -> Iterator[Collision]:
    """Yield the collisions of a model, whose pose in the world is given, and of the models in it."""
    for link in model.findall("link"):
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            if geometry is not None:
                base, own = _pose_of(collision)
                yield Collision(pose @ (_frame(model, base) if base else _pose_in(model, link)) @ own, geometry)
    for nested in model.findall("model"):
        yield from _collisions(nested, pose @ _pose_in(model, nested))


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


def _pose_of(element: Element) -> tuple[str, NDArray[np.float64]]:
    """Return the frame to which an element's pose is relative, empty for the default, and the pose, shape (4, 4)."""
    pose = element.find("pose")
    if pose is None:
        return "", np.eye(4)
    numbers = numbers_of(pose.text, 6, (0.0,) * 6)
    in_degrees = pose.get("degrees", "false").strip().lower() in ("1", "true")
    roll, pitch, yaw = np.radians(numbers[3:]) if in_degrees else numbers[3:]
    matrix = euler_matrix(roll, pitch, yaw)
    matrix[:3, 3] = numbers[:3]
    return pose.get("relative_to", pose.get("frame", "")).strip(), matrix


def _pose_in(parent: Element, child: Element, depth: int = 0) -> NDArray[np.float64]:
    """Return the pose of a link, frame, joint or model in the model or world that holds it, shape (4, 4)."""
    if depth > _DEEPEST:
        raise MalformedError(f"the frame {child.get('name', '')!r} is relative to itself")
    base, own = _pose_of(child)
    default = child.get("attached_to", "") if child.tag == "frame" else ""
    default = child.findtext("child", "").strip() if child.tag == "joint" else default
    return _frame(parent, base or default, depth + 1) @ own


def _frame(parent: Element, name: str, depth: int = 0) -> NDArray[np.float64]:
    """Return the pose of a frame in a model or world, shape (4, 4), by its name."""
    if name in _ORIGIN:
        return np.eye(4)
    first, _, rest = name.partition("::")
    for child in parent:
        if child.tag in _FRAMES and child.get("name") == first:
            return _pose_in(parent, child, depth) @ _frame(child, rest, depth)
    raise MalformedError(f"there is no frame {name!r}")
