"""Localize a robot on recordings of real buildings: a map from reference key frames, raw odometry and scans through it.

The map's cells are drawn from the scans at the key frames alone; the localizer sees wheels and scans only. Each building is
driven under conditions that differ from the first in one thing, all with one tuning. Errors are those of the position at the
key frames.

* backwards: rows in the reverse order, from the last key frame on.
* halves: the map of the even key frames, judged at the odd ones.
* odometry off: each way and each turn of the wheels times 1.1 or 1.2.
* people: blocks of beams end at a uniformly drawn share of their range, drawn anew for each five rows.
* heading leaps: odometry's heading jumps by 1.4 rad every 60 s.
* reverse as forward: every 60 s the robot goes back by 3 s, and its odometry counts that as forward.
* carried: after 20 s the robot stands elsewhere in the building, with odometry that says nothing of it.
* starts: the localizer begins beside the map, in the unknown near the true place, or without a pose.

Carried robots and starts are judged by poses of the first condition. A robot is right if it is tracking within 0.5 m and 0.3
rad; `wrong` is the longest time in which it was tracking farther than 0.5 m from there.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from harness.study import each, publish
from turtlebot_gym.drive import heading_error, position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.localization.localizer import LOST, TRACKING
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.rooms.field import field_of_hits
from turtlebot_gym.rooms.grid import BESIDE
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.evaluation.localize import FAR, KNOWN, KnownPlace, RecordedCourse, RecordedScans, localize

Array = NDArray[np.float64]
HIT, BLOCK, STAY = 0.25, 9, 5
"""Least share of the beams through an occupied cell that end in it; beams that a person hides; rows for which people stay."""
ASTRAY, TURNED = 0.5, 0.3
"""Distance, m, and turn, rad, from which on a pose is wrong."""
LEAP, AFTER, BACK, BEFORE, WITHIN = 1.4, 60.0, 3.0, 20.0, 10.0
"""Turn by which odometry's heading leaps, rad; times between two events, of going back, and until a robot is carried off, s;
way on which it must be right again, m."""


class Condition(NamedTuple):
    """How a building is driven: side of a map's cell, m; which beams end at people; how each of many short drives begins."""

    cell: float = 0.05
    halves: bool = False
    backwards: bool = False
    odometry: float = 1.0
    every: int = 1
    beams: int = ROBOT.beams
    people: float = 0.0
    leaps: bool = False
    back: bool = False
    begin: str = ""


CONDITIONS = {
    f"{size} cm{', halves' * halves}{', backwards' * backwards}": Condition(0.01 * size, halves, backwards)
    for size in (5, 10)
    for halves in (False, True)
    for backwards in (False, True)
}
CONDITIONS |= {
    "odometry off by 10 %": Condition(odometry=1.1),
    "odometry off by 20 %": Condition(odometry=1.2),
    "every fourth scan": Condition(every=4),
    "20 beams": Condition(beams=20),
    "25 % people": Condition(people=0.25),
    "50 % people": Condition(people=0.5),
    "heading leaps": Condition(leaps=True),
    "heading leaps, 25 % people": Condition(leaps=True, people=0.25),
    "reverse as forward": Condition(back=True),
    "reverse as forward, 25 % people": Condition(back=True, people=0.25),
    "carried": Condition(begin="carried"),
    "carried, 25 % people": Condition(begin="carried", people=0.25),
    "carried, 50 % people": Condition(begin="carried", people=0.5),
    "start beside the map": Condition(begin="beside"),
    "start in the unknown": Condition(begin="grey"),
    "unknown start": Condition(begin="unknown"),
    "unknown start, 25 % people": Condition(begin="unknown", people=0.25),
}


class Building(NamedTuple):
    """A recording, with the rows of key frames and their reference poses, shape (K, 3); m, m, rad."""

    recorded: RecordedScans
    rows: NDArray[np.intp]
    reference: Array


