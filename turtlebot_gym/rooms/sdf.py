"""SDF files: models, those that they include, and the poses of their collisions in the world.

References:
    SDFormat 1.12, *Pose frame semantics*; libsdformat 14, ``src/parser.cc``: the file that a ``model.config`` names, and what
    ``<include>`` overrides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError, parse

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.mounts import from_quaternion
from turtlebot_gym.resources import find_resource
from turtlebot_gym.transforms import MalformedError, from_rpy, numbers_of

_DEEPEST = 20
"""Most models that are in one another, or include one another."""
_NEWEST = (1, 12)
"""Newest version of SDF that is chosen in a ``model.config``."""
_NO_OBSTACLES = ("ground plane", "sun")
_DRIVES = ("diff_drive", "diffdrive", "diff-drive", "skid", "ackermann", "mecanum", "omni", "planar_move", "planarmove")
_FILE, _MERGED = "_file", "_merged"
_ORIGIN = ("", "__model__", "__root__", "world")


class Collision(NamedTuple):
    """A collision of a model."""

    name: str
    """Names of model, link and collision."""
    pose: NDArray[np.float64]
    """In the world, shape (4, 4)."""
    geometry: Element
    files: tuple[Path, ...]
    """The file that states it, and those that include that one."""


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
    root, missing = _parse(path), []
    _expand(root, (path,), missing)
    world = root.find("world")
    world = root if world is None else world
    _apply_state(world)
    result = SdfWorld([], [], [], missing, [actor.get("name", "") for actor in world.findall("actor")])
    scope = _Scope(world)
    for model in world.findall("model"):
        name = model.get("name", "")
        if not _is_static(model) and _drives(model):
            result.robots.append(name)
            continue
        found = list(_collisions(model, scope.pose(name, model), scope.nested[id(model)], (path,), name))
        if found and not _is_static(model):
            result.movable.append(name)
        result.collisions.extend(found)
    return result


def _parse(path: Path) -> Element:
    try:
        return parse(path).getroot()
    except OSError as error:
        raise ValueError(f"There is no Gazebo world {str(path)!r}: {error.strerror}.") from error
    except (ParseError, LookupError, ValueError) as error:  # the last two: an encoding that is unknown
        raise ValueError(f"{str(path)!r} is not a Gazebo world: {error}.") from error


def _expand(parent: Element, files: tuple[Path, ...], missing: list[str], depth: int = 0) -> None:
    """Put the models that are included in the place of their ``<include>``, with what it overrides."""
    if depth > _DEEPEST:
        raise ValueError(f"{str(files[-1])!r} holds models that are nested, or include themselves, more than {_DEEPEST} deep.")
    for at, child in enumerate(list(parent)):
        if child.tag == "include":
            model = _included(child, files, missing, depth)
            parent[at] = model
        elif child.tag in ("world", "model", "population"):
            _expand(child, files, missing, depth + 1)


def _included(include: Element, files: tuple[Path, ...], missing: list[str], depth: int) -> Element:
    uri = include.findtext("uri", "").strip()
    found = find_resource(uri, files)
    path = _sdf_in(found) if found is not None and found.is_dir() else found
    name = uri.rstrip("/").rpartition("/")[2].replace("_", " ").lower()
    if path is None or not path.is_file():
        if name not in _NO_OBSTACLES:
            missing.append(uri)
        return Element("include")
    model = _parse(path).find("model")
    if model is None:
        return Element("include")  # a light, or an actor
    model.set(_FILE, str(path))
    if include.get("merge", "false").lower() in ("1", "true"):
        model.set(_MERGED, "")
    _expand(model, (path, *files), missing, depth + 1)
    for tag in ("pose", "static", "placement_frame"):
        given = include.find(tag)
        if given is None:
            continue
        if tag == "placement_frame":
            model.set(tag, (given.text or "").strip())
            continue
        for old in model.findall(tag):
            model.remove(old)
        model.append(given)
    model.set("name", include.findtext("name", model.get("name", "")).strip())
    return model


def _sdf_in(folder: Path) -> Path:
    """Return the SDF file of a model's folder: of those in its ``model.config`` that of the newest version."""
    config = next((folder / name for name in ("model.config", "manifest.xml") if (folder / name).is_file()), None)
    files = _parse(config).findall("sdf") if config else []
    versions = [(_version(file.get("version", "1.0")), (file.text or "").strip()) for file in files]
    known = sorted(pair for pair in versions if pair[0] <= _NEWEST)
    return folder / (known[-1][1] if known else "model.sdf")


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.strip().split(".") if part.isdecimal())


def _apply_state(world: Element) -> None:
    """Move models to where classic Gazebo left them when the world was saved."""
    for state in world.findall("state"):
        poses = {model.get("name"): model.find("pose") for model in state.findall("model")}
        for model in world.findall("model"):
            pose = poses.get(model.get("name"))
            if pose is not None:
                for old in model.findall("pose"):
                    model.remove(old)
                model.append(pose)


