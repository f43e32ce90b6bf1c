"""Inject faults into live robots' chains: real processes, real DDS, a driver that may lie, and an independent judge.

Each worker has a robot of its own in its own ROS domain: filter, controller, guard with collision monitor and standby, see
`faults_robot`. Motion counts while it is in force, since a TurtleBot3 holds its last command for ever, see `faults_record`. A
fault is unsafe if a motion is published more than 0.6 s after the newest measurement or person's command that it can rest on,
or is in force 0.1 s longer than that; if the robot comes within 2 cm of a wall in half a minute; if it moves for more than
0.25 m or 1.0 s after a lie could first be seen, or goes on by itself afterwards; if it moves after a stop that nobody ended;
and if a node has ended that nobody ended, or the judge has not seen it all. The second half runs beside busy processes. An
interrupted run goes on where it was.
"""

from __future__ import annotations

import ctypes
import math
import os
import random
import signal
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context, util
from pathlib import Path
from typing import Any

import tyro

from faults_chain import CHAIN
from faults_lies import LIARS
from faults_messages import BUTTONS, FLOODS, MEASUREMENTS
from faults_processes import ENDS, MOTIONS, PROCESSES
from faults_robot import Fault, Robot, Unseen
from faults_walls import WALLS
from harness.machine import busy, claimed_domain
from harness.study import each, finished, publish

GROUPS = {"buttons": BUTTONS, "measurements": MEASUREMENTS, "processes": PROCESSES, "motions": MOTIONS}
GROUPS |= {"floods": FLOODS, "ends": ENDS, "liars": LIARS, "walls": WALLS}
FAULTS: dict[str, Fault] = {name: fault for kinds in GROUPS.values() for name, fault in kinds.items()}
TRIES = 3  # until a fault is seen; one that never is counts as unsafe
_own: dict[str, Any] = {}  # a worker's robot


def begin(buttons: bool) -> None:
    """Start the robot of a worker, which ends with it."""
    from cmd_vel_guard.discovery import prepare

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"  # as on a robot
    prepare(local=False)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: a robot that outlives the judge would disturb the next run
    domain, _own["domain"] = claimed_domain()
    _own["robot"] = Robot(domain, buttons=buttons)
    util.Finalize(None, _own["robot"].close, exitpriority=10)


def inject(kind: str, number: int, seed: int) -> dict[str, Any]:
    """Inject a fault until it is seen, and return why it was unsafe."""
    robot, reasons, since = _own["robot"], list[str](), time.time()
    for attempt in range(TRIES):
        robot.drive()
        since, rng = time.time(), random.Random(f"{seed} {kind} {number} {attempt}")
        try:
            reasons = [*(FAULTS[kind](robot, rng) or ()), *robot.judge(since)]
            break
        except Unseen as error:
            reasons = [f"not seen: {error}"]
        finally:
            with robot.lock:
                robot.record.forget()
    complaints = robot.ros.complaints(since)
    return {"kind": kind, "number": number, "seed": seed, "unsafe": reasons, "complaints": complaints}


def kinds_of(only: tuple[str, ...]) -> list[str]:
    """Return the kinds whose names begin with one of some words, or which are in a group of that name; all without any."""
    found = {word: {*GROUPS.get(word, ()), *(name for name in FAULTS if name.startswith(word))} for word in only}
    if not all(found.values()):
        raise ValueError(f"only must be beginnings of kinds of faults, or groups, got {only}.")
    return [name for name in FAULTS if not only or any(name in named for named in found.values())]


def counts_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return by kind how many faults were injected and unsafe, and how often for which reasons."""
    counts = {}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        unsafe = [row["unsafe"] for row in rows if row["kind"] == kind]
        counts[kind] = {"injected": len(unsafe), "unsafe": sum(map(bool, unsafe))}
        if any(unsafe):
            counts[kind]["reasons"] = Counter(reason for found in unsafe for reason in found)
    return counts


def main(
    *,
    faults: int = 8 * len(FAULTS),
    only: tuple[str, ...] = (),
    workers: int = 5,
    beside: int = 4,
    seed: int = 0,
    kept: Path | None = None,
    json: Path = Path("benchmarks/faults.json"),
) -> None:
    """Inject faults of all kinds or some, by beginnings or groups, in rounds; the exit status is 1 unless all were safe."""
    options, kinds, rows = {**locals()}, kinds_of(only), list[dict[str, Any]]()
    count = math.ceil(faults / len(kinds))
    rounds = [(kind, at, seed) for at in range(count) for kind in random.Random(f"{seed} {at}").sample(kinds, len(kinds))]
    rounds, half = rounds[:faults], (count + 1) // 2 * len(kinds)
    try:
        for part, crowd in ((rounds[:half], 0), (rounds[half:], beside)):
            for buttons in (False, True):
                units = [unit for unit in part if (unit[0] in BUTTONS) == buttons]
                if units:
                    pool = ProcessPoolExecutor(min(workers, len(units)), get_context("spawn"), begin, (buttons,))
                    with busy(crowd):
                        for row in each(finished(inject, units, kept, "kind number seed", pool), "faults", len(units)):
                            rows.append(row)
                            if row["unsafe"]:
                                print(f"unsafe: {row['kind']!r}, {row['number']}: {'; '.join(row['unsafe'])}", file=sys.stderr)
    except (KeyboardInterrupt, RuntimeError) as error:
        print(f"ended early: {error!r}", file=sys.stderr)
    total = {"injected": len(rows), "unsafe": sum(bool(row["unsafe"]) for row in rows)}
    publish(json, {"total": total, "settings": CHAIN, "faults": counts_of(rows)}, options)
    print(total)
    raise SystemExit(total["unsafe"] > 0 or total["injected"] < faults)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
