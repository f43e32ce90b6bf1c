"""Localize a robot on recordings of real buildings: a map from reference key frames, raw odometry and scans through it.

`make bench-buildings` runs it and writes `buildings.json`. The map's cells are drawn from the scans at the key frames alone;
the localizer begins at the first key frame and sees wheels and scans only. Each building is driven under conditions that differ
from the first in one thing, all with one tuning. Errors are those of the position at the key frames.

* backwards: rows in the reverse order, from the last key frame on.
* halves: the map of the even key frames, judged at the odd ones.
* odometry off: each way and each turn of the wheels times 1.1 or 1.2.
* people: blocks of beams end at a uniformly drawn share of their range, drawn anew for each five rows.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from harness.study import Study, each, run
from turtlebot_gym.localization.localizer import LOST
from turtlebot_gym.localization.tuning import ROBOT, LocalizerTuning
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.field import field_of_hits
from turtlebot_gym.rooms.grid import BESIDE
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.evaluation.localize import FAR, KNOWN, Course, Place, Recorded, errors_of, localize

BUILDINGS = ("aces", "intel")
HIT = 0.25
"""Least share of the beams through a cell that end in it where it is occupied."""
BLOCK = 9
"""Number of beams that a person hides."""


class Building(NamedTuple):
    """A recording with reference poses at some rows."""

    recorded: Recorded
    rows: NDArray[np.intp]
    """Rows of the key frames, shape (K,)."""
    reference: NDArray[np.float64]
    """Shape (K, 3); m, m, rad."""


class Chart(NamedTuple):
    """A map as the localizer uses it, see `rooms.field`."""

    field: NDArray[np.float32]
    frame: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """How a building is driven."""

    name: str
    cell: float = 0.05
    """Side of a map's cell, m."""
    halves: bool = False
    backwards: bool = False
    odometry: float = 1.0
    """Factor of ways and turns."""
    every: int = 1
    """Which scans are used."""
    beams: int = ROBOT.beams
    people: float = 0.0
    """Share of beams that end at people."""


CONDITIONS = (
    Condition(name="5 cm"),
    Condition(name="5 cm, backwards", backwards=True),
    Condition(name="5 cm, halves", halves=True),
    Condition(name="5 cm, halves, backwards", halves=True, backwards=True),
    Condition(name="10 cm", cell=0.1),
    Condition(name="10 cm, backwards", cell=0.1, backwards=True),
    Condition(name="10 cm, halves", cell=0.1, halves=True),
    Condition(name="10 cm, halves, backwards", cell=0.1, halves=True, backwards=True),
    Condition(name="odometry off by 10 %", odometry=1.1),
    Condition(name="odometry off by 20 %", odometry=1.2),
    Condition(name="every fourth scan", every=4),
    Condition(name="20 beams", beams=20),
    Condition(name="25 % people", people=0.25),
    Condition(name="50 % people", people=0.5),
)


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Localize a robot on recordings of real buildings."""

    data: Path = Path("../shared/data")
    """Folder with the recordings, in `carmen`."""
    seed: int = 0
    """Seed of the people."""


def load(path: Path) -> Building:
    """Return a building from a NumPy archive."""
    with np.load(path) as log:
        ranges, odometry, stamps = log["ranges_cm"].astype(np.float32) / 100.0, log["odometry"], log["time"]
        rows, reference = log["reference_row"].astype(np.intp), log["reference"]
    angles = np.radians(np.arange(ranges.shape[1]) - 90.0)
    recorded = Recorded(stamps, odometry, np.arange(len(odometry)), stamps, ranges, angles)
    return Building(recorded, rows, reference)


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


def driven(building: Building, condition: Condition, seed: int = 0) -> Building:
    """Return a building from the first key frame on, as it is driven under a condition."""
    recorded, rows, reference = building
    first, last = rows[0], (rows[-1] + 1 if condition.backwards else len(recorded.odometry))
    odometry, ranges, stamps = recorded.odometry[first:last], recorded.ranges[first:last], recorded.time[first:last]
    rows = rows - first
    if condition.backwards:
        odometry, ranges, stamps = odometry[::-1], ranges[::-1], stamps[::-1]
        rows, reference = len(odometry) - 1 - rows[::-1], reference[::-1]
    odometry = scaled(odometry, condition.odometry)
    ranges = crowded(ranges, condition.people, seed) if condition.people > 0.0 else ranges
    used = np.arange(0, len(odometry), condition.every)
    recorded = recorded._replace(time=stamps, odometry=odometry, rows=used, last=stamps[used], ranges=ranges[used])
    return Building(recorded, rows, reference)


def scaled(odometry: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return odometry whose ways and turns are those of another times a factor."""
    theta = odometry[:-1, 2]
    step, turns = np.diff(odometry[:, :2], axis=0), (np.diff(odometry[:, 2]) + np.pi) % TWO_PI - np.pi
    headings = odometry[0, 2] + factor * np.concatenate(([0.0], np.cumsum(turns)))
    ahead, aside = (
        step[:, 0] * np.cos(theta) + step[:, 1] * np.sin(theta),
        step[:, 1] * np.cos(theta) - step[:, 0] * np.sin(theta),
    )
    cosine, sine = np.cos(headings[:-1]), np.sin(headings[:-1])
    moves = factor * np.stack((cosine * ahead - sine * aside, sine * ahead + cosine * aside), axis=1)
    places = odometry[0, :2] + np.concatenate((np.zeros((1, 2)), np.cumsum(moves, axis=0)))
    return np.column_stack((places, headings))


