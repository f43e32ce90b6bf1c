"""Tables of results in Markdown, for the terminal and the pages: `docs/generate/tables.yaml` names rows and columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from turtlebot_gym_agents.evaluation.metrics import Interval

PAGES = Path(__file__).parents[2] / "docs" / "generate" / "tables.yaml"


def tables_of(name: str, results: Mapping[str, Any]) -> dict[str, str]:
    """Return the tables that pages show of the results in NAME.json, by their names."""
    made = {}
    for title, wanted in yaml.safe_load(PAGES.read_text(encoding="utf-8")).items():
        file, *steps = wanted["rows"].split("/")
        if file == name and steps[0] in results:
            made[title] = table(_rows_at(results, steps), wanted["columns"])
    return made


def _rows_at(found: Any, steps: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the rows that a path leads to; the keys at ``*NAME`` become a cell of each row under them."""
    if not steps:
        yield from found if isinstance(found, list) else [found]
        return
    step, *rest = steps
    if not step.startswith("*"):
        yield from _rows_at(found[step], rest)
        return
    for key, value in found.items():
        for row in _rows_at(value if isinstance(value, dict) else {"value": value}, rest):
            yield {step[1:]: key, **row}


def table(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    """Return a Markdown table of rows, by formats of cells, such as ``"{success:.1%}"`` or ``"{baselines[0][time]:.2f} s"``.

    An object with value, low and high is an `Interval`. A cell that names what a row lacks stays empty.
    """
    lines = [[*columns], ["---"] * len(columns)]
    for row in rows:
        fields = _with_intervals(row)
        lines.append([_cell(text, fields) for text in columns.values()])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _with_intervals(value: Any) -> Any:
    if isinstance(value, Mapping):
        if value.keys() == {"value", "low", "high"}:
            return Interval(**value)
        return {name: _with_intervals(part) for name, part in value.items()}
    return [_with_intervals(part) for part in value] if isinstance(value, list) else value


def _cell(text: str, fields: Mapping[str, Any]) -> str:
    try:
        return text.format(**fields)
    except (KeyError, IndexError, TypeError):  # an absent field, or None in its place
        return ""
