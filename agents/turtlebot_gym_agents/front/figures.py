"""Plots of results. Each function draws into the given axes, with units, and returns them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.plotting import BLUE, PATHS, draw_map, draw_room, draw_trajectory
from turtlebot_gym_agents.evaluation.metrics import Interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_drive(axes: Axes, drive: Drive) -> Axes:
    """Draw a drive seen from above, with the walls and obstacles that it knows, and a legend."""
    draw_trajectory(axes, drive)
    if drive.around.room is not None:
        draw_room(axes, drive.around.room)
    if drive.around.grid is not None:
        draw_map(axes, drive.around.grid)
    if drive.outcome:
        axes.set_title(f"{drive.around.label}: {drive.outcome}".removeprefix(": "))
    axes.legend(fontsize="small")
    return axes


def draw_intervals(axes: Axes, intervals: Mapping[str, Interval], *, label: str) -> Axes:
    """Draw numbers with their 95 % intervals, one under the other.

    Args:
        axes: Axes to draw into.
        intervals: Number by name.
        label: What the number is, with its unit.
    """
    values, lows, highs = (np.array(numbers) for numbers in zip(*intervals.values(), strict=True))
    at = np.arange(len(values))
    axes.errorbar(values, at, xerr=(values - lows, highs - values), fmt="o", color=BLUE, capsize=3.0)
    axes.set_yticks(at, list(intervals))
    axes.set(xlabel=f"{label}, with 95 % intervals", ylim=(len(values) - 0.5, -0.5))
    axes.grid(axis="x", alpha=0.3)
    return axes


def draw_learning_curves(
    axes: Axes, steps: NDArray[np.float64], curves: Mapping[str, NDArray[np.float64]], mean: Sequence[Interval], *, label: str
) -> Axes:
    """Draw what trainings reach over their steps: each one, and with several their mean and its 95 % interval.

    Args:
        axes: Axes to draw into.
        steps: Environment steps of each evaluation, shape (k,).
        curves: Numbers of each training, by name, shape (k,).
        mean: Their mean at each evaluation, with its interval.
        label: What the number is, with its unit.
    """
    several = len(curves) > 1
    for (name, values), (color, style) in zip(curves.items(), PATHS[several:], strict=False):  # the mean has the first colour
        axes.plot(steps, values, color=color, linestyle=style, linewidth=0.8 if several else 1.8, label=name)
    if several:
        values, lows, highs = np.array(mean).T
        axes.plot(steps, values, color=BLUE, linewidth=2.2, marker="o", markersize=3.0, label=f"mean of {len(curves)} seeds")
        axes.fill_between(steps, lows, highs, color=BLUE, alpha=0.2, label="95 % interval of the mean")
    axes.set(xlabel="environment steps", ylabel=label)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    return axes
