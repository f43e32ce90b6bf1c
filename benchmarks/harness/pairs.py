"""This clone and another one of the repository, in pairs of turns: the ratio of their speeds by CPU seconds.

Each clone runs in a process of its own, by the same program, `harness.clone`. The two take turns one directly after the other,
first the one and then the other, so that a disturbance meets both.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from harness import clone
from harness.turns import Turn, calls_for

HERE = Path(__file__).parents[2]
PACKAGES = (".", "agents", "bridges/turtlebot_gym_ros")
"""Folders of a clone from which its packages are imported."""
TOLERANCE = 0.03
"""Tolerated loss of speed, as a share of it."""

NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"


class Entry(NamedTuple):
    """Environment of a comparison."""

    env_id: str
    """Environment."""
    size: int
    """Number of environments stepped together."""
    form: str
    """Form of a call, see `harness.clone`."""


ENTRIES = {
    "scalar": Entry(NAV, 1, "scalar"),
    "vector of 4096": Entry(NAV, 4096, "vector"),
    "vector of 4096, noise rough": Entry(NAV, 4096, "rough"),
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


class Process:
    """Process of a clone or of a peer, which waits for its turns.

    Args:
        command: Command that starts the process.
        log: File for its standard error.
        options: Passed on to `subprocess.Popen`.

    Raises:
        ChildProcessError: If the process ends before it is ready.
    """

    def __init__(self, command: Sequence[str], log: Path, **options: Any) -> None:
        self._log = log
        with log.open("w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, **options
            )
        try:
            self.ready: dict[str, Any] = self._read("ready")
        except BaseException:
            self.stop()
            raise

    def turn(self, calls: int) -> Turn:
        """Make a number of calls."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{calls}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # the process has ended, which reading detects
        return Turn(*self._read("turn"))

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def _read(self, word: str) -> Any:
        """Return the rest of the line that starts with a word; libraries may print other lines."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(f"{word} "):
                return json.loads(line.removeprefix(word))
        last = self._log.read_text(encoding="utf-8", errors="replace").strip().rpartition("\n")[2] or "there was no output."
        raise ChildProcessError(f"The process has ended with status {self._process.wait()}: {last}")


def environment_of(folder: Path) -> dict[str, str]:
    """Return the environment variables with which Python imports a clone's packages, on one thread; earlier ones have numba."""
    paths = os.pathsep.join(str(folder / package) for package in PACKAGES)
    one = dict.fromkeys(("TURTLEBOT_GYM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    return {**os.environ, "PYTHONPATH": paths, **one}


def start(folder: Path, entry: Entry, log: Path) -> Process:
    """Start a clone's process.

    Raises:
        ValueError: If it imports the package from elsewhere.
        ChildProcessError: If it ends before it is ready.
    """
    program = [sys.executable, clone.__file__, *map(str, entry)]
    process = Process(program, log, env=environment_of(folder), cwd=log.parent)
    if not Path(process.ready["file"]).is_relative_to(folder):
        process.stop()
        raise ValueError(f"{folder} must be a clone of the repository; its process imports {process.ready['file']}.")
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
