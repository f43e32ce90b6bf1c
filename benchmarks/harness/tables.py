"""Tables of results in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from turtlebot_gym_agents.evaluation.metrics import Interval


def table(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    """Return a Markdown table of results as they stand in a JSON file.

    Args:
        rows: Results by name.
        columns: Format of the cells by title, such as ``"{success:.1%}"`` or ``"{baselines[0][time]:.2f} s"``. An object with
            value, low and high is an `Interval`. A cell that names what a row lacks stays empty.
    """
    lines = [[*columns], ["---"] * len(columns)]
    for row in rows:
        fields = {name: _with_intervals(value) for name, value in row.items()}
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
