"""Inject faults into live robots' chains: real processes, real DDS, and an independent listener on ``/cmd_vel`` as the judge.

Each worker has a robot of its own in its own ROS domain: filter, controller, guard with collision monitor and standby, see
`faults_robot`. A motion is unsafe if it is published more than 0.6 s after the newest measurement or person's command that it
can rest on (0.5 s, plus 0.1 s for a guard that loses its processor between decision and message), or if the fault forbids it:
after a stop that nobody ended, or towards a wall inside the stopping zone. A motion counts by DDS's source time; one that comes
out later, since the guard was suspended while it wrote it, is unsafe if no zero follows within 0.1 s. The second half runs
beside busy processes.
"""

from __future__ import annotations

import ctypes
import math
import multiprocessing
import os
import random
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from faults_kinds import FAULTS, WITH_BUTTONS
from faults_robot import Robot
from harness.machine import busy
from harness.study import Study, run

AGE = 0.6
"""Longest time after the newest measurement at which a motion may be published, s."""
REVIVED = 0.1
"""Longest time until a zero follows a motion that comes out later than that, s."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Inject faults into robots' chains, and count unsafe motions."""

    faults: int = 40 * len(FAULTS)
    """Number of faults, equal for each kind."""
    only: tuple[str, ...] = ()
    """Kinds to inject, by the beginnings of their names; none for all."""
    workers: int = 5
    """Number of robots at a time, at least 2: some have emergency stops, in proportion to the faults of buttons."""
    busy: int = 4
    """Number of busy processes beside the second half of the faults."""
    seed: int = 0
    """Seed of the variations: durations, speeds, delays."""
    domain: int = 120
    """First of the ROS domains, one for each worker."""


def work(domain: int, config: Config, buttons: bool, tasks: Any, results: Any) -> None:
    """Inject the faults of one worker."""
    from turtlebot_gym_ros.base.discovery import prepare

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"  # as on a robot
    prepare(local=False)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: a robot that outlives the judge would disturb the next run
    robot, before = Robot(domain, buttons=buttons), "start"
    try:
        while (task := tasks.get()) is not None:
            name, number = task
            rng = random.Random(f"{config.seed} {name} {number}")
            if trouble := robot.drive():
                results.put((before, trouble, {}))
            before, since = name, time.time()
            beyond = FAULTS[name](robot, rng)
            lag, revived = robot.record.lag(since), robot.record.revived(since, AGE)
            longest = {"longest_lag": lag, "longest_hold": robot.record.hold(since), "longest_revived": revived}
            longest["longest_stop"] = robot.record.stop()
            if unsafe := beyond + (lag > AGE) + (revived > REVIVED):
                print(f"unsafe: {name!r}, {number}: {beyond}, {longest}", file=sys.stderr, flush=True)
            results.put((name, unsafe, longest))
            with robot.lock:
                robot.record.forget()
    except Exception as error:
        results.put((None, f"{type(error).__name__}: {error}", {}))
    finally:
        robot.close()


def inject_all(config: Config) -> tuple[dict[str, dict[str, Any]], dict[str, int]]:
    """Inject all faults, and return the counts by kind, and after which the chain had to be started again, how often."""
    kinds = [name for name in FAULTS if not config.only or name.startswith(config.only)]
    count = math.ceil(config.faults / len(kinds))
    order = [(name, number) for number in range(count) for name in kinds]
    zero = {"injected": 0, "unsafe": 0, "longest_lag": 0.0, "longest_hold": 0.0, "longest_revived": 0.0, "longest_stop": 0.0}
    counts: dict[str, dict[str, Any]] = {name: dict(zero) for name in kinds}
    stuck: dict[str, int] = {}
    half = count // 2 * len(kinds)
    with suppress(KeyboardInterrupt), Progress(console=Console(stderr=True)) as progress:  # the rest is reported
        bar = progress.add_task("faults", total=len(order))
        try:
            for part, crowd in ((order[:half], 0), (order[half:], config.busy)):
                if not part:
                    continue
                with busy(crowd):
                    _inject(part, config, counts, stuck, lambda: progress.advance(bar))
        except RuntimeError as error:
            print(f"ended early: {error}", file=sys.stderr, flush=True)
    return counts, stuck


def _inject(
    order: list[tuple[str, int]], config: Config, counts: dict[str, dict[str, Any]], stuck: dict[str, int], advance: Any
) -> None:
    """Inject faults in parallel, and add them to the counts, and to those after which the chain had to be started again."""
    random.Random(config.seed).shuffle(order)
    spawn = multiprocessing.get_context("spawn")
    tasks, results = {buttons: spawn.Queue() for buttons in (False, True)}, spawn.Queue()
    for name, number in order:
        tasks[name in WITH_BUTTONS].put((name, number))
    workers = []
    share = sum(name in WITH_BUTTONS for name, _ in order) / len(order)
    having = min(max(1, round(share * config.workers)), config.workers - 1)
    for at in range(config.workers):
        on = at < having
        workers.append(spawn.Process(target=work, daemon=True, args=(config.domain + at, config, on, tasks[on], results)))
    for process in workers:
        process.start()
    for at in range(config.workers):
        tasks[at < having].put(None)
    try:
        done = 0
        while done < len(order):
            name, unsafe, longest = results.get(timeout=900.0)
            if name is None:
                raise RuntimeError(unsafe)
            if isinstance(unsafe, str):
                print(f"after {name!r} the chain had to be started again: {unsafe}", file=sys.stderr, flush=True)
                stuck[name] = stuck.get(name, 0) + 1
                continue
            done += 1
            if done % 50 == 0:
                print(f"{done} of {len(order)} faults", file=sys.stderr, flush=True)
            kind = counts[name]
            kind["injected"] += 1
            kind["unsafe"] += unsafe > 0
            for key, value in longest.items():
                kind[key] = max(kind[key], value)
            advance()
    finally:
        for process in workers:
            process.join(timeout=10.0)
            if process.is_alive():
                process.terminate()


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the counts of all faults, and their table."""
    counts, stuck = inject_all(config)
    columns = "fault", "injected", "unsafe", "last motion, s", "zero, s", "zero after a motion that came out late, s", "stop, s"
    table = Table(*columns, caption="motion and zero: after the newest measurement; stop: after a fault that is a reason to")
    for name, (injected, unsafe, *longest) in ((name, kind.values()) for name, kind in counts.items()):
        table.add_row(name, f"{injected}", f"{unsafe}", *(f"{duration:.3f}" for duration in longest))
    total = {key: sum(kind[key] for kind in counts.values()) for key in ("injected", "unsafe")}
    table.add_row("all", str(total["injected"]), str(total["unsafe"]))
    return {"faults": counts, "total": total, "started again": stuck, "load": os.getloadavg()}, [table]


if __name__ == "__main__":
    options, results = run(Config, measure)
    raise SystemExit(results["total"]["unsafe"] > 0 or results["total"]["injected"] < options.faults)