def crowded(ranges: NDArray[np.float32], share: float, seed: int) -> NDArray[np.float32]:
    """Return scans in which blocks of beams end at people, who stay for five rows."""
    random, ranges = np.random.default_rng(seed), ranges.copy()
    beams = ranges.shape[1]
    blocks = -(-beams // BLOCK)
    for row in range(0, len(ranges), 5):
        hidden = np.repeat(random.permutation(blocks) < share * blocks, BLOCK)[:beams]
        part = np.repeat(random.uniform(0.1, 1.0, blocks), BLOCK)[:beams]
        ranges[row : row + 5] *= np.where(hidden, part, 1.0).astype(np.float32)
    return ranges


def tuning_of(condition: Condition) -> LocalizerTuning:
    """Return the only tuning, with the number of beams of a condition."""
    return replace(ROBOT, beams=condition.beams)


def figures(course: Course, building: Building, judged: slice, seconds: float) -> dict[str, float]:
    """Return the errors at key frames; m, and seconds of a core per scan."""
    rows = building.rows[judged]
    return errors_of(course, rows, building.reference[judged]) | {
        "declared_lost": float(np.mean(course.states == LOST)),
        "seconds_per_scan": seconds / max(course.scans, 1),
        "scans": course.scans,
        "key_frames": len(rows),
    }


def localized(building: Building, charts: dict[tuple[float, bool], Chart], condition: Condition, seed: int) -> dict[str, float]:
    """Drive a building under a condition and return its figures."""
    drive, at = driven(building, condition, seed), (condition.cell, condition.halves)
    if at not in charts:
        charts[at] = chart(building, condition.cell, slice(0, None, 2) if condition.halves else slice(None))
    odd = len(drive.rows) % 2 if condition.backwards else 1
    judged = slice(odd, None, 2) if condition.halves else slice(None)
    start, first = Pose(*drive.reference[0]), int(drive.rows[0])
    began = time.process_time()
    course = localize(drive.recorded, Place(*charts[at], tuning_of(condition), start, KNOWN, first))
    return figures(course, drive, judged, time.process_time() - began)


def table_of(results: dict[str, dict[str, Any]]) -> Table:
    """Return results as a table."""
    table = Table("building", "condition", "median cm", "95 % cm", "worst cm", "lost", "NEES", "us a scan")
    for name, conditions in results.items():
        for condition, figure in conditions.items():
            lengths = (f"{100.0 * figure[key]:.1f}" for key in ("median", "quantile95", "worst"))
            share, nees, time = f"{figure['lost']:.3f}", f"{figure['nees']:.1f}", f"{1e6 * figure['seconds_per_scan']:.0f}"
            table.add_row(name, condition, *lengths, share, nees, time)
    return table


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of all buildings under all conditions, and their table."""
    results: dict[str, dict[str, Any]] = {}
    for name in BUILDINGS:
        building, charts = load(config.data / "carmen" / f"{name}.npz"), {}
        localized(building, charts, CONDITIONS[0], config.seed)  # compiled before it is timed
        results[name] = {
            condition.name: localized(building, charts, condition, config.seed) for condition in each(CONDITIONS, name)
        }
    return {"buildings": results}, [table_of(results)]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
