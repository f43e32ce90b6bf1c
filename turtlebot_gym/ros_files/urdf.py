"""A robot's wheels, footprint and LiDAR from its URDF."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.files import in_bounds, read_text
from turtlebot_gym.mounts import TILT
from turtlebot_gym.resources import find_resource
from turtlebot_gym.robots import LidarMount
from turtlebot_gym.ros_files.footprints import enclosing_circle
from turtlebot_gym.transforms import MalformedError, from_rpy, numbers_of

_XACRO = re.compile(r"\{[^}]*/xacro\}")
"""Beginning of the tags of xacro, whose namespace has several addresses."""
_REMEDY = "it is a xacro file; make a URDF of it, xacro FILE > robot.urdf, and give that"
_LIDARS = ("base_scan", "rplidar_link", "laser", "lidar", "scan", "hokuyo", "sick", "velodyne", "lds")
_BASES = ("base_footprint", "base_link")
_SIDES = 48


class _Tree(NamedTuple):
    """The links of a robot."""

    links: dict[str, Element]
    joints: dict[str, Element]
    """The joint above each link, by the link's name."""
    poses: dict[str, NDArray[np.float64]]
    """Of each link in the base, shape (4, 4)."""


@in_bounds
def read_urdf(path: Path) -> tuple[dict[str, Any], list[str], list[str]]:
    """Return fields of a `turtlebot_gym.Robot` from a URDF.

    Returns:
        The fields; what was taken; what was left out.

    Raises:
        ValueError: If the file cannot be read, or is a xacro file that computes something.
    """
    try:
        return _read(path)
    except MalformedError as error:
        raise ValueError(str(error)) from error


def _read(path: Path) -> tuple[dict[str, Any], list[str], list[str]]:
    tree = _tree(_parse(path))
    wheels = _wheels(tree)
    fields: dict[str, Any] = {}
    taken: list[str] = []
    left_out: list[str] = []
    axle = 0.0
    if wheels:
        places = np.array([tree.poses[name][:2, 3] for name in wheels])
        left, right = places[places[:, 1] > 0.0], places[places[:, 1] < 0.0]
        axle, separation = float(places[:, 0].mean()), round(float(left[:, 1].mean() - right[:, 1].mean()), 6)
        fields["wheel_separation"] = separation
        taken.append(f"wheel_separation {separation:g} ({', '.join(sorted(wheels))})")
        if radius := _wheel_radius(tree.links[wheels[0]]):
            speeds = [limit.get("velocity") for name in wheels for limit in tree.joints[name].findall("limit")]
            limits = [value for speed in speeds if speed and 0.0 < (value := numbers_of(speed, 1)[0]) < 1e3]
            taken.append(f"wheel radius {radius:g}")
            if limits:
                fields["max_wheel"] = min(limits) * radius
                taken.append(f"max_wheel {fields['max_wheel']:.4g} (the wheel joints' limit)")
        if abs(axle) > 1e-3:
            left_out.append(f"the base's origin, {-axle:.3g} m ahead of the axle: here the robot's frame is at the axle")
    else:
        left_out.append("wheels: no continuous joints on both sides turn about y")
    points, missing = _footprint_points(tree, path)
    left_out += missing
    if len(points):
        x, radius = enclosing_circle(points - (axle, 0.0))
        fields |= {"radius": radius, "footprint_x": x}
        taken.append(f"radius {radius:g} around x = {x:g} (collisions)")
    elif not missing:
        left_out.append("footprint: there are no collisions")
    _mount(tree, axle, fields, taken, left_out)
    if not fields:
        raise ValueError(f"it says nothing of a robot on two wheels: {'; '.join(left_out)}")
    return fields, taken, left_out


def _parse(path: Path) -> Element:
    try:
        text = read_text(path)
    except OSError as error:
        raise ValueError(f"there is no such file: {error.strerror}") from error
    if path.suffix == ".xacro":
        raise ValueError(_REMEDY)
    try:
        root = fromstring(_with_values(text))
    except (ParseError, LookupError, ValueError) as error:
        raise ValueError(f"it is no URDF: {error}") from error
    if root.tag != "robot":
        raise ValueError(f"it is no URDF: its root is <{root.tag}>, not <robot>")
    tags = {element.tag for element in root.iter()}
    computed = any(_XACRO.match(tag) and _XACRO.sub("", tag) not in ("arg", "property") for tag in tags)
    values = (value for element in root.iter() if not _XACRO.match(element.tag) for value in element.attrib.values())
    if computed or any("${" in value or "$(" in value for value in values):
        raise ValueError(_REMEDY)
    return root


def _with_values(text: str) -> str:
    """Return a text with the plain values of its xacro properties and arguments, such as an empty namespace."""
    values = dict(re.findall(r'<xacro:arg\s+name="([^"]*)"\s+default="([^"]*)"', text))
    for name, value in re.findall(r'<xacro:property\s+name="([^"]*)"\s+value="([^"]*)"', text):
        values[name] = re.sub(r"\$\(arg ([^)]*)\)", lambda found: values.get(found[1], found[0]), value)
    return re.sub(r"\$\{(\w+)\}|\$\(arg (\w+)\)", lambda found: values.get(found[1] or found[2], found[0]), text)


