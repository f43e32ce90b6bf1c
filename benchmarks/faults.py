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
import json
import math
import multiprocessing
import os
import random
import signal
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from faults_chain import settings
from faults_kinds import BUTTONS, FAULTS, GROUPS
from faults_record import LONGEST
from faults_robot import Robot, Unseen
from harness.machine import busy
from harness.ros_domain import claimed_domain
from harness.study import Study, run

TRIES = 3
"""Number of times that a fault is injected until it is seen; one that never is counts as unsafe."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Inject faults into robots' chains, and count unsafe ones."""

    faults: int = 8 * len(FAULTS)
    """Number of faults, equal for each kind."""
    only: tuple[str, ...] = ()
    """Kinds to inject, by the beginnings of their names, or names of groups; none for all."""
    workers: int = 5
    """Number of robots at a time; if there are faults of buttons, some have emergency stops, in proportion."""
    busy: int = 4
    """Number of busy processes beside the second half of the faults."""
    seed: int = 0
    """Seed of the variations: durations, speeds, delays."""
    kept: Path | None = None
    """File of the finished faults, with which an interrupted run goes on; none to keep nothing."""


def work(config: Config, buttons: bool, tasks: Any, results: Any) -> None:
    """Inject the faults of one worker."""
    from cmd_vel_guard.discovery import prepare

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"  # as on a robot
    prepare(local=False)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: a robot that outlives the judge would disturb the next run
    with claimed_domain() as domain:
        robot = Robot(domain, buttons=buttons)
        try:
            before = "start"
            while (task := tasks.get()) is not None:
                name, number = task
                if trouble := robot.drive():
                    results.put({"started again": before, "trouble": trouble})
                before = name
                results.put({"kind": name, "number": number, **inject(robot, name, f"{config.seed} {name} {number}")})
        except Exception:
            results.put({"failed": traceback.format_exc()})
        finally:
            robot.close()


def inject(robot: Robot, name: str, seed: str) -> dict[str, Any]:
    """Inject a fault until it is seen, and return why it was unsafe, and how late everything was."""
    result: dict[str, Any] = {}
    for attempt in range(TRIES):
        if attempt:
            robot.drive()
        since, rng, unseen = time.time(), random.Random(f"{seed} {attempt}" if attempt else seed), ""
        try:
            reasons = FAULTS[name](robot, rng)
            reasons += robot.judge(since)
        except Unseen as error:
            reasons = [unseen := f"not seen: {error}"]
        until = time.time()
        figures = robot.record.figures(since, until)
        result = {"unsafe": reasons, "seconds": until - since, **figures, "complaints": robot.ros.complaints(since)}
        with robot.lock:
            robot.record.forget()
        if not unseen:
            break
    return result


def kinds_of(only: tuple[str, ...]) -> list[str]:
    """Return the kinds of these names, else whose names begin so or which are in a group of that name; all without any.

    Raises:
        ValueError: If there is none of a name.
    """
    found = set[str]()
    for word in only:
        named = {word} & set(FAULTS) or {name for name in FAULTS if name.startswith(word)} | set(GROUPS.get(word, ()))
        if not named:
            raise ValueError(f"there is no kind of fault whose name begins with {word!r}, and no such group.")
        found |= named
    return [name for name in FAULTS if not only or name in found]


class Tally:
    """The counts by kind, and the file of what is finished."""

    def __init__(self, kinds: list[str], kept: Path | None) -> None:
        self.counts: dict[str, dict[str, Any]] = {
            name: {"injected": 0, "unsafe": 0, **dict.fromkeys(LONGEST, 0.0), "nearest": math.inf, "reasons": {}}
            for name in kinds
        }
        self.done: set[tuple[str, int]] = set()
        self._kept = kept
        if kept and kept.is_file():
            for line in kept.read_text(encoding="utf-8").splitlines():
                row = json.loads(line)
                if row["kind"] in self.counts:
                    self._count(row)

    def take(self, row: dict[str, Any]) -> None:
        """Count a finished fault, and keep it."""
        if self._kept:
            self._kept.parent.mkdir(parents=True, exist_ok=True)
            with self._kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        self._count(row)

    def _count(self, row: dict[str, Any]) -> None:
        self.done.add((row["kind"], row["number"]))
        kind = self.counts[row["kind"]]
        kind["injected"] += 1
        kind["unsafe"] += bool(row["unsafe"])
        for reason in row["unsafe"]:
            kind["reasons"][reason] = kind["reasons"].get(reason, 0) + 1
        kind["nearest"] = min(kind["nearest"], row["nearest"])
        for key in LONGEST:
            kind[key] = max(kind[key], row[key])


