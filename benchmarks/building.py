"""Recorded buildings: their drives, maps drawn from reference poses, and what a localizer would see in other conditions."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.rooms.field import field_of_hits
from turtlebot_gym.rooms.grid import BESIDE
from turtlebot_gym_lab.evaluation.localize import FAR, RecordedScans

HIT = 0.25
"""Least share of the beams through a cell that end in it where it is occupied."""
BLOCK, STAY = 9, 5
"""Number of beams that a person hides, and of rows for which people stay."""


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


def chart(building: Building, cell: float, frames: slice = slice(None)) -> Chart:
    """Return the map of some key frames: occupied is where at least `HIT` of the beams through a cell end."""
    poses, ranges = building.reference[frames], building.recorded.ranges[building.rows[frames]].astype(np.float64)
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


def steps_of(odometry: NDArray[np.float64], order: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the motions between rows in an order, shape (n - 1, 3): ahead, to the left, turn; none where the order leaps."""
    poses = odometry[order]
    (dx, dy, turn), theta = np.diff(poses, axis=0).T, poses[:-1, 2]
    cosine, sine = np.cos(theta), np.sin(theta)
    steps = np.column_stack((cosine * dx + sine * dy, cosine * dy - sine * dx, wrap_all(turn)))
    return np.where((np.abs(np.diff(order)) == 1)[:, None], steps, 0.0)


def added(start: NDArray[np.float64], steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the poses that motions lead to from a start on."""
    headings = start[2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    cosine, sine = np.cos(headings[:-1]), np.sin(headings[:-1])
    moves = np.stack((cosine * steps[:, 0] - sine * steps[:, 1], sine * steps[:, 0] + cosine * steps[:, 1]), axis=1)
    return np.column_stack((start[:2] + np.concatenate((np.zeros((1, 2)), np.cumsum(moves, axis=0))), headings))


def rearranged(recorded: RecordedScans, order: NDArray[np.intp], steps: NDArray[np.float64], interval: float) -> RecordedScans:
    """Return the recording of a robot that sees rows of another in an order, with the odometry of some motions."""
    time = interval * np.arange(len(order))
    odometry = added(recorded.odometry[order[0]], steps)
    return recorded._replace(time=time, odometry=odometry, rows=np.arange(len(order)), last=time, ranges=recorded.ranges[order])


def shuttle(rows: int, every: int, back: int) -> NDArray[np.intp]:
    """Return an order of rows in which a robot goes back by some rows again and again, and on from there."""
    parts = [np.arange(min(every, rows))]
    for first in range(every, rows, every):
        parts += [np.arange(first - 2, first - back - 1, -1), np.arange(first - back + 1, min(first + every, rows))]
    return np.concatenate(parts)


def crowded(ranges: NDArray[np.float32], share: float, seed: int) -> NDArray[np.float32]:
    """Return scans in which blocks of beams end at people, at a uniform share of their range, who stay for some rows."""
    random, ranges = np.random.default_rng(seed), ranges.copy()
    beams = ranges.shape[1]
    blocks = -(-beams // BLOCK)
    for row in range(0, len(ranges), STAY):
        hidden = np.repeat(random.permutation(blocks) < share * blocks, BLOCK)[:beams]
        part = np.repeat(random.uniform(0.1, 1.0, blocks), BLOCK)[:beams]
        ranges[row : row + STAY] *= np.where(hidden, part, 1.0).astype(np.float32)
    return ranges
