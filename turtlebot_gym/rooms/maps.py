"""Maps for ROS's ``map_server``: a YAML file and its image, read as Nav2's server reads them.

References:
    Nav2, ``nav2_map_server/src/map_io.cpp``, ``loadMapFromFile``, ROS 2 Jazzy.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import FINITE, POSITIVE, PROBABILITY, Numbers, choose, refusal
from turtlebot_gym.files import load
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, UNKNOWN, GridMap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose

FAR_ENOUGH = 6.0
"""Greatest distance between a drawn start and goal along each axis, m; a Burger drives 13 m in an episode."""
UNEXPLORED = 205
"""Grey by which map savers of ROS 1 and ROS 2 mark unexplored cells in the mode "trinary"."""
_UNEXPLORED_SHARE = 0.196
"""Occupancy of that grey, 50 / 255, as map savers of ROS 1 write it: from a greater ``free_thresh`` on it is free."""
_NEEDED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


def read_map(path: str | Path) -> FloorPlan:
    """Read a map as a floor plan: its YAML file, whose image is beside it or has an absolute path.

    Raises:
        ValueError: If a file cannot be read or is invalid.

    Warns:
        UserWarning: If thresholds make unexplored cells free. Here they are unknown: as free ones they stop neither the robot
            nor beams, but no start, goal or path is there, and a lost robot is not searched for there.
    """
    path, of_map = Path(path), f"of the map {str(path)!r}"
    content = _read_yaml(path)
    free, occupied = (PROBABILITY.check(f"{name} {of_map}", content[name]) for name in ("free_thresh", "occupied_thresh"))
    if not free <= occupied:
        raise ValueError(f"free_thresh {of_map} must be at most occupied_thresh, got {free:g} and {occupied:g}.")
    if content["negate"] not in (0, 1):
        raise refusal(f"negate {of_map}", "0 or 1", content["negate"])
    choose(f"mode {of_map}", content.get("mode", "trinary"), {"trinary": None})
    resolution = POSITIVE.check(f"resolution {of_map}", content["resolution"])
    origin = Pose(*Numbers(FINITE, 3).check(f"origin {of_map}", content["origin"]))
    shades, greys = _shades(path.parent / str(content["image"]))
    occupancy, brightness = (shades, 1.0 - greys) if content["negate"] else (1.0 - shades, greys)
    cells = np.where(occupancy > occupied, OCCUPIED, np.where(occupancy < free, FREE, UNKNOWN)).astype(np.int8)
    is_unexplored = (np.rint(255.0 * brightness) == UNEXPLORED) & (cells == FREE)
    cells[is_unexplored] = UNKNOWN
    try:
        grid = GridMap(cells=cells[::-1], resolution=resolution, origin=origin)
    except ValueError as error:
        raise ValueError(f"The map {str(path)!r} cannot be used: {error}") from error
    if is_unexplored.any():
        remedy = "free_thresh: 0.196" if free > _UNEXPLORED_SHARE else "an image without transparency"
        text = f"free_thresh {free:g} makes unexplored cells (grey, {UNEXPLORED}) free ({is_unexplored.sum():,})"
        text = f"{text}: no start, goal or path is there, nor a lost robot; {remedy} makes them unknown for Nav2, too."
        warnings.warn(f"{path.name}: {text}", stacklevel=2)
    return FloorPlan(walls=grid.walls(), map=grid, max_distance=FAR_ENOUGH)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = load(path)
    except (OSError, ValueError) as error:
        raise ValueError(f"{str(path)!r} is not a map: {error}") from error
    missing = _NEEDED if not isinstance(content, dict) else [name for name in _NEEDED if name not in content]
    if missing:
        raise ValueError(f"The map {str(path)!r} must state {', '.join(missing)}.")
    return content


def _shades(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the mean of each pixel's channels, and that of its colours, as shares; the first row is the highest.

    Transparency is a channel, as for ``map_server``.
    """
    from PIL import Image  # a robot reads no maps

    try:
        with Image.open(path) as image:
            if image.mode.startswith("I"):  # 16 bits
                deep = np.asarray(image, np.float32) / 65535
                return deep, deep
            pixels = np.asarray(image.convert("RGBA"))
            has_alpha = image.mode in ("LA", "PA", "RGBA") or "transparency" in image.info
    except FileNotFoundError as error:
        raise ValueError(f"There is no image {str(path)!r} for the map.") from error
    except Exception as error:  # a decoder raises errors of many kinds
        raise ValueError(f"The map's image {str(path)!r} cannot be read: {' '.join(str(error).split())}.") from error
    greys = pixels[:, :, :3].sum(axis=2, dtype=np.float32) / 765
    return (pixels.sum(axis=2, dtype=np.float32) / 1020 if has_alpha else greys), greys