def _tree(root: Element) -> _Tree:
    links = {link.get("name", ""): link for link in root.findall("link")}
    joints = {child.get("link", ""): joint for joint in root.findall("joint") if (child := joint.find("child")) is not None}
    known: dict[str, NDArray[np.float64]] = {}

    def pose(name: str, depth: int = 0) -> NDArray[np.float64]:
        if name not in known:
            if depth > len(joints):
                raise MalformedError(f"the link {name!r} is above itself")
            joint = joints.get(name)
            parent = joint.find("parent") if joint is not None else None
            above = np.eye(4) if parent is None else pose(parent.get("link", ""), depth + 1)
            known[name] = above if joint is None else above @ _origin(joint)
        return known[name]

    for name in links:
        pose(name)
    base = next((name for end in _BASES for name in links if name.endswith(end)), None)
    origin = np.linalg.inv(known[base]) if base else np.eye(4)
    lidars = {sensor.get("reference", ""): sensor for sensor in root.findall("gazebo") if _has_lidar(sensor)}
    for name in lidars.keys() & links.keys():
        links[name].set("_lidar", "")
    return _Tree(links, joints, {name: origin @ matrix for name, matrix in known.items()})


def _has_lidar(element: Element) -> bool:
    return any(sensor.get("type") in ("ray", "gpu_ray", "lidar", "gpu_lidar") for sensor in element.iter("sensor"))


def _origin(element: Element) -> NDArray[np.float64]:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return from_rpy(numbers_of(origin.get("xyz"), 3, (0.0,) * 3), numbers_of(origin.get("rpy"), 3, (0.0,) * 3))


def _wheels(tree: _Tree) -> list[str]:
    """Return the links of the wheels that drive: they turn about y without end, on both sides; no casters."""
    found = []
    for name, joint in tree.joints.items():
        named = f"{name} {joint.get('name', '')}".lower()
        if joint.get("type") != "continuous" or "caster" in named or name not in tree.poses:
            continue
        axis = joint.find("axis")
        way = numbers_of(axis.get("xyz") if axis is not None else None, 3, (1.0, 0.0, 0.0))
        if abs((tree.poses[name][:3, :3] @ way)[1]) > 0.9 * math.hypot(*way) > 0.0 and abs(tree.poses[name][1, 3]) > 1e-3:
            found.append(name)
    sides = {tree.poses[name][1, 3] > 0.0 for name in found}
    return found if len(sides) == 2 else []


def _wheel_radius(link: Element) -> float | None:
    for part in ("collision", "visual"):
        for shape in (shape for geometry in link.findall(f"{part}/geometry") for shape in geometry):
            if shape.tag in ("cylinder", "sphere") and shape.get("radius"):
                return numbers_of(shape.get("radius"), 1)[0]
    return None


def _footprint_points(tree: _Tree, path: Path) -> tuple[NDArray[np.float64], list[str]]:
    """Return points around which the footprint is, x and y in the base, shape (n, 2); and what is missing."""
    points, missing = [np.empty((0, 3))], []
    for name, link in tree.links.items():
        for collision in link.findall("collision"):
            pose = tree.poses[name] @ _origin(collision)
            for shape in (shape for geometry in collision.findall("geometry") for shape in geometry):
                try:
                    points.append(_points_of(shape, path) @ pose[:3, :3].T + pose[:3, 3])
                except (ImportError, FileNotFoundError) as error:
                    missing.append(f"the collision of {name}: {str(error).rstrip('.')}")
    return np.concatenate(points)[:, :2], missing


def _points_of(shape: Element, path: Path) -> NDArray[np.float64]:
    """Return points whose convex hull is a shape, shape (n, 3), m."""
    if shape.tag == "box":
        size = numbers_of(shape.get("size"), 3)
        return 0.5 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * size
    if shape.tag == "mesh":
        from turtlebot_gym.meshes import load_mesh

        name = shape.get("filename", "")
        found = find_resource(name, (path,))
        if found is None:
            raise FileNotFoundError(f"there is no mesh {name!r}")
        bodies = load_mesh(found, np.array(numbers_of(shape.get("scale"), 3, (1.0, 1.0, 1.0))))
        return np.concatenate([body.triangles.reshape(-1, 3) for body in bodies])
    radius = numbers_of(shape.get("radius"), 1)[0]
    half = 0.5 * numbers_of(shape.get("length"), 1, (0.0,))[0]
    angles = np.arange(_SIDES) * (2.0 * math.pi / _SIDES)
    ring = radius * np.column_stack((np.cos(angles), np.sin(angles), np.zeros(_SIDES)))
    if shape.tag == "cylinder":
        up = np.array((0.0, 0.0, half))
        return np.concatenate((ring - up, ring + up))
    return np.concatenate((ring, ring[:, [0, 2, 1]], ring[:, [2, 0, 1]]))


def _mount(tree: _Tree, axle: float, fields: dict[str, Any], taken: list[str], left_out: list[str]) -> None:
    """Note the mount of the LiDAR."""
    by_name = [name for part in _LIDARS for name in tree.links if part in name.lower()]
    found = [name for name in tree.links if "_lidar" in tree.links[name].attrib] or list(dict.fromkeys(by_name))
    if not found:
        left_out.append("a LiDAR: no link has the name of one")
        return
    name, matrix = found[0], tree.poses[found[0]]
    link = name
    while link in tree.joints:
        if tree.joints[link].get("type") != "fixed":
            left_out.append(f"the LiDAR {name}, which is on a joint that moves")
            return
        parent = tree.joints[link].find("parent")
        link = parent.get("link", "") if parent is not None else ""
    if matrix[2, 2] < math.cos(TILT):
        left_out.append(f"the LiDAR {name}, which is tilted or upside down")
        return
    x, y, yaw = round(float(matrix[0, 3]) - axle, 6), round(float(matrix[1, 3]), 6), math.atan2(matrix[1, 0], matrix[0, 0])
    fields["lidar"] = LidarMount(frame=name, x=x, y=y, yaw=round(yaw, 6))
    taken.append(f"LiDAR {name} at x = {x:g}, y = {y:g}, yaw = {yaw:.4g}")
    if len(found) > 1:
        left_out.append(f"other LiDARs: {', '.join(found[1:])}")
