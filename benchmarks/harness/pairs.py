"""This clone and another one of the repository, in pairs of turns: the ratio of their speeds by CPU seconds.

Each clone runs in a process of its own, by the same program, `harness.peer`. The two take turns one directly after the other,
first the one and then the other, so that a disturbance meets both.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from harness import peer
from harness.peers import Entry, Process
from harness.turns import calls_for

HERE = Path(__file__).parents[2]
PACKAGES = (".", "agents", "bridges/turtlebot_gym_ros")
"""Folders of a clone from which its packages are imported."""
TOLERANCE = 0.03
"""Tolerated loss of speed, as a share of it."""
NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"
ENTRIES = {
    "scalar": Entry(NAV, 1, "scalar"),
    "vector of 4096": Entry(NAV, 4096, "vector"),
    "vector of 4096, noise rough": Entry(NAV, 4096, "rough"),
    "vector of 4096, filter slip": Entry(NAV, 4096, "slip"),
    "rooms, vector of 512": Entry(ROOMS, 512, "vector"),
}
"""What is compared, by name."""


class Pair(NamedTuple):
    """Speed of this clone over that of the other one."""

    ratio: float
    """Median over the rounds, by CPU seconds."""
    ratio_range: tuple[float, float]
    """Quartiles over the rounds."""
    rounds: int
    """Number of rounds."""


def environment_of(folder: Path) -> dict[str, str]:
    """Return the environment variables with which Python imports a clone's packages, on one thread."""
    paths = os.pathsep.join(str(folder / package) for package in PACKAGES)
    return {**os.environ, "PYTHONPATH": paths, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def start(folder: Path, entry: Entry, log: Path) -> Process:
    """Start a clone's process.

    Raises:
        ValueError: If it imports the package from elsewhere.
        ChildProcessError: If it ends before it is ready.
    """
    program = [sys.executable, peer.__file__, "turtlebot_gym", *map(str, entry)]
    process = Process(program, log, env=environment_of(folder), cwd=log.parent)
    if not Path(process.versions["file"]).is_relative_to(folder):
        process.stop()
        raise ValueError(f"{folder} must be a clone of the repository; its process imports {process.versions['file']}.")
    return process


def compare(
    other: Path,
    names: Iterable[str] = ENTRIES,
    *,
    rounds: int,
    seconds: float,
    progress: Callable[[int], None] = lambda done: None,
) -> dict[str, Pair]:
    """Return this clone's speed over another one's.

    Args:
        other: The other clone.
        names: Which of `ENTRIES` to compare.
        rounds: Number of pairs of turns.
        seconds: Length of a turn, s.
        progress: Called with the number of finished pairs.
    """
    rows, done = {}, 0
    for name in names:
        with ExitStack() as stack:
            log = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            both = []
            for number, folder in enumerate((HERE, other.resolve())):
                both.append(start(folder, ENTRIES[name], log / f"{number}.log"))
                stack.callback(both[-1].stop)
            calls = calls_for(both[0].turn, seconds)
            ratios = []
            for at in range(rounds):
                first, second = both if at % 2 == 0 else reversed(both)
                turns = {id(process): process.turn(calls).cpu for process in (first, second)}
                ratios.append(turns[id(both[1])] / turns[id(both[0])])
                progress(done := done + 1)
        low, _, high = statistics.quantiles(ratios, n=4) if rounds > 1 else 3 * ratios
        rows[name] = Pair(statistics.median(ratios), (low, high), rounds)
    return rows
