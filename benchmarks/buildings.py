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

Poses between the key frames, by which carried robots and starts are judged, are those of the first condition. A robot is right
if it is tracking within 0.5 m and 0.3 rad; `wrong` is the longest time in which it was tracking farther than 0.5 m from there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.table import Table

from building import Building, Chart, chart, crowded, load, rearranged, shuttle, steps_of
from harness.study import Study, each, run
from turtlebot_gym.drive import heading_error, position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.localization.localizer import LOST, TRACKING
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.evaluation.localize import KNOWN, KnownPlace, RecordedCourse, localize

ASTRAY, TURNED = 0.5, 0.3
"""Distance, m, and turn, rad, from which on a pose is wrong."""
LEAP, AFTER = 1.4, 60.0
"""Turn by which odometry's heading leaps, rad, and time between two leaps, s."""
BACK = 3.0
"""Time for which the robot goes back, s."""
BEFORE, WITHIN = 20.0, 10.0
"""Time before a robot is carried off, s, and way on which it must be right again, m."""
BESIDE_MAP = Pose(500.0, 500.0, 0.0)


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
    leaps: bool = False
    """Whether odometry's heading leaps."""
    back: bool = False
    """Whether the robot goes back, which its odometry counts as forward."""
    begin: str = ""
    """What each of many short drives begins with: "carried", "beside", "grey", "unknown"; empty for one whole drive."""


MAPS = tuple(
    Condition(
        name=f"{cell} cm{', halves' * halves}{', backwards' * backwards}", cell=0.01 * cell, halves=halves, backwards=backwards
    )
    for cell in (5, 10)
    for halves in (False, True)
    for backwards in (False, True)
)
CONDITIONS = (
    *MAPS,
    Condition(name="odometry off by 10 %", odometry=1.1),
    Condition(name="odometry off by 20 %", odometry=1.2),
    Condition(name="every fourth scan", every=4),
    Condition(name="20 beams", beams=20),
    Condition(name="25 % people", people=0.25),
    Condition(name="50 % people", people=0.5),
    Condition(name="heading leaps", leaps=True),
    Condition(name="heading leaps, 25 % people", leaps=True, people=0.25),
    Condition(name="reverse as forward", back=True),
    Condition(name="reverse as forward, 25 % people", back=True, people=0.25),
    Condition(name="carried", begin="carried"),
    Condition(name="carried, 25 % people", begin="carried", people=0.25),
    Condition(name="carried, 50 % people", begin="carried", people=0.5),
    Condition(name="start beside the map", begin="beside"),
    Condition(name="start in the unknown", begin="grey"),
    Condition(name="unknown start", begin="unknown"),
    Condition(name="unknown start, 25 % people", begin="unknown", people=0.25),
)


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Localize a robot on recordings of real buildings."""

    data: Path = Path("../shared/data")
    """Folder with the recordings, in `carmen`."""
    buildings: tuple[str, ...] = ("aces", "intel")
    """Their names."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME")] = ()
    """Drive under these conditions alone."""
    number: int = 40
    """Number of short drives."""
    seed: int = 0
    """Seed of people and of short drives."""


class Site(NamedTuple):
    """A building with what is known of it."""

    building: Building
    charts: dict[tuple[float, bool], Chart]
    poses: NDArray[np.float64]
    """Poses at all rows, shape (T, 3); m, m, rad."""
    interval: float
    """Time between two rows, s."""


def site_of(building: Building) -> Site:
    """Return a building with its map, and the poses of a localizer between its key frames."""
    charts = {(0.05, False): chart(building, 0.05)}
    # Some stamps run backwards: their median interval counts.
    site = Site(building, charts, building.recorded.odometry, float(np.median(np.abs(np.diff(building.recorded.time)))))
    return site._replace(
        poses=follow(site, CONDITIONS[0], np.arange(building.rows[-1] + 1), Pose(*building.reference[0]), 0).poses
    )