def inject_all(config: Config) -> Tally:
    """Inject all faults, each kind once in each round, and return the counts."""
    kinds = kinds_of(config.only)
    count, tally = math.ceil(config.faults / len(kinds)), Tally(kinds, config.kept)
    rounds = [random.Random(f"{config.seed} {number}").sample(kinds, len(kinds)) for number in range(count)]
    columns = *Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    with suppress(KeyboardInterrupt), Progress(*columns, console=Console(stderr=True)) as progress:  # the rest is reported
        wanted = [(name, number) for number, names in enumerate(rounds) for name in names]
        bar = progress.add_task("faults", total=len(wanted), completed=sum(task in tally.done for task in wanted))
        try:
            for numbers, crowd in parts_of(count, config):
                tasks = [task for task in wanted if task[1] in numbers and task not in tally.done]
                with busy(crowd if tasks else 0):
                    for row in results_of(tasks, config, progress):
                        tally.take(row)
                        progress.advance(bar)
        except RuntimeError as error:
            print(f"ended early: {error}", file=sys.stderr, flush=True)
    return tally


def parts_of(count: int, config: Config) -> list[tuple[range, int]]:
    """Return the rounds to inject at a time, with the number of busy processes beside them."""
    half = (count + 1) // 2
    return [(range(half), 0), (range(half, count), config.busy)]


def results_of(tasks: list[tuple[str, int]], config: Config, progress: Progress) -> Any:
    """Inject faults in parallel, and yield the result of each.

    Raises:
        RuntimeError: If a worker failed, or says nothing for 15 minutes.
    """
    spawn = multiprocessing.get_context("spawn")
    queues, results = {buttons: spawn.Queue() for buttons in (False, True)}, spawn.Queue()
    for task in tasks:
        queues[task[0] in BUTTONS].put(task)
    share = sum(name in BUTTONS for name, _ in tasks) / max(len(tasks), 1)
    workers = min(config.workers, len(tasks)) if share in (0.0, 1.0) else max(2, min(config.workers, len(tasks)))
    having = round(share * workers) if share in (0.0, 1.0) else min(max(1, round(share * workers)), workers - 1)
    processes = []
    for at in range(workers):
        queue = queues[at < having]
        processes.append(spawn.Process(target=work, daemon=True, args=(config, at < having, queue, results)))
        processes[-1].start()
        queue.put(None)
    try:
        done = 0
        while done < len(tasks):
            row = results.get(timeout=900.0)
            if "failed" in row:
                raise RuntimeError(row["failed"])
            if "trouble" in row:
                progress.print(f"after {row['started again']!r} the chain had to be started again: {row['trouble']}")
                continue
            done += 1
            if row["unsafe"]:
                progress.print(f"unsafe: {row['kind']!r}, {row['number']}: {'; '.join(row['unsafe'])}")
            yield row
    finally:
        for process in processes:
            process.join(timeout=20.0 if sys.exc_info()[0] is None else 1.0)
            if process.is_alive():
                process.terminate()


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the counts of all faults, and their table."""
    tally = inject_all(config)
    columns = "fault", "injected", "unsafe", "last motion, s", "zero, s", "overdue, s", "stop, s", "nearest, m"
    table = Table(*columns, caption="motion and zero: after the newest measurement; stop: after a fault that is a reason to")
    for name, kind in tally.counts.items():
        figures = (f"{kind[key]:.3f}" for key in (*LONGEST, "nearest"))
        table.add_row(name, f"{kind['injected']}", f"{kind['unsafe']}", *figures)
    total = {key: sum(kind[key] for kind in tally.counts.values()) for key in ("injected", "unsafe")}
    table.add_row("all", str(total["injected"]), str(total["unsafe"]))
    groups = {name: len(kinds) for name, kinds in GROUPS.items()}
    whole = {"faults": tally.counts, "total": total, "groups": groups, "settings": settings(), "load": os.getloadavg()}
    return whole, [table]


if __name__ == "__main__":
    options, results = run(Config, measure)
    raise SystemExit(results["total"]["unsafe"] > 0 or results["total"]["injected"] < options.faults)
