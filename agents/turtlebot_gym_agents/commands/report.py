"""Reports of evaluations: tables for the terminal, and figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from turtlebot_gym_agents.evaluation.evaluate import paired
from turtlebot_gym_agents.evaluation.metrics import Errors, Interval
from turtlebot_gym_agents.evaluation.result import Evaluation
from turtlebot_gym_agents.figures import drives_figure, legends_below, plot_consistency

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERRORS = (
    *("position mean, m", "position max, m", "position final, m"),
    *("heading mean, rad", "heading max, rad", "heading final, rad"),
)
"""Headings of `Errors`, each complete: a narrow terminal shows them in several tables."""

STEERED = {"ekf": "the estimate", "odometry": "raw odometry", "truth": "the true pose", "located": "the localizer's pose"}
"""What a policy steers by, by the name of the observation."""

BRIEF = {"efficiency": 3, "reached": 2, "miss": 2, "effort": 2}
"""Numbers of a summary that are details, with their digits."""


def evaluation_tables(evaluations: Mapping[str, Evaluation], *, title: str, details: bool = True) -> tuple[Table, ...]:
    """Return tables of results by label, on the same seeds; with details, of more than what decides between policies.

    Where waypoints follow by time, how near the robot comes to them decides, and no success or time.
    """
    first = next(iter(evaluations.values()))
    by_time = first.config.get("switch") == "time"
    columns = ("miss, m", "false arrivals, %", "reached", "effort")
    if not by_time:
        columns = ("success, %", "to goal, s", "time*, s", "difference, s", *(("efficiency", *columns) if details else ()))
    starred = "* A failed episode counts as the time limit; difference: paired, from the first row"
    driven = Table("", *columns, title=title, caption="means over episodes" if by_time else f"95 % intervals. {starred}")
    estimate = Table("", *ERRORS, title="errors of the estimate, mean over episodes")
    odometry = Table("", *ERRORS, title="errors of raw odometry, mean over episodes")
    summaries = {label: evaluation.summary() for label, evaluation in evaluations.items()}
    for label, evaluation in evaluations.items():
        s = summaries[label]
        cells = {name: interval_cell(s[name], digits, brief=True) for name, digits in BRIEF.items()}
        cells |= {"false arrivals, %": f"{s['false_arrival']:.1%}", "success, %": f"{s['success']:.1%}"}
        cells |= {"to goal, s": interval_cell(s["time_to_goal"], 2), "time*, s": interval_cell(s["time"], 2)}
        cells["miss, m"] = cells["miss"]
        cells["difference, s"] = "" if evaluation is first else interval_cell(paired(evaluation, first), 2)
        driven.add_row(label, *(cells[str(column.header)] for column in driven.columns[1:]))
        estimate.add_row(label, *error_cells(evaluation.episodes.estimate))
        odometry.add_row(label, *error_cells(evaluation.episodes.odometry))
    tables = [driven, estimate, odometry] if details or by_time else [driven]
    if all("collision" in summary for summary in summaries.values()):
        tables.insert(1, _rooms_table(summaries, details=details))
    if all("goals" in summary for summary in summaries.values()):
        tables.insert(1, _missions_table(summaries))
    return tuple(tables)


def _missions_table(summaries: Mapping[str, Mapping[str, Interval]]) -> Table:
    columns = ("truly reached, %", "falsely, %", "truly reached an hour", "lost, % of the time")
    table = Table("", *columns, title="goals, of those given", caption="lost: the observed pose is more than 0.5 m off")
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
    """Return a figure of the first episode of each evaluation, and of the filters' consistency where it was computed."""
    judged = {label: each.consistency for label, each in evaluations.items() if each.consistency is not None}
    measured = {label: each for label, each in judged.items() if np.nansum(each.nis) > 0.0}  # wheels alone have no innovation
    below = ["NEES of the pose"] * bool(judged) + ["NIS of measurements"] * bool(measured)
    steered = [STEERED.get(str(each.config.get("observation", "ekf")), "their observation") for each in evaluations.values()]
    is_same = len(set(steered)) == 1
    drives = {
        label if is_same else f"{label}: steers by {by}": each.trajectory
        for (label, each), by in zip(evaluations.items(), steered, strict=True)
    }
    title = f"{title}; driven by {steered[0]}" if is_same else title
    figure, panels = drives_figure(drives, title=title, below=below)
    for at, (label, each) in enumerate(judged.items()):
        plot_consistency(panels[below[0]], each.time, each.nees, name="NEES", label=label, at=at)
        if label in measured:
            plot_consistency(panels[below[1]], each.time, each.nis, name="NIS", label=label, at=at)
    for name, axes in panels.items():
        axes.set_title(f"{name} (above the band: too sure)", fontsize=10)
    return legends_below(figure)


def error_cells(errors: Errors) -> list[str]:
    """Return the means of errors as cells, in the order of `ERRORS`."""
    return [f"{np.mean(values):.3f}" for values in errors]


def interval_cell(interval: Interval, digits: int, *, brief: bool = False) -> str:
    """Return a number with the half width of its interval, unless it is to be brief, as a cell."""
    if not np.isfinite(interval.value):
        return "-"
    margin = 0.5 * (interval.high - interval.low)
    return f"{interval.value:.{digits}f}" + ("" if brief or not np.isfinite(margin) else f" ± {margin:.{digits}f}")
