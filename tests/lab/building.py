"""A recorded building: its drive from the first key frame on, its reference poses, and a map drawn from them."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.rooms.field import field_of_hits
from turtlebot_gym.rooms.grid import BESIDE
from turtlebot_gym_lab.evaluation.localize import FAR, RecordedScans

HIT = 0.25
"""Least share of the beams through a cell that end in it where it is occupied."""


class Building(NamedTuple):
    """A recording with reference poses at some rows."""

    recorded: RecordedScans
    rows: NDArray[np.intp]
    """Rows of the key frames, shape (K,)."""
    reference: NDArray[np.float64]
    """Shape (K, 3); m, m, rad."""


class Chart(NamedTuple):
    """A map as the localizer uses it, see `rooms.field`."""

    field: NDArray[np.float32]
    frame: NDArray[np.float64]


def load(path: Path) -> Building:
    """Return a building from a NumPy archive, from its first key frame on."""
    with np.load(path) as log:
        ranges, odometry, stamps = log["ranges_cm"].astype(np.float32) / 100.0, log["odometry"], log["time"]
        rows, reference = log["reference_row"].astype(np.intp), log["reference"]
    first, angles = rows[0], np.radians(np.arange(ranges.shape[1]) - 90.0)
    odometry, ranges, stamps = odometry[first:], ranges[first:], stamps[first:]
    recorded = RecordedScans(stamps, odometry, np.arange(len(odometry)), stamps, ranges, angles)
    return Building(recorded, rows - first, reference)


def chart(building: Building, cell: float) -> Chart:
    """Return the map of the key frames: occupied is where at least `HIT` of the beams through a cell end."""
    poses, ranges = building.reference, building.recorded.ranges[building.rows].astype(np.float64)
    corner = poses[:, :2].min(axis=0) - FAR - 1.0
    columns, rows = ((poses[:, :2].max(axis=0) + FAR + 1.0 - corner) / cell).astype(int) + 1
    hits, passed = np.zeros(rows * columns, np.int64), np.zeros(rows * columns, np.int64)

    def cells_at(pose: Any, directions: Any, distance: Any) -> Any:
        x, y = pose[0] + np.cos(directions) * distance - corner[0], pose[1] + np.sin(directions) * distance - corner[1]
        return (y / cell).astype(int) * columns + (x / cell).astype(int)

    along = np.arange(int(FAR / cell)) * cell
    for pose, lengths in zip(poses, ranges, strict=True):
        valid = (lengths > 0.05) & (lengths < FAR)
        lengths, directions = lengths[valid], pose[2] + building.recorded.angles[valid]
        through = cells_at(pose, directions[:, None], along)[along < lengths[:, None] - 0.1]
        np.add.at(passed, through, 1)
        np.add.at(hits, cells_at(pose, directions, lengths), 1)
    occupied, field = ((hits > 0) & (hits >= HIT * passed)).reshape(rows, columns), np.empty((rows, columns), np.float32)
    field_of_hits(occupied, cell, field)
    field[(passed.reshape(rows, columns) == 0) & (field > BESIDE)] = np.nan
    return Chart(field, np.array([*corner, 1.0, 0.0, cell]))