def load(path: Path) -> Building:
    """Return a building from a NumPy archive, from its first key frame on."""
    with np.load(path) as log:
        ranges, odometry, stamps = log["ranges_cm"].astype(np.float32) / 100.0, log["odometry"], log["time"]
        rows, reference = log["reference_row"].astype(np.intp), log["reference"]
    first, angles = rows[0], np.radians(np.arange(ranges.shape[1]) - 90.0)
    odometry, ranges, stamps = odometry[first:], ranges[first:], stamps[first:]
    recorded = RecordedScans(stamps, odometry, np.arange(len(odometry)), stamps, ranges, angles)
    return Building(recorded, rows - first, reference)


def chart(building: Building, cell: float, frames: slice = slice(None)) -> tuple[NDArray[np.float32], Array]:
    """Return the map of some key frames, field and frame, see `rooms.field`: occupied is where `HIT` of the beams end."""
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
    return field, np.array([*corner, 1.0, 0.0, cell])


def added(start: Array, steps: Array) -> Array:
    """Return the poses that motions (ahead, to the left, turn) lead to from a start on."""
    headings = start[2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    cosine, sine = np.cos(headings[:-1]), np.sin(headings[:-1])
    moves = np.stack((cosine * steps[:, 0] - sine * steps[:, 1], sine * steps[:, 0] + cosine * steps[:, 1]), axis=1)
    return np.column_stack((start[:2] + np.concatenate((np.zeros((1, 2)), np.cumsum(moves, axis=0))), headings))


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


class Site:
    """A building with what is known of it."""

    def __init__(self, building: Building) -> None:
        self.building = building
        self.interval = float(np.median(np.abs(np.diff(building.recorded.time))))  # s; some stamps run backwards
        self.chart = cache(lambda cell, halves: chart(building, cell, slice(0, None, 2) if halves else slice(None)))
        order = np.arange(building.rows[-1] + 1)
        self.poses = self.follow(Condition(), order, Pose(*building.reference[0]), 0).poses
        """Poses at all rows, by a localizer between the key frames, shape (T, 3); m, m, rad."""
        self.ways = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(self.poses[:, :2], axis=0).T))))
        """Way until each row, m."""

    def follow(self, condition: Condition, order: NDArray[np.intp], start: Pose | None, seed: int) -> RecordedCourse:
        """Return the beliefs of a localizer that sees the rows of the building in an order."""
        recorded = self.building.recorded
        poses = recorded.odometry[order]
        (dx, dy, turn), cosine, sine = np.diff(poses, axis=0).T, np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
        steps = np.column_stack((cosine * dx + sine * dy, cosine * dy - sine * dx, wrap_all(turn)))
        steps = np.where((np.abs(np.diff(order)) == 1)[:, None], steps, 0.0) * condition.odometry  # none where the order leaps
        if condition.back:
            steps[np.diff(order) < 0, :2] *= -1.0
        if condition.leaps:
            every = round(AFTER / self.interval)
            steps[every - 1 :: every, 2] += LEAP
        ranges, time = recorded.ranges[order], self.interval * np.arange(len(order))
        if condition.people > 0.0:
            ranges = crowded(ranges, condition.people, seed)
        rows = np.arange(len(order))[:: condition.every]
        odometry = added(recorded.odometry[order[0]], steps)
        seen = recorded._replace(time=time, odometry=odometry, rows=rows, last=time[rows], ranges=ranges[rows])
        known = self.chart(condition.cell, condition.halves)
        return localize(seen, KnownPlace(*known, replace(ROBOT, beams=condition.beams), start, KNOWN))

    def wrong(self, course: RecordedCourse, far: Array) -> float:
        """Return the longest time for which it was tracking, but far from its true pose, s; ``far`` in m."""
        flags = (course.states == TRACKING) & (far > ASTRAY)
        edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
        return self.interval * float(np.max(edges[1::2] - edges[::2], initial=0))