def _is_static(model: Element) -> bool:
    return model.findtext("static", "0").strip().lower() in ("1", "true") or (
        bool(nested := model.findall("model")) and not model.findall("link") and all(map(_is_static, nested))
    )


def _drives(model: Element) -> bool:
    """Return whether a model is a robot: it has a plugin for driving, or wheels that turn."""
    plugins = (f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower() for plugin in model.iter("plugin"))
    if any(word in text for text in plugins for word in _DRIVES):
        return True
    turning = (joint for joint in model.iter("joint") if joint.get("type") in ("revolute", "continuous"))
    return any("wheel" in joint.get("name", "").lower() for joint in turning)


def _collisions(
    model: Element, pose: NDArray[np.float64], scope: _Scope, files: tuple[Path, ...], name: str
) -> Iterator[Collision]:
    """Yield the collisions of a model, whose pose in the world is given, and of the models in it."""
    files = (Path(model.get(_FILE, "")), *files) if _FILE in model.attrib else files
    for link in model.findall("link"):
        at = scope.pose(link.get("name", ""), link)
        for collision in link.findall("collision"):
            geometry = collision.find("geometry")
            if geometry is not None:
                base, own = _pose(collision)
                base_pose = at if base is None else scope.find(base)
                full = f"{name}::{link.get('name', '')}::{collision.get('name', '')}"
                yield Collision(full, pose @ base_pose @ own, geometry, files)
    for nested in model.findall("model"):
        inner = f"{name}::{nested.get('name', '')}"
        yield from _collisions(
            nested, pose @ scope.pose(nested.get("name", ""), nested), scope.nested[id(nested)], files, inner
        )


def _pose(element: Element) -> tuple[str | None, NDArray[np.float64]]:
    """Return the frame to which an element's pose is relative, None for the default, and the pose."""
    pose = element.find("pose")
    if pose is None:
        return None, np.eye(4)
    base = pose.get("relative_to", pose.get("frame", "")) or None
    if pose.get("rotation_format") == "quat_xyzw":
        numbers = numbers_of(pose.text, 7, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
        return base, from_quaternion(numbers[:3], numbers[3:])
    numbers = numbers_of(pose.text, 6, (0.0,) * 6)
    in_degrees = pose.get("degrees", "false").strip().lower() in ("1", "true")
    angles = [math.radians(angle) if in_degrees else angle for angle in numbers[3:]]
    return base, from_rpy(numbers[:3], angles)


class _Scope:
    """The frames of a model or a world by their names."""

    def __init__(self, element: Element) -> None:
        self._elements: dict[str, Element] = {}
        self._known: dict[int, NDArray[np.float64]] = {}
        self._sought: set[int] = set()
        self.model = element
        self._merged: list[_Scope] = []
        self.nested: dict[int, _Scope] = {}
        for child in element:
            if child.tag in ("link", "frame", "joint", "model"):
                self._elements.setdefault(child.get("name", ""), child)
            if child.tag == "model":
                self.nested[id(child)] = _Scope(child)
                if _MERGED in child.attrib:
                    self._merged.append(self.nested[id(child)])

    def find(self, name: str) -> NDArray[np.float64]:
        """Return the pose of a frame, shape (4, 4), in this model or world.

        Raises:
            MalformedError: If there is no such frame, or it is relative to itself.
        """
        if name in _ORIGIN:
            return np.eye(4)
        if name in self._elements:
            return self.pose(name, self._elements[name])
        first, _, rest = name.partition("::")
        if rest and first in self._elements and id(self._elements[first]) in self.nested:
            return self.find(first) @ self.nested[id(self._elements[first])].find(rest)
        for merged in self._merged:
            if name in merged._elements:
                return self.pose("", merged.model) @ merged.find(name)
        raise MalformedError(f"there is no frame {name!r}")

    def pose(self, name: str, element: Element) -> NDArray[np.float64]:
        """Return the pose of a link, frame, joint or model in this model or world."""
        if id(element) in self._known:
            return self._known[id(element)]
        if id(element) in self._sought:
            raise MalformedError(f"the frame {name!r} is relative to itself")
        self._sought.add(id(element))
        base, own = _pose(element)
        default = element.get("attached_to", "") if element.tag == "frame" else ""
        default = element.findtext("child", "").strip() if element.tag == "joint" else default
        matrix = self.find(default if base is None else base) @ own
        placed = element.get("placement_frame") if element.tag == "model" else None
        if placed:
            matrix = matrix @ np.linalg.inv(self.nested[id(element)].find(placed))
        self._known[id(element)] = matrix
        return matrix
