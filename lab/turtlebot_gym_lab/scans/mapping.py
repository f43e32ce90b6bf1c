"""A map from one drive with odometry and scans, for the localizer and for ROS's ``map_server``."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.drive import Drive
from turtlebot_gym.localization.points import Timing
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.rooms.grid import FREE, MAX_CELLS, OCCUPIED, UNKNOWN, GridMap
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.evaluation.localize import beams_of, clocked, recorded_of
from turtlebot_gym_lab.scans.fusing import chart

Array = NDArray[np.float64]

TUNING = LocalizerTuning(deviation=0.01, deviation_share=0.01, scale=0.0, grain=0.02, thin=2.0, iterations=10)
"""How scans are matched with the map so far."""
SEEN = 3.0
"""Least number of beams through a cell of the map."""
MARGIN = 1.0
"""Width of the border around what beams reach at first, m."""
LOST = 0.1
"""Share of scans that fit nothing from which there is no map."""


class DrivenMap(NamedTuple):
    """A map from a drive."""

    grid: GridMap
    """Its origin is where the drive starts, the x axis its first heading."""
    poses: Array
    """Pose at each scan's row, shape (S, 3); m, m, rad."""
    fits: Array
    """Share of each scan's beams on known ground that fit, shape (S,)."""
    fused: int
    """Number of scans that were averaged."""


def map_of(drive: Drive, *, resolution: float = 0.05, progress: Callable[[str], None] = lambda done: None) -> DrivenMap:
    """Return the map of a drive.

    Args:
        drive: With odometry and scans.
        resolution: Side of a cell, m.
        progress: Called with the name of each finished part.

    Raises:
        ValueError: If the drive has no odometry or no scans, or too few of its scans fit one another.
    """
    scans = clocked(recorded_of(drive))
    path, ranges = scans.odometry, scans.ranges
    timing = Timing(0.0, scans.interval, *scans.mount, scans.range_max)
    frame, shape = _extent(path, ranges, scans.range_max, resolution)
    poses, fits = np.zeros((len(ranges), 3)), np.zeros(len(ranges))
    inputs = (scans.time, path, scans.rows, scans.last, ranges, beams_of(scans), timing, frame, as_tuple(TUNING))

    def draw(known: NDArray[np.float32] | None, is_placed: bool) -> tuple[NDArray[np.float32], NDArray[np.float32], int]:
        field, weights = np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
        fused = chart(*inputs, field if known is None else known, is_placed, field, weights, poses, fits)
        progress("map")
        return field, weights, fused

    whole, _, _ = draw(None, False)
    draw(whole, False)  # while the map is small it moves with each scan: the poses are those in the whole map ...
    lost = float((fits == 0.0).mean())
    if lost > LOST:
        raise ValueError(
            f"{drive.around.label or 'the drive'}: {100.0 * lost:.0f} % of the scans do not fit the map of those before them: "
            "drive slower, and where walls are within the LiDAR's range."
        )
    begun = compose(inverse(path[:1]), path[scans.rows[:1]])  # ... and the first one is where the wheels say
    poses = compose(compose(begun, inverse(poses[:1])), poses)
    poses[:, 2] = wrap_all(poses[:, 2])
    field, weights, fused = draw(None, True)
    return DrivenMap(_grid(field, weights, frame), poses, fits, fused)


def compose(first: Array, second: Array) -> Array:
    """Return the poses of frames within frames, shape (n, 3)."""
    cosine, sine = np.cos(first[..., 2]), np.sin(first[..., 2])
    x = first[..., 0] + cosine * second[..., 0] - sine * second[..., 1]
    y = first[..., 1] + sine * second[..., 0] + cosine * second[..., 1]
    return np.stack([x, y, first[..., 2] + second[..., 2]], axis=-1)


def inverse(pose: Array) -> Array:
    """Return the pose of the outer frame in the inner one, shape (..., 3)."""
    cosine, sine = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = -cosine * pose[..., 0] - sine * pose[..., 1], sine * pose[..., 0] - cosine * pose[..., 1]
    return np.stack([x, y, -pose[..., 2]], axis=-1)


def _extent(path: Array, ranges: NDArray[np.float32], reach: float, side: float) -> tuple[Array, tuple[int, int]]:
    """Return the frame and the shape of a field that holds all that beams reach from a path, where it begins at the origin."""
    places = compose(inverse(path[:1]), path)[:, :2]
    good = ranges[(ranges > 0.0) & (ranges <= reach)]
    around = float(np.quantile(good, 0.999)) + MARGIN if len(good) else MARGIN
    low, high = places.min(axis=0) - around, places.max(axis=0) + around
    low = np.floor(low / side) * side
    columns, rows = np.ceil((high - low) / side).astype(int).tolist()
    if rows * columns > MAX_CELLS:
        raise ValueError(f"the map would have {rows:,} x {columns:,} cells, more than {MAX_CELLS:,}: choose larger cells.")
    return np.array([*low, 1.0, 0.0, side]), (rows, columns)


def _grid(field: NDArray[np.float32], weights: NDArray[np.float32], frame: Array) -> GridMap:
    """Return the cells of a field: a surface is where the distance changes its sign, in the cell that is nearer to it."""
    distance = np.where(weights >= SEEN, field, np.nan)
    occupied = np.zeros(field.shape, np.bool_)
    for axis in (0, 1):
        for shift in (-1, 1):
            beside = np.roll(distance, shift, axis)
            with np.errstate(invalid="ignore"):
                occupied |= (distance * beside <= 0.0) & (np.abs(distance) <= np.abs(beside))
    cells = np.full(field.shape, UNKNOWN, np.int8)
    cells[distance > 0.0] = FREE
    cells[occupied] = OCCUPIED
    rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    x, y, _, _, side = frame.tolist()
    return GridMap(
        cells=cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1],
        resolution=side,
        origin=Pose(round(x + columns[0] * side, 9), round(y + rows[0] * side, 9), 0.0),
    )
