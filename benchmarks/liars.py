"""Let a driver lie to live chains, and measure time and true path from when that could be seen to zeros, cause and latch.

The robot stands at first, in a hall with a goal far away; the driver lies from then on, or is reset at a distance. A run is
good if the robot stands within 1.0 s and 0.25 m of when the lie could first be seen, names the cause in ``/diagnostics``, and
moves no more for ten seconds in which the driver tells the truth. The second half runs beside busy processes.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import random
import re
import signal
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rich.table import Table

from faults_driver import Wheels, obeying
from faults_liars import other_way, stand, stray, tells_the_truth, turn_aside, until_seen
from faults_lies import Maker, changed, reset_at, scaled
from faults_record import TIME, WAY
from faults_robot import Robot, Unseen
from harness.machine import busy
from harness.ros_domain import claimed_domain
from harness.study import Study, each, finished, run

HALL = (6.0, 1.5, 1.0)
"""Walls ahead, aside and behind, m: a robot reaches a reset at 3 m, and its LiDAR sees walls all the time."""
LATCHED = 10.0
"""Time for which the driver tells the truth at last, s."""


class Case(NamedTuple):
    """A way to lie."""

    cause: str
    """Pattern of a text that names it."""
    lie: Maker = changed(lambda said: said)
    turns: Wheels = obeying
    """How the wheels turn."""
    aside: bool = False
    """Whether the goal is aside, since only turning shows it."""


CASES = {
    "frozen": Case(
        r"does not move|stands? still|frozen|blocked",
        changed(lambda said: said._replace(x=0.0, y=0.0, theta=0.0, v=0.0, omega=0.0)),
    ),
    "pose0": Case(r"pose|does not move|stands? still", changed(lambda said: said._replace(x=0.0, y=0.0, theta=0.0))),
    "gyro0": Case(r"heading|IMU|turn", changed(lambda said: said._replace(theta=0.0)), aside=True),
    "swapped": Case(r"sign|other way|opposite|turn", turns=other_way, aside=True),
    "mm": Case(r"1,?000|too large|too fast|unit|mm|limits", changed(scaled(1000.0))),
    "deg": Case(r"degree|57|unit|heading|turn", changed(scaled(heading=57.29578)), aside=True),
    **{
        f"reset at {distance:g} m": Case(r"reset|jump|leap", reset_at(distance))
        for distance in (0.1, 0.2, 0.35, 0.5, 0.8, 1.25, 2.0, 3.0)
    },
}
_robots: list[Robot] = []
_stack = ExitStack()


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Let a driver lie."""

    runs: int = 10
    """Runs of each case, half of them beside busy processes."""
    only: tuple[str, ...] = ()
    """Cases, by the beginnings of their names; none for all."""
    workers: int = 3
    """Number of robots at a time."""
    busy: int = 4
    """Number of busy processes beside the second half."""
    kept: Path = Path("out/liars.jsonl")
    """File of the finished runs, with which an interrupted one goes on."""


def begin() -> None:
    """Make the robot of a process of the pool."""
    from turtlebot_gym_ros.base.discovery import prepare

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"  # as on a robot
    prepare(local=False)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    _robots.append(Robot(_stack.enter_context(claimed_domain()), buttons=False))


def lie(name: str, number: int) -> dict[str, Any]:
    """Let the driver lie once, and return what happened."""
    (robot,), case, rng = _robots, CASES[name], random.Random(f"{name} {number}")
    row: dict[str, Any] = {"case": name, "number": number, "seen": False, "way": 0.0, "time": 0.0, "cause": ""}
    robot.drive()
    stand(robot)
    since = time.time()
    with robot.lock:
        robot.world.walls = HALL
        robot.driver.lie, robot.driver.turns = case.lie(rng), case.turns
    robot.begin()
    if case.aside:
        turn_aside(robot, rng)
    try:
        at = until_seen(robot, patience=40.0)
        stray(robot, at)
        way, lasted = robot.record.travelled(at, time.time())
        again = tells_the_truth(robot, since, LATCHED)
        judged = robot.judge(since)
    except Unseen as error:
        return row | {"why": str(error)}
    complaints = robot.ros.complaints(at)
    named = [text for text in complaints if re.search(case.cause, text, re.IGNORECASE)]
    row |= {"seen": True, "way": way, "time": lasted, "cause": min(named, default=""), "complaints": complaints}
    return row | {"again": again, "judged": judged}


def is_good(row: dict[str, Any]) -> bool:
    """Return whether a run was good."""
    return row["seen"] and row["way"] <= WAY and row["time"] <= TIME and row["cause"] and not row["again"] + row["judged"]


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return all runs, and their table."""
    names = [name for name in CASES if not config.only or name.startswith(config.only)]
    half, rows = config.runs // 2, []
    for numbers, crowd in ((range(half), 0), (range(half, config.runs), config.busy)):
        wanted = [(name, number) for number in numbers for name in names]
        with busy(crowd):
            pool = ProcessPoolExecutor(config.workers, multiprocessing.get_context("spawn"), begin)
            rows += each(finished(lie, wanted, config.kept, ("case", "number"), pool), "lies", len(wanted))
    table = Table("case", "runs", "good", "time, s", "way, m", "cause named", "stays", "cause")
    for name in names:
        table.add_row(*_cells(name, [row for row in rows if row["case"] == name]))
    good = sum(map(bool, map(is_good, rows)))
    table.add_row("all", f"{len(rows)}", f"{good}")
    return {"rows": rows, "runs": len(rows), "good": good, "load": os.getloadavg()}, [table]


def _cells(name: str, rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a case's cells of the table."""
    longest = (f"{max((row[key] for row in rows), default=0.0):.2f}" for key in ("time", "way"))
    named, stays = sum(bool(row["cause"]) for row in rows), sum(not row.get("again", ["not seen"]) for row in rows)
    causes = [row["cause"] for row in rows if row["cause"]]
    good = sum(map(bool, map(is_good, rows)))
    return [name, f"{len(rows)}", f"{good}", *longest, f"{named}", f"{stays}", causes[0] if causes else ""]


if __name__ == "__main__":
    _, results = run(Config, measure)
    raise SystemExit(results["good"] < results["runs"])