def follow(site: Site, condition: Condition, order: NDArray[np.intp], start: Pose | None, seed: int) -> RecordedCourse:
    """Return the beliefs of a localizer that sees the rows of a building in an order."""
    recorded, steps, at = (
        site.building.recorded,
        steps_of(site.building.recorded.odometry, order),
        (condition.cell, condition.halves),
    )
    steps *= condition.odometry
    if condition.back:
        steps[np.diff(order) < 0, :2] *= -1.0
    if condition.leaps:
        every = round(AFTER / site.interval)
        steps[every - 1 :: every, 2] += LEAP
    recorded = rearranged(recorded, order, steps, site.interval)
    if condition.people > 0.0:
        recorded = recorded._replace(ranges=crowded(recorded.ranges, condition.people, seed))
    used = recorded.rows[:: condition.every]
    recorded = recorded._replace(rows=used, last=recorded.time[used], ranges=recorded.ranges[used])
    if at not in site.charts:
        site.charts[at] = chart(site.building, condition.cell, slice(0, None, 2) if condition.halves else slice(None))
    return localize(recorded, KnownPlace(*site.charts[at], replace(ROBOT, beams=condition.beams), start, KNOWN))


def longest(flags: NDArray[np.bool_], interval: float) -> float:
    """Return the longest time for which a flag was set without a break, s."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return interval * float(np.max(edges[1::2] - edges[::2], initial=0))


def shares_of(course: RecordedCourse, far: NDArray[np.float64], interval: float) -> dict[str, float]:
    """Return what a localizer says of itself beside how far its poses are off, shape (T,), m."""
    return {
        "unsure": float(np.mean(course.states != TRACKING)),
        "declared_lost": float(np.mean(course.states == LOST)),
        "wrong": longest((course.states == TRACKING) & (far > ASTRAY), interval),
    }


def whole(site: Site, condition: Condition, config: Config) -> dict[str, float]:
    """Drive a building under a condition and return the errors at its key frames, and the seconds of a core per scan."""
    building, last = site.building, int(site.building.rows[-1])
    order = np.arange(last + 1)
    if condition.backwards:
        order = order[::-1]
    if condition.back:
        order = shuttle(last + 1, round(AFTER / site.interval), round(BACK / site.interval))
    judged = np.arange(len(building.rows))
    if condition.halves:
        judged = judged[1::2]
    rows = np.array([np.flatnonzero(order == row)[-1] for row in building.rows[judged]])
    start = Pose(*site.poses[order[0]]) if condition.backwards else Pose(*building.reference[0])
    began = time.process_time()
    course = follow(site, condition, order, start, config.seed)
    seconds, reference = time.process_time() - began, building.reference[judged]
    far = position_error(course.poses[rows], reference)
    squares = nees(course.poses[rows], reference, course.covariances[rows])
    published = course.states[rows] != LOST
    return {
        "median": float(np.median(far)),
        "quantile95": float(np.quantile(far, 0.95)),
        "worst": float(far.max()),
        "lost": float(np.mean(far > ASTRAY)),
        "median_heading": float(np.median(heading_error(course.poses[rows], reference))),
        "nees": float(np.median(squares)),
        "mean_nees": float(np.mean(squares[published])),
        **shares_of(course, position_error(course.poses, site.poses[order]), site.interval),
        "seconds_per_scan": seconds / max(course.scans, 1),
        "scans": course.scans,
        "key_frames": len(rows),
    }


def short(site: Site, condition: Condition, config: Config) -> dict[str, float]:
    """Drive many short drives and return how many are right again, after how many seconds and metres."""
    random, before = np.random.default_rng(config.seed), round(BEFORE / site.interval)
    moves = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(site.poses[:, :2], axis=0).T))))
    latest = int(np.searchsorted(moves, moves[-1] - 2.0 * WITHIN))
    results, field, frame = [], *site.charts[0.05, False]
    unknown = np.argwhere(np.isnan(field))
    for number in range(config.number):
        first, to = random.integers(0, latest, 2)
        while condition.begin == "carried" and position_error(site.poses[first + before], site.poses[to]) < 2.0:
            first, to = random.integers(0, latest, 2)
        end = int(np.searchsorted(moves, moves[to] + 1.5 * WITHIN))
        end = max(end, min(to + round(10.0 / site.interval), len(moves)))
        order, since, start = np.arange(to, end), 0, None
        if condition.begin == "carried":
            order, since, start = np.concatenate((np.arange(first, first + before), order)), before, Pose(*site.poses[first])
        elif condition.begin == "beside":
            start = BESIDE_MAP
        elif condition.begin == "grey":
            row, column = unknown[random.integers(len(unknown))]
            x, y = (frame[:2] + frame[4] * np.array((column, row))).tolist()
            start = Pose(x, y, random.uniform(-np.pi, np.pi))
        course = follow(site, condition, order, start, config.seed + number)
        far, turned = position_error(course.poses, site.poses[order]), heading_error(course.poses, site.poses[order])
        right = (far < ASTRAY) & (turned < TURNED) & (course.states == TRACKING)
        found = np.flatnonzero(right[since:])
        found = since + int(found[0]) if len(found) else len(order) - 1
        way, at = moves[order] - moves[to], np.searchsorted(moves[order[since:]], moves[to] + WITHIN) + since
        noticed = np.flatnonzero(course.states[since:] == LOST)
        results.append(
            {
                "right": float(right[min(at, len(right) - 1)]),
                "ever": float(right[since:].any()),
                "noticed": float(site.interval * noticed[0]) if len(noticed) else np.inf,
                "found": site.interval * (found - since) if right[since:].any() else np.inf,
                "way": float(way[found]),
                **shares_of(course, far, site.interval),
            }
        )
    each_of = {name: np.array([result[name] for result in results]) for name in results[0]}
    return {
        "right": float(np.mean(each_of["right"])),
        "ever": float(np.mean(each_of["ever"])),
        "noticed": float(np.max(each_of["noticed"])),
        "found": float(np.median(each_of["found"])),
        "found95": float(np.quantile(each_of["found"], 0.95, method="higher")),
        "way": float(np.median(each_of["way"])),
        "wrong": float(np.max(each_of["wrong"])),
        "wrong_drives": int(np.sum(each_of["wrong"] > 2.0)),
        "drives": config.number,
    }


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the figures of each building under each condition, losses first, and their tables."""
    results: dict[str, Any] = {"buildings": {}, "found": {}}
    errors = Table(
        "building", "condition", "median cm", "95 %", "worst", "lost", "NEES", "mean", "unsure", "lost", "wrong s", "us"
    )
    found = Table(
        "building", "condition", "right in 10 m", "ever", "noticed s", "found s", "95 %", "way m", "wrong s", "drives"
    )
    chosen = [condition for condition in CONDITIONS if not config.only or condition.name in config.only]
    for name in config.buildings:
        site = site_of(load(config.data / "carmen" / f"{name}.npz"))
        figures = {it.name: (short if it.begin else whole)(site, it, config) for it in each(chosen, name)}
        drives = {it.name: figures[it.name] for it in chosen if not it.begin}
        results["buildings"][name] = dict(sorted(drives.items(), key=lambda item: -item[1]["lost"]))
        results["found"][name] = {it.name: figures[it.name] for it in chosen if it.begin}
        for condition, figure in results["buildings"][name].items():
            lengths = (f"{100.0 * figure[key]:.1f}" for key in ("median", "quantile95", "worst"))
            shares = (f"{figure[key]:.3f}" for key in ("unsure", "declared_lost"))
            more = (
                f"{figure['lost']:.4f}",
                f"{figure['nees']:.1f}",
                f"{figure['mean_nees']:.1f}",
                *shares,
                f"{figure['wrong']:.1f}",
            )
            errors.add_row(name, condition, *lengths, *more, f"{1e6 * figure['seconds_per_scan']:.0f}")
        for condition, figure in results["found"][name].items():
            found.add_row(name, condition, *(f"{figure[key]:.3g}" for key in list(figure)[:-1]))
    return results, [errors, found]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
