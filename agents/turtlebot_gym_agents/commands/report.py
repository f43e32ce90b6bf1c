"""Reports of evaluations: tables for the terminal, and figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from turtlebot_gym.plotting import comparison_figure, tutorial_figure
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, paired
from turtlebot_gym_agents.evaluation.metrics import Errors, Interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERRORS = (
    *("position mean, m", "position max, m", "position final, m"),
    *("heading mean, rad", "heading max, rad", "heading final, rad"),
)
"""Headings of `Errors`, each complete: a narrow terminal shows them in several tables."""

MORE = ("efficiency", "reached", "miss", "effort")
"""Numbers of a summary that are details."""


def evaluation_tables(evaluations: Mapping[str, Evaluation], *, title: str, details: bool = True) -> tuple[Table, ...]:
    """Return tables of results, and with details of the errors of estimate and odometry.

    Args:
        evaluations: Label and evaluation of each, on the same seeds.
        title: Title of the figure or table.
        details: Whether to return more than what decides between policies.
    """
    first = next(iter(evaluations.values()))
    details = details or first.config.get("switch") == "time"  # then no time decides
    columns = ("efficiency", "reached", "miss, m", "effort", "false arrivals, %") if details else ()
    driven = Table(
        "",
        "success, %",
        "to goal, s",
        "time*, s",
        "difference, s",
        *columns,
        title=title,
        caption="95 % intervals. * A failed episode counts as the time limit; difference: paired, from the first row",
    )
    estimate = Table("", *ERRORS, title="errors of the estimate, mean over episodes")
    odometry = Table("", *ERRORS, title="errors of raw odometry, mean over episodes")
    summaries = {label: evaluation.summary() for label, evaluation in evaluations.items()}
    for label, evaluation in evaluations.items():
        s = summaries[label]
        beside = [interval_cell(s[name], 3 if name == "efficiency" else 2, brief=True) for name in MORE]
        driven.add_row(
            label,
            "-" if evaluation.config.get("switch") == "time" else f"{s['success']:.1%}",
            interval_cell(s["time_to_goal"], 2),
            interval_cell(s["time"], 2),
            "" if evaluation is first else interval_cell(paired(evaluation, first), 2),
            *([*beside, f"{s['false_arrival']:.1%}"] if details else ()),
        )
        estimate.add_row(label, *error_cells(evaluation.episodes.estimate))
        odometry.add_row(label, *error_cells(evaluation.episodes.odometry))
    tables = [driven, estimate, odometry] if details else [driven]
    if all("collision" in summary for summary in summaries.values()):
        tables.insert(1, _rooms_table(summaries, details=details))
    if all("goals" in summary for summary in summaries.values()):
        tables.insert(1, _missions_table(summaries))
    return tuple(tables)


def _missions_table(summaries: Mapping[str, Mapping[str, Interval]]) -> Table:
    table = Table(
        "",
        "truly reached, %",
        "falsely, %",
        "truly reached an hour",
        "lost, % of the time",
        title="goals, of those given",
        caption="lost: the observed pose is more than 0.5 m off",
    )
    for label, s in summaries.items():
        true, false, lost = (f"{s[name]:.1%}" for name in ("goals", "false_goals", "lost"))
        table.add_row(label, true, false, interval_cell(s["goals_an_hour"], 1), lost)
    return table


def _rooms_table(summaries: Mapping[str, Mapping[str, Interval]], *, details: bool) -> Table:
    columns = ("BARN's score", "least clearance, m", "its 5th percentile, m") if details else ()
    table = Table("", "collision, %", "time-out, %", "SPL", *columns, title="in rooms")
    for label, s in summaries.items():
        shares = (f"{s[name]:.1%}" for name in ("collision", "timeout"))
        shown = ("spl", "barn", "clearance", "clearance_5th") if details else ("spl",)
        table.add_row(label, *shares, *(interval_cell(s[name], 3) for name in shown))
    return table


def evaluation_figure(evaluations: Mapping[str, Evaluation], *, title: str) -> Figure:
    """Return a figure of the first episode, or of the paths of several."""
    if len(evaluations) == 1:
        ((label, evaluation),) = evaluations.items()
        return tutorial_figure(evaluation.trajectory, title=f"{title}, {label}")
    return comparison_figure([(label, evaluation.trajectory) for label, evaluation in evaluations.items()], title=title)


def error_cells(errors: Errors) -> list[str]:
    """Return the means of errors as cells, in the order of `ERRORS`."""
    return [f"{np.mean(values):.3f}" for values in errors]


def interval_cell(interval: Interval, digits: int, *, brief: bool = False) -> str:
    """Return a number with the half width of its interval, unless it is to be brief, as a cell."""
    if not np.isfinite(interval.value):
        return "-"
    margin = 0.5 * (interval.high - interval.low)
    return f"{interval.value:.{digits}f}" + ("" if brief or not np.isfinite(margin) else f" ± {margin:.{digits}f}")