def whole(site: Site, condition: Condition, seed: int) -> dict[str, float]:
    """Drive a building under a condition and return the errors at its key frames."""
    building, last = site.building, int(site.building.rows[-1])
    order = np.arange(last + 1)[:: -1 if condition.backwards else 1]
    if condition.back:
        order = shuttle(last + 1, round(AFTER / site.interval), round(BACK / site.interval))
    judged = np.arange(len(building.rows))[slice(1, None, 2) if condition.halves else slice(None)]
    rows, reference = np.array([np.flatnonzero(order == row)[-1] for row in building.rows[judged]]), building.reference[judged]
    start = Pose(*site.poses[order[0]]) if condition.backwards else Pose(*building.reference[0])
    course = site.follow(condition, order, start, seed)
    far = position_error(course.poses[rows], reference)
    squares = nees(course.poses[rows], reference, course.covariances[rows])
    return {
        "median": float(np.median(far)),
        "quantile95": float(np.quantile(far, 0.95)),
        "worst": float(far.max()),
        "lost": float(np.mean(far > ASTRAY)),
        "nees": float(np.median(squares)),
        "mean_nees": float(np.mean(squares[course.states[rows] != LOST])),
        "declared_lost": float(np.mean(course.states == LOST)),
        "wrong": site.wrong(course, position_error(course.poses, site.poses[order])),
    }


def short(site: Site, condition: Condition, seed: int, number: int) -> dict[str, float]:
    """Drive many short drives and return how many are right again, after how many seconds and metres."""
    random, before, ways = np.random.default_rng(seed), round(BEFORE / site.interval), site.ways
    latest, (field, frame) = int(np.searchsorted(ways, ways[-1] - 2.0 * WITHIN)), site.chart(0.05, False)
    unknown, results = np.argwhere(np.isnan(field)), []
    for at in range(number):
        first, to = random.integers(0, latest, 2)
        while condition.begin == "carried" and position_error(site.poses[first + before], site.poses[to]) < 2.0:
            first, to = random.integers(0, latest, 2)
        end = int(np.searchsorted(ways, ways[to] + 1.5 * WITHIN))
        end = max(end, min(to + round(10.0 / site.interval), len(ways)))
        order, since, start = np.arange(to, end), 0, None
        if condition.begin == "carried":
            order, since, start = np.concatenate((np.arange(first, first + before), order)), before, Pose(*site.poses[first])
        elif condition.begin == "beside":
            start = Pose(500.0, 500.0, 0.0)
        elif condition.begin == "grey":
            row, column = unknown[random.integers(len(unknown))]
            x, y = (frame[:2] + frame[4] * np.array((column, row))).tolist()
            start = Pose(x, y, random.uniform(-np.pi, np.pi))
        course = site.follow(condition, order, start, seed + at)
        far, turned = position_error(course.poses, site.poses[order]), heading_error(course.poses, site.poses[order])
        right = ((far < ASTRAY) & (turned < TURNED) & (course.states == TRACKING))[since:]
        found, way = int(np.argmax(right)) if right.any() else len(right) - 1, ways[order[since:]] - ways[to]
        in_time = min(int(np.searchsorted(way, WITHIN)), len(right) - 1)
        seconds = site.interval * found if right.any() else np.inf
        results.append((right[in_time], seconds, way[found], site.wrong(course, far)))
    right, found, way, wrong = np.array(results, np.float64).T
    figures = {"right": np.mean(right), "found": np.median(found), "way": np.median(way), "wrong": np.max(wrong)}
    return {name: float(value) for name, value in figures.items()}


def main(
    *,
    data: Path = Path("../shared/data"),
    buildings: tuple[str, ...] = ("aces", "intel"),
    only: tuple[str, ...] = (),
    number: int = 40,
    seed: int = 0,
    json: Path = Path("benchmarks/buildings.json"),
) -> None:
    """Localize in buildings, whose recordings are in the folder `carmen` of the data, under all conditions or a few, and write.

    A number of short drives is made for each building where a condition wants these.
    """
    options, results = {**locals()}, dict[str, Any](buildings={}, found={})
    for name in buildings:
        site, drives, found = Site(load(data / "carmen" / f"{name}.npz")), {}, {}
        for title in each(only or CONDITIONS, name):
            condition = CONDITIONS[title]
            if condition.begin:
                found[title] = short(site, condition, seed, number)
            else:
                drives[title] = whole(site, condition, seed)
        results["buildings"][name] = dict(sorted(drives.items(), key=lambda item: -item[1]["lost"]))
        results["found"][name] = found
    publish(json, results, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
