"""The commands about speed: ``compile``, and ``benchmark``, whose program is in the repository's folder ``benchmarks/``."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from runpy import run_path

from turtlebot_gym.config import Range, as_int
from turtlebot_gym_agents.commands.console import File, JsonFile, WritingOptions, print_tables, progress

_BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
_PROGRAM = _BENCHMARKS / "harness" / "measure.py"


@dataclass(frozen=True, kw_only=True)
class Benchmark(WritingOptions):
    """Measure the speed of environments as ratios within one run, by wall time and CPU seconds.

    Needs a clone of the repository.
    """

    num_envs: tuple[int, ...] = (4096, 65536)
    """Sizes of the vector environments."""
    rounds: int = 7
    """Number of turns of each contender."""
    seconds: float = 0.5
    """Length of a turn, s."""
    busy: int = 0
    """Measure the most important rows again beside this many busy processes."""
    check: File = None
    """Instead, compare this package's ratios with those in this file from --json; the exit status is 1 if one got worse."""
    tolerance: float | None = None
    """Largest accepted loss with --check, as a share: by default 0.25."""
    json: JsonFile = None
    """Write the results here."""

    def run(self) -> None:
        if not _PROGRAM.is_file():
            raise ImportError(
                "benchmark needs a clone of the repository, installed with `pip install --editable .`: "
                "the harness is in its folder benchmarks/."
            )
        self._check_options()
        if str(_BENCHMARKS) not in sys.path:
            sys.path.append(str(_BENCHMARKS))
        run_path(str(_PROGRAM))["run"](self)

    def _check_options(self) -> None:
        if not self.num_envs or min(self.num_envs) < 2 or len({*self.num_envs}) < len(self.num_envs):
            raise ValueError(f"num_envs must be different numbers from 2 on, got {self.num_envs}.")
        as_int("rounds", self.rounds, 1)
        as_int("busy", self.busy)
        Range(0.0, 60.0, open_low=True, open_high=True).check("seconds", self.seconds)
        Range(0.0, 1.0, open_high=True).check("tolerance", self.tolerance or 0.0)
        if self.tolerance is not None and self.check is None:
            raise ValueError("tolerance changes nothing without --check: leave it out.")
        if self.json and self.check:
            raise ValueError("json changes nothing with --check, which writes no results: leave it out.")
        if self.busy and self.check:
            raise ValueError("busy changes nothing with --check: leave it out.")


_USUAL = ("nav", "kalman", "rooms-kalman")


@dataclass(frozen=True, kw_only=True)
class Compile:
    """Compile the loops of environments ahead of their first use: on a robot, in a container, before tests.

    All processes, clones and virtual environments of a user share them, in the user's folder for caches or in
    TURTLEBOT_GYM_CACHE_DIR. Without this command each is compiled when it is first used.
    """

    system: tuple[str, ...] = _USUAL
    """What to compile: nav, the default options on open ground; the task square with a filter (kalman, wheels, gated),
    FILTER+fixes with fixes in time; and rooms-FILTER, for any noise, robot and task."""
    all: bool = False
    """Compile all of them."""
    processes: int = os.cpu_count() or 1
    """Number of processes that compile at the same time."""

    def run(self) -> None:
        from rich.table import Table

        from turtlebot_gym.compiled.filling import SYSTEMS, fill_all
        from turtlebot_gym.compiled.store import folder

        if self.all and self.system != _USUAL:
            raise ValueError("system changes nothing with --all, which compiles every system: leave out one of them.")
        names = tuple(SYSTEMS) if self.all else tuple(dict.fromkeys(self.system))
        with progress(len(names)) as advance_to:
            times = fill_all(names, processes=min(self.processes, len(names)), progress=advance_to)
        table = Table("system", "compiled or loaded in, s", title=f"cache: {folder()}")
        for name, seconds in times.items():
            table.add_row(name, f"{seconds:.1f}")
        print_tables(table)
