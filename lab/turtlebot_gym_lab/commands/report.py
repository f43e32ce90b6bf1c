"""Reports of replayed drives and of filters: tables for the terminal, and a figure."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from turtlebot_gym_agents.commands.report import ERRORS, error_cells, interval_cell
from turtlebot_gym_agents.figures import CURVES, legends_below, plot_consistency
from turtlebot_gym_lab.evaluation.estimation import Estimation
from turtlebot_gym_lab.evaluation.replay import Replayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def replay_table(results: Mapping[str, Replayed], *, title: str) -> Table:
    """Return the errors of replayed drives, and their drift.

    Args:
        results: Name and result of each.
        title: Title of the figure or table.
    """
    table = Table(
        "",
        "",
        *ERRORS,
        "drift, m per metre",
        "drift, rad per metre",
        "NEES",
        title=title,
        caption="NEES of the pose, mean: 3 if the filter's covariance is right, more if it is too sure of itself",
    )
    for name, replayed in results.items():
        table.add_section()
        table.add_row(name, "measured pose", *error_cells(replayed.raw))
        table.add_row(
            "", "wheels alone", *error_cells(replayed.wheels), f"{replayed.drift:.3f}", f"{replayed.drift_heading:.3f}"
        )
        table.add_row("", "filter", *error_cells(replayed.filter), "", "", f"{np.mean(replayed.nees):.2f}")
    return table


def estimation_table(result: Estimation) -> Table:
    """Return a table of filters' errors against the bound, and of their consistency."""
    config, (low, high) = result.config, result.band
    table = Table(
        "",
        "x, m",
        "y, m",
        "heading, rad",
        "x over the bound",
        "y over the bound",
        "heading over the bound",
        "NEES",
        "NIS",
        "beyond 3 sigma, %",
        "correlation",
        title=f"noise {config['noise']}, {config['runs']} drives of {config['seconds']:g} s from seed {config['seed']}",
        caption=f"RMSE at the end, with 95 % intervals; NEES of the pose: 3, here {low:.2f} to {high:.2f} of a consistent "
        "filter, which is beyond 3 sigma in 0.8 % of the time; correlation of successive innovations: 0",
    )
    table.add_row("bound", *(f"{number:.4f}" for number in result.bound[-1]))
    for name, errors in result.filters.items():
        table.add_row(
            name,
            *(f"{number:.4f}" for number in errors.rmse[-1]),
            *(interval_cell(ratio, 3) for ratio in errors.ratio),
            interval_cell(errors.nees, 2),
            interval_cell(errors.nis, 2),
            f"{100.0 * errors.outside:.1f}",
            f"{max(errors.correlation, key=abs):.2f}",
        )
    return table


def estimation_figure(result: Estimation) -> Figure:
    """Return a figure of all filters over time: RMSE of position and heading, NEES and NIS, each with its bound."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 7.2), layout="constrained")
    panels = figure.subplots(2, 2)
    for axes, columns, label in zip(panels[0], (slice(0, 2), slice(2, 3)), ("position (m)", "heading (rad)"), strict=True):
        for (name, errors), (color, style) in zip(result.filters.items(), cycle(CURVES), strict=False):
            rmse = np.sqrt((errors.rmse[:, columns] ** 2).sum(axis=1))
            axes.plot(result.time, rmse, color=color, linestyle=style, label=name)
        axes.plot(
            result.time,
            np.sqrt((result.bound[:, columns] ** 2).sum(axis=1)),
            "k:",
            linewidth=2.5,
            label="least RMSE of any filter",
        )
        axes.set(xlabel="time (s)", ylabel=f"RMSE of the {label}", ylim=(0.0, None))
        axes.grid(alpha=0.3)
    for at, (name, errors) in enumerate(result.filters.items()):
        for axes, values, kind in zip(panels[1], (errors.nees_by_time, errors.nis_by_time), ("NEES", "NIS"), strict=True):
            plot_consistency(axes, result.time, values, runs=result.config["runs"], name=kind, label=name, at=at)
    for axes, name in zip(panels[1], ("NEES of the pose", "NIS of measurements"), strict=True):
        axes.set_title(f"{name} (above the band: too sure)", fontsize=10)
    figure.suptitle(f"noise {result.config['noise']}, {result.config['runs']} drives")
    return legends_below(figure)
