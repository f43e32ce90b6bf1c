"""Write maps for ROS's ``map_server``: a YAML file and an image beside it, as `maps.read_map` and Nav2 read them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from turtlebot_gym.files import replacing, write_text
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap

SHADES = {FREE: 254, OCCUPIED: 0}
"""Greys of Nav2's map saver ..."""
UNKNOWN_SHADE = 205
"""... and that of all other cells."""


def write_map(grid: GridMap, path: str | Path, *, force: bool = False) -> Path:
    """Write a map, and return the path of its image: the same name with the suffix ``.pgm``.

    Args:
        grid: The map.
        path: Its YAML file.
        force: Overwrite an image that exists.

    Raises:
        ValueError: If the image exists and is not to be overwritten.
    """
    path = Path(path)
    image = path.with_suffix(".pgm")
    if image.exists() and not force:
        raise ValueError(f"{image} exists: name another map, or overwrite it with --force.")
    shades = np.full(grid.cells.shape, UNKNOWN_SHADE, np.uint8)
    for value, shade in SHADES.items():
        shades[grid.cells == value] = shade
    rows, columns = grid.cells.shape[:2]
    with replacing(image) as beside:
        beside.write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + shades[::-1].tobytes())
    x, y, theta = grid.origin
    lines = (
        f"image: {image.name}",
        "mode: trinary",
        f"resolution: {grid.resolution!r}",
        f"origin: [{x!r}, {y!r}, {theta!r}]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    )
    write_text(path, "\n".join(lines) + "\n")
    return image
