"""The subcommand ``compile``."""

from __future__ import annotations

import os
from dataclasses import dataclass

from turtlebot_gym_agents.commands.console import print_tables, progress


@dataclass(frozen=True, kw_only=True)
class Compile:
    """Compile the loops of environments ahead of their first use: on a robot, in a container, before tests.

    All processes, clones and virtual environments of a user share them, in the user's folder for caches or in
    NUMBA_CACHE_DIR. Without this command each is compiled when it is first used.
    """

    system: tuple[str, ...] = ("nav", "kalman", "rooms-kalman")
    """What to compile: nav, the default options on open ground; a filter on open ground (kalman, wheels, gated, mixture, slip,
    scale), for any noise, robot and task, FILTER+fixes with fixes in time, and rooms-FILTER."""
    all: bool = False
    """Compile all of them."""
    processes: int = os.cpu_count() or 1
    """Number of processes that compile at the same time."""

    def run(self) -> None:
        from rich.table import Table

        from turtlebot_gym.compiled.filling import SYSTEMS, fill_all
        from turtlebot_gym.compiled.store import folder

        names = tuple(SYSTEMS) if self.all else tuple(dict.fromkeys(self.system))
        with progress(len(names)) as advance_to:
            times = fill_all(names, processes=min(self.processes, len(names)), progress=advance_to)
        table = Table("system", "compiled or loaded in, s", title=f"cache: {folder()}")
        for name, seconds in times.items():
            table.add_row(name, f"{seconds:.1f}")
        print_tables(table)
