"""Write the tables of the transfer study from `transfer.json` into its page: ``python benchmarks/transfer_text.py``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.tables import markdown
from publish import between
from turtlebot_gym_agents.evaluation.metrics import Interval

FLOORS = ("unicycle", "grip", "slippery")
RESULTS = Path(__file__).with_name("transfer.json")
PAGE = Path(__file__).parents[1] / "docs" / "concepts" / "transfer.md"
MARK = "<!-- {}, by benchmarks/transfer_text.py -->"
END = "<!-- The end of it -->"


def grouped(rows: list[Mapping[str, Any]]) -> Iterator[tuple[Mapping[str, Any], ...]]:
    """Yield the rows of the three floors together."""
    for at in range(0, len(rows), len(FLOORS)):
        yield tuple(rows[at : at + len(FLOORS)])


def policies(rows: list[Mapping[str, Any]]) -> str:
    """Return a table of successes, and of ratios of times to the unicycle's for episodes in which both succeed."""
    lines = []
    for several in grouped(rows):
        first = several[0]
        counts = [str(row["succeeded"]) for row in several]
        ratios = [row["where_both_succeed"]["ratio"] for row in several[1:]]
        times = [
            f"{ratio:.3f}" if ratio and row["where_both_succeed"]["n"] > 4 else ""
            for ratio, row in zip(ratios, several[1:], strict=True)
        ]
        task = first["env"].removeprefix("turtlebot_gym/TurtleBot").removesuffix("-v0")
        lines.append((task, first["policy"], first["noise"], *counts, *times))
    return markdown(("task", "policy", "noise", *FLOORS, "time, grip", "time, slippery"), lines)


def filters(rows: list[Mapping[str, Any]]) -> str:
    """Return a table of each filter's error on each floor, and its NEES."""
    lines = []
    names = dict.fromkeys((row["noise"], row["filter"]) for row in rows)
    for noise, name in names:
        cells, over = [], ""
        for floor in FLOORS:
            (one,) = (row for row in rows if (row["noise"], row["floor"], row["filter"]) == (noise, floor, name))
            cells.append(f"{one['position']['value']:.3f} m, {one['nees']['value']:.1f}")
            over = f"{Interval(**one['over_matched']):.2f}"
        lines.append((noise, name, *cells, over))
    return markdown(("noise", "filter", *FLOORS, "over matched, slippery"), lines)


def drifts(rows: list[Mapping[str, Any]]) -> str:
    """Return a table of wheel odometry's drift."""
    lines = []
    for row in rows:
        cells = [f"{Interval(**row[key]):.4f}" for key in ("position", "heading")]
        what = "unicycle, noise `wheel`" if row["floor"] == "unicycle" else f"MuJoCo, {row['floor']}"
        lines.append((what, *cells))
    return markdown(("", "m per metre", "rad per metre"), lines)


def texts(found: Mapping[str, Any]) -> dict[str, str]:
    """Return all tables by name."""
    return {
        "Policies": policies(found["policies"]),
        "Filters": filters(found["filters"]),
        "Drift": drifts(found["drift"]),
        "Trainings": policies(found["trained"]),
    }


def written(page: str, found: Mapping[str, Any]) -> str:
    """Return the page with the tables in their places."""
    for name, text in texts(found).items():
        page = between(page, text, MARK.format(name), END)
    return page


if __name__ == "__main__":
    PAGE.write_text(
        written(PAGE.read_text(encoding="utf-8"), json.loads(RESULTS.read_text(encoding="utf-8"))), encoding="utf-8"
    )
