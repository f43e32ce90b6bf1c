"""Inject faults into live guards: real processes, real DDS, and an independent listener on ``/cmd_vel`` as the judge.

Each worker is a process with its own guard in its own ROS domain. It plays the sources of commands, every emergency-stop button
and the robot, see `faults_robot`. A motion is unsafe if the guard publishes it more than 0.45 s after the newest motion command
was sent (0.4 s, plus 0.05 s for a guard that loses its processor between decision and message), or after the fault forbids it.
Commands that a stopped process leaves on the wheels are not judged: no process can prevent them.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import random
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from faults_kinds import FAULTS, WITH_BUTTONS
from faults_robot import Robot
from harness.machine import busy
from turtlebot_gym_agents.provenance import settings_of, write_json

AGE = 0.45
"""Longest time after the newest command at which a motion may be published, s."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Inject faults into guards, and count unsafe motions."""

    faults: int = 1000
    """Number of faults, equal for each kind."""
    workers: int = 4
    """Number of guards at a time, at least 2: every second one has emergency stops."""
    busy: int = 2
    """Number of busy processes that run beside them."""
    seed: int = 0
    """Seed of the variations: durations, speeds, delays."""
    domain: int = 120
    """First of the ROS domains, one for each worker."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also write the results here."""


def work(at: int, config: Config, buttons: bool, tasks: Any, results: Any) -> None:
    """Inject the faults of one worker."""
    from turtlebot_gym_ros.base.discovery import prepare

    prepare()
    robot = Robot(config.domain + at, buttons=buttons)
    try:
        while (task := tasks.get()) is not None:
            name, number = task
            rng = random.Random(f"{config.seed} {name} {number}")
            robot.drive()
            since = time.time()
            beyond = FAULTS[name](robot, rng)
            robot.set()
            lag = robot.lag(since)
            results.put((name, beyond + (lag > AGE), lag, robot.hold(since)))
            if robot.guard.poll() is not None:
                raise RuntimeError("the guard has ended")
            del robot.heard[:-100], robot.sent[:-100]
    except Exception as error:
        results.put((None, repr(error), 0.0, 0.0))
    finally:
        robot.close()


def measure(config: Config) -> dict[str, dict[str, Any]]:
    """Inject all faults, and return the counts by kind."""
    spawn = multiprocessing.get_context("spawn")
    tasks, results = {buttons: spawn.Queue() for buttons in (False, True)}, spawn.Queue()
    order = [(name, number) for name in FAULTS for number in range(math.ceil(config.faults / len(FAULTS)))]
    random.Random(config.seed).shuffle(order)
    for name, number in order:
        tasks[FAULTS[name] in WITH_BUTTONS].put((name, number))
    share = [bool(at % 2) for at in range(config.workers)]
    workers = [spawn.Process(target=work, args=(at, config, on, tasks[on], results)) for at, on in enumerate(share)]
    for process in workers:
        process.start()
    for on in share:
        tasks[on].put(None)
    zero = {"injected": 0, "unsafe": 0, "longest_lag": 0.0, "longest_hold": 0.0}
    counts: dict[str, dict[str, Any]] = {name: dict(zero) for name in FAULTS}
    try:
        with busy(config.busy), Progress(console=Console(stderr=True)) as progress:
            bar = progress.add_task("faults", total=len(order))
            for _ in order:
                name, unsafe, lag, hold = results.get(timeout=240.0)
                if name is None:
                    raise RuntimeError(unsafe)
                kind = counts[name]
                kind["injected"] += 1
                kind["unsafe"] += unsafe > 0
                kind["longest_lag"] = max(kind["longest_lag"], lag)
                kind["longest_hold"] = max(kind["longest_hold"], hold)
                progress.advance(bar)
    finally:
        for process in workers:
            process.join(timeout=10.0)
            if process.is_alive():
                process.terminate()
    return counts


def main() -> int:
    """Measure, and print the table."""
    config = tyro.cli(Config, description=__doc__)
    counts = measure(config)
    table = Table("fault", "injected", "unsafe", "last motion sent, s", "zero sent, s", caption="after the newest command")
    for name, kind in counts.items():
        table.add_row(
            name, str(kind["injected"]), str(kind["unsafe"]), f"{kind['longest_lag']:.3f}", f"{kind['longest_hold']:.3f}"
        )
    total = {key: sum(kind[key] for kind in counts.values()) for key in ("injected", "unsafe")}
    table.add_row("all", str(total["injected"]), str(total["unsafe"]))
    Console().print(table)
    if config.json:
        load = os.getloadavg()
        write_json(config.json, {"faults": counts, "total": total, "load": load}, config=settings_of(config))
    return int(total["unsafe"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
