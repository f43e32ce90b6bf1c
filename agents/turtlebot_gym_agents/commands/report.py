"""Reports of results: tables for the terminal, and figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from turtlebot_gym.plotting import PATHS, comparison_figure, legend_below, tutorial_figure
from turtlebot_gym_agents.evaluation.estimation import Estimation
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, paired
from turtlebot_gym_agents.evaluation.metrics import Errors, Interval
from turtlebot_gym_agents.evaluation.replay import Replayed

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
        "", "success, %", "to goal, s", "time*, s", "minus first, s", *columns,
        title=title, caption="with 95 % intervals; * failures count as the time limit; minus first: of that time, in pairs",
    )  # fmt: skip
    estimate = Table("", *ERRORS, title="errors of the estimate, mean over episodes")
    odometry = Table("", *ERRORS, title="errors of raw odometry, mean over episodes")
    summaries = {label: evaluation.summary() for label, evaluation in evaluations.items()}
    for label, evaluation in evaluations.items():
        s = summaries[label]
        beside = [_number(s[name], 3 if name == "efficiency" else 2, brief=True) for name in MORE]
        driven.add_row(
            label,
            "-" if evaluation.config.get("switch") == "time" else f"{s['success']:.1%}",
            _number(s["time_to_goal"], 2),
            _number(s["time"], 2),
            "" if evaluation is first else _number(paired(evaluation, first), 2),
            *([*beside, f"{s['false_arrival']:.1%}"] if details else ()),
        )
        estimate.add_row(label, *_errors(evaluation.episodes.estimate))
        odometry.add_row(label, *_errors(evaluation.episodes.odometry))
    tables = [driven, estimate, odometry] if details else [driven]
    if all("collision" in summary for summary in summaries.values()):
        tables.insert(1, _rooms_table(summaries, details=details))
    if all("goals" in summary for summary in summaries.values()):
        tables.insert(1, _missions_table(summaries))
    return tuple(tables)


def _missions_table(summaries: Mapping[str, Mapping[str, Interval]]) -> Table:
    table = Table(
        "", "truly reached, %", "falsely, %", "truly reached an hour", "lost, % of the time",
        title="goals, of those given", caption="lost: the observed pose is more than 0.5 m off",
    )  # fmt: skip
    for label, s in summaries.items():
        true, false, lost = (f"{s[name]:.1%}" for name in ("goals", "false_goals", "lost"))
        table.add_row(label, true, false, _number(s["goals_an_hour"], 1), lost)
    return table


def _rooms_table(summaries: Mapping[str, Mapping[str, Interval]], *, details: bool) -> Table:
    columns = ("BARN's score", "least clearance, m", "its 5th percentile, m") if details else ()
    table = Table("", "collision, %", "time-out, %", "SPL", *columns, title="in rooms")
    for label, s in summaries.items():
        shares = (f"{s[name]:.1%}" for name in ("collision", "timeout"))
        shown = ("spl", "barn", "clearance", "clearance_5th") if details else ("spl",)
        table.add_row(label, *shares, *(_number(s[name], 3) for name in shown))
    return table


def evaluation_figure(evaluations: Mapping[str, Evaluation], *, title: str) -> Figure:
    """Return a figure of the first episode, or of the paths of several."""
    if len(evaluations) == 1:
        ((label, evaluation),) = evaluations.items()
        return tutorial_figure(evaluation.trajectory, title=f"{title}, {label}")
    return comparison_figure([(label, evaluation.trajectory) for label, evaluation in evaluations.items()], title=title)


def replay_table(results: Mapping[str, Replayed], *, title: str) -> Table:
    """Return the errors of replayed drives, and their drift.

    Args:
        results: Name and result of each.
        title: Title of the figure or table.
    """
    table = Table("", "", *ERRORS, "drift, m per metre", "drift, rad per metre", title=title)
    for name, replayed in results.items():
        table.add_section()
        table.add_row(name, "measured pose", *_errors(replayed.raw))
        table.add_row("", "wheels alone", *_errors(replayed.wheels), f"{replayed.drift:.3f}", f"{replayed.drift_heading:.3f}")
        table.add_row("", "filter", *_errors(replayed.filter))
    return table


def estimation_table(result: Estimation) -> Table:
    """Return a table of filters' errors against the bound, and of their consistency."""
    config, (low, high) = result.config, result.band
    table = Table(
        "", "x, m", "y, m", "heading, rad", "x over the bound", "y over the bound", "heading over the bound", "NEES", "NIS",
        "beyond 3 sigma, %", "correlation",
        title=f"noise {config['noise']}, {config['runs']} drives of {config['seconds']:g} s from seed {config['seed']}",
        caption=f"RMSE at the end, with 95 % intervals; NEES of the pose: 3, here {low:.2f} to {high:.2f} of a consistent "
        "filter, which is beyond 3 sigma in 0.8 % of the time; correlation of successive innovations: 0",
    )  # fmt: skip
    table.add_row("bound", *(f"{number:.4f}" for number in result.bound[-1]))
    for name, errors in result.filters.items():
        table.add_row(
            name,
            *(f"{number:.4f}" for number in errors.rmse[-1]),
            *(_number(ratio, 3) for ratio in errors.ratio),
            _number(errors.nees, 2),
            _number(errors.nis, 2),
            f"{100.0 * errors.outside:.1f}",
            f"{max(errors.correlation, key=abs):.2f}",
        )
    return table


def estimation_figure(result: Estimation) -> Figure:
    """Return a figure of the RMSE of position and heading over time, of all filters and the bound."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    sides = figure.subplots(1, 2)
    for axes, columns, label in zip(sides, (slice(0, 2), slice(2, 3)), ("position (m)", "heading (rad)"), strict=True):
        for (name, errors), (color, style) in zip(result.filters.items(), PATHS, strict=False):
            rmse = np.sqrt((errors.rmse[:, columns] ** 2).sum(axis=1))
            axes.plot(result.time, rmse, color=color, linestyle=style, label=name)
        axes.plot(result.time, np.sqrt((result.bound[:, columns] ** 2).sum(axis=1)), "k:", linewidth=2.5, label="bound")
        axes.set(xlabel="time (s)", ylabel=f"RMSE of the {label}", ylim=(0.0, None))
        axes.grid(alpha=0.3)
    legend_below(figure, columns=6)
    figure.suptitle(f"noise {result.config['noise']}, {result.config['runs']} drives")
    return figure


def _errors(errors: Errors) -> list[str]:
    return [f"{np.mean(values):.3f}" for values in errors]


def _number(interval: Interval, digits: int, *, brief: bool = False) -> str:
    if not np.isfinite(interval.value):
        return "-"
    margin = 0.5 * (interval.high - interval.low)
    return f"{interval.value:.{digits}f}" + ("" if brief or not np.isfinite(margin) else f" ± {margin:.{digits}f}")
