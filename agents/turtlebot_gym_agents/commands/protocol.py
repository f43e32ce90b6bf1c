"""The subcommand ``protocol``: an entry in the benchmark, and the table of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from turtlebot_gym.validation import choose
from turtlebot_gym_agents.commands.console import JsonFile, Reporting, print_tables, progress


@dataclass(frozen=True, kw_only=True)
class Entry(Reporting):
    """Drive a policy through the fixed settings of the benchmark protocol, or print the table of entries."""

    action: tyro.conf.Positional[str] = "table"
    """run or table."""
    entries: tyro.conf.Positional[tuple[Path, ...]] = ()
    """For table: entries, FILE.json."""
    policy: str = "bearing"
    """For run: a policy as for evaluate; it drives in the settings that it can enter."""
    filter: str = "matched"
    """For run: a filter, or one of your own (MODULE:NAME)."""
    localizer: str | None = None
    """For run: a localizer; it enters missions only, the setting on wheel odometry."""
    json: JsonFile = None
    """For run: write the entry here."""

    def run(self) -> None:
        from turtlebot_gym_agents.evaluation import protocol

        choose("action", self.action, dict.fromkeys(("run", "table")))
        if self.action == "table":
            if not self.entries:
                raise ValueError("name the entries of the table, FILE.json ...")
            _print([protocol.read_entry(path) for path in self.entries])
            return
        if self.entries:
            raise ValueError(f"run takes no entries, got {self.entries[0]}; did you mean table?")
        total = sum(setting.episodes for setting in protocol.settings_for(self.policy, self.localizer).values())
        with progress(total) as advance_to:
            entry = protocol.run(self.policy, filter=self.filter, localizer=self.localizer, progress=advance_to)
        _print([entry])
        self.report(entry, {"policy": self.policy, "filter": self.filter, "localizer": self.localizer})


def _print(entries: Sequence[dict[str, Any]]) -> None:
    from rich.table import Table

    from turtlebot_gym_agents.evaluation import protocol

    table = Table(
        "setting", "entry", "success or goals, %", "time*, s", "collision, %", "lost, % of the time", "estimate off by, m",
        title=protocol.FORMAT, caption="with 95 % intervals; * failures count as the time limit",
    )  # fmt: skip
    for name in protocol.SETTINGS:
        table.add_section()
        for entry in entries:
            if row := entry["rows"].get(name):
                reached = row.get("goals", row["success"])
                shares = (_ends(part, 1, 100.0) for part in (reached, row.get("collision"), row.get("lost")))
                success, collision, lost = shares
                error = _ends(row["estimate_position_mean"], 3)
                made = ", ".join(filter(None, map(entry["entry"].get, ("policy", "filter", "localizer"))))
                table.add_row(name, made, success, _ends(row["time"], 2), collision, lost, error)
    print_tables(table, keys=2)


def _ends(interval: Mapping[str, Any] | None, digits: int, factor: float = 1.0) -> str:
    if interval is None or interval["value"] is None:
        return ""
    ends = (interval[name] for name in ("value", "low", "high"))
    value, low, high = (None if end is None else f"{factor * end:.{digits}f}" for end in ends)
    return f"{value}" if low is None else f"{value} ({low}, {high})"
