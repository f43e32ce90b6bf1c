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
from turtlebot_gym.rooms.grid import CUT, FREE, MAX_CELLS, OCCUPIED, UNKNOWN, GridMap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose

FAR_ENOUGH = 6.0
"""Greatest distance between a drawn start and goal along each axis, m; a Burger drives 13 m in an episode."""
UNEXPLORED = 205
"""Grey by which map savers of ROS 1 and ROS 2 mark unexplored cells in the mode "trinary"."""
_UNEXPLORED_SHARE = 0.196
"""Occupancy of that grey, 50 / 255, as map savers of ROS 1 write it: from a greater ``free_thresh`` on it is free."""
_MODES = {mode: mode for mode in ("trinary", "scale")}
_NEEDED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


def read_map(path: str | Path, *, start: Pose | None = None, goal: Pose | None = None) -> FloorPlan:
    """Read a map as a floor plan.

    Args:
        path: The YAML file, whose image is beside it or has an absolute path.
        start: Start pose of the robot; None to draw it in free cells.
        goal: Goal pose of the robot; None to draw it in free cells near the start.

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
    mode = choose(f"mode {of_map}", content.get("mode", "trinary"), _MODES)
    resolution = POSITIVE.check(f"resolution {of_map}", content["resolution"])
    pose = Pose(*Numbers(FINITE, 3).check(f"origin {of_map}", content["origin"]))
    negate = bool(content["negate"])
    cells, unexplored = _read_image(path.parent / str(content["image"]), mode, negate=negate, occupied=occupied, free=free)
    try:
        grid = GridMap(cells=cells[::-1], resolution=resolution, origin=pose)
    except ValueError as error:
        raise ValueError(f"The map {str(path)!r} cannot be used: {error}") from error
    if unexplored:
        remedy = "free_thresh: 0.196" if free > _UNEXPLORED_SHARE else "an image without transparency"
        text = f"free_thresh {free:g} makes unexplored cells (grey, {UNEXPLORED}) free ({unexplored:,}): no start, goal or path"
        warnings.warn(
            f"{path.name}: {text} is there, nor a lost robot; {remedy} makes them unknown for Nav2, too.", stacklevel=2
        )
    return FloorPlan(walls=grid.walls(), map=grid, start=start, goal=goal, max_distance=FAR_ENOUGH)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = load(path)
    except OSError as error:
        raise ValueError(f"There is no map {str(path)!r}: {error.strerror}.") from error
    except ValueError as error:
        raise ValueError(f"{str(path)!r} is not a map: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{str(path)!r} is not a map: it must state {', '.join(_NEEDED)}.")
    if missing := [name for name in _NEEDED if name not in content]:
        raise ValueError(f"The map {str(path)!r} must state {', '.join(missing)}.")
    return content


def _read_image(path: Path, mode: str, **limits: Any) -> tuple[NDArray[np.int8], int]:
    """Return the values of an image's cells, see `_cells_of`."""
    try:
        from PIL import Image  # a dependency of matplotlib; a robot reads no maps
    except ImportError as error:
        raise ImportError("Maps need Pillow: pip install pillow") from error
    try:
        with warnings.catch_warnings():  # of large images, which are refused here
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(path)
        with image:
            if image.width * image.height > MAX_CELLS:  # before it is unpacked
                raise ValueError(f"it has {image.width} x {image.height} pixels, more than {MAX_CELLS:,}: {CUT}")
            return _cells_of(image, mode, **limits)
    except FileNotFoundError as error:
        raise ValueError(f"There is no image {str(path)!r} for the map.") from error
    except Exception as error:  # a decoder raises errors of many kinds
        raise ValueError(f"The map's image {str(path)!r} cannot be read: {' '.join(str(error).split())}.") from error


def _cells_of(image: Any, mode: str, *, negate: bool, occupied: float, free: float) -> tuple[NDArray[np.int8], int]:
    """Return the values of cells, the first row being the highest, and how many unexplored ones the thresholds make free.

    Those are unknown. In the mode "trinary" transparency is averaged with the colours, as ``map_server`` does.
    """
    is_deep = image.mode.startswith("I")  # 16 bits
    alpha = not is_deep and (image.mode in ("LA", "PA", "RGBA") or "transparency" in image.info)
    if is_deep:
        pixels = greys = np.clip(np.asarray(image), 0, 65535).astype(np.uint16)
        most_grey = 65535
    else:
        pixels = np.asarray(image.convert("RGBA" if alpha else "RGB"))
        greys, most_grey = pixels[:, :, :3].sum(axis=2, dtype=np.uint16), 765
    sums, most = (greys + pixels[:, :, 3], 1020) if alpha and mode == "trinary" else (greys, most_grey)
    shade = np.arange(most + 1) / most  # there are fewer sums of channels than pixels
    occupancy = shade if negate else 1.0 - shade
    between = np.rint((occupancy - free) / max(occupied - free, 1e-9) * 100.0) if mode == "scale" else float(UNKNOWN)
    cells = np.where(occupancy > occupied, OCCUPIED, np.where(occupancy < free, FREE, between)).astype(np.int8)[sums]
    if mode == "scale":  # there a grey is a probability
        if alpha:
            cells[pixels[:, :, 3] < 255] = UNKNOWN
        return cells, 0
    off = 3.0 if image.format in ("JPEG", "WEBP") else 0.6  # these formats change greys
    shade = np.arange(most_grey + 1) / most_grey
    wrong = (np.abs((1.0 - shade if negate else shade) * 255.0 - UNEXPLORED) <= off)[greys] & (cells == FREE)
    cells[wrong] = UNKNOWN
    return cells, int(wrong.sum())
