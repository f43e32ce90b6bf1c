"""Figures of drives, filters and trainings.

Every ``plot_`` function draws into the axes that it is given and returns them; the ``_figure`` functions arrange such axes.
Colours are those of `turtlebot_gym.plotting`; line styles differ, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.plotting import (
    BLUE,
    ORANGE,
    PATHS,
    PURPLE,
    draw_map,
    draw_panels,
    draw_places,
    draw_room,
    draw_trajectory,
    legend_below,
)
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.record import DEGREES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURVES = [(color, style) for color, style in PATHS if color in (BLUE, PURPLE, ORANGE)]
"""Colours and line styles of policies, filters and trainings; the other colours stand for truth, estimate and odometry."""
_BAND = "#777777"
FALSE_ALARM = 0.05
"""Share of consistent filters whose mean is outside of the bounds at a time."""
_MARGIN, _MARGIN_IN_ROOM = 0.4, 0.8
"""Ground around paths that a picture shows, m."""
_WHOLE = 10.0
"""Longest side of a room that a picture shows as a whole, m."""
_LEAST = 1.5
"""Least side of that picture, m."""
_FEW = 0.5
"""Share of the runs that must still drive for a mean to be drawn: the last ones are no fair sample."""
_SIDE, _BELOW = 3.8, 3.2
"""Side of a panel with paths, and height of the panels below, inches."""
ALL = "true paths of all"
"""Title of the panel with all paths."""
LEARNING = {"success": "goals reached (%)", "return": "return", "steps_to_end": "steps to the end"}
"""Numbers of an evaluation during training, with the labels of their axes."""


def plot_drive(axes: Axes, drive: Drive) -> Axes:
    """Draw a drive from above: walls, obstacles and walkers, true path, estimate, odometry, start, waypoints and end."""
    draw_trajectory(axes, drive, ellipses=12)
    _plot_ground(axes, drive)
    _plot_end(axes, drive, "black", "end")
    return _zoom(axes, [drive])


def plot_drives(axes: Axes, drives: Mapping[str, Drive]) -> Axes:
    """Draw the paths of several drives by their labels over each other, in the room of the first one."""
    for (label, drive), (color, style) in zip(drives.items(), cycle(CURVES), strict=False):
        path = _path(drive)
        axes.plot(path[:, 0], path[:, 1], color=color, linestyle=style, linewidth=1.8, label=label)
        _plot_end(axes, drive, color)
    draw_places(axes, list(drives.values()))
    _plot_ground(axes, next(iter(drives.values())), walkers=False)
    return _zoom(axes, list(drives.values()))


def plot_consistency(
    axes: Axes, time: ArrayLike, values: ArrayLike, *, name: str = "NEES", label: str = "", at: int = 0
) -> Axes:
    """Draw the mean NEES or NIS of runs, shape (runs, T) or (T,), over time, with the chi-square bounds of a consistent filter.

    Above the bounds a filter is too sure of itself, below them too careful. The mean is drawn while at least half of the runs
    drive. ``name`` is "NEES" or "NIS", ``label`` the filter's in the legend, and ``at`` the number of the curve.
    """
    from scipy.stats import chi2  # slow to import

    rows = np.atleast_2d(np.asarray(values, np.float64))
    count = np.isfinite(rows).sum(axis=0)
    shown = count >= max(1.0, _FEW * len(rows))
    mean, time, count = np.nansum(rows[:, shown], axis=0) / count[shown], np.asarray(time)[shown], count[shown]
    low, high = (chi2.ppf(share, DEGREES * count) / count for share in (0.5 * FALSE_ALARM, 1.0 - 0.5 * FALSE_ALARM))
    color, style = CURVES[at % len(CURVES)]
    within = f"{100.0 * (1.0 - FALSE_ALARM):g} % of consistent filters"
    of = f"mean {name} of {len(rows)} runs" if len(rows) > 1 else name
    axes.fill_between(time, low, high, facecolor=(_BAND, 0.25), edgecolor=_BAND, linewidth=0.6, label=within)
    axes.plot(time, mean, color=color, linestyle=style, linewidth=1.5, label=label or of)
    if len(mean) and mean.max() > 10.0 * DEGREES:
        axes.set_yscale("log")
    axes.axhline(DEGREES, color=_BAND, linestyle=":", linewidth=1.0, label=f"expected: {DEGREES}")
    axes.set(xlabel="time (s)", ylabel=f"{of} (1)")
    axes.margins(x=0.02)
    axes.grid(alpha=0.3)
    return axes


def plot_learning(axes: Axes, runs: Sequence[Sequence[Mapping[str, float]]], *, measure: str = "success") -> Axes:
    """Draw a number of the evaluations during training; for several seeds each, their mean and its 95 % interval.

    ``runs`` are the evaluations of each seed, after the same steps, as in ``history`` of a run's result.json; ``measure`` is a
    name in `LEARNING`.
    """
    from matplotlib.ticker import EngFormatter  # heavy

    if not runs or not all(runs):
        raise ValueError("runs must hold the evaluations of at least one run each, got none.")
    factor = 100.0 if measure == "success" else 1.0
    steps, values = [row["steps"] for row in runs[0]], np.array([[factor * row[measure] for row in run] for run in runs])
    if len(values) == 1:
        axes.plot(steps, values[0], color=BLUE, marker="o", linewidth=1.8, label="one seed")
    else:
        axes.plot(steps, values.T, color=BLUE, linewidth=0.8, alpha=0.4)
        mean, low, high = np.array([metrics.mean(column) for column in values.T]).T
        axes.plot(steps, mean, color=BLUE, linewidth=1.8, label=f"mean of {len(values)} seeds")
        axes.fill_between(steps, low, high, color=BLUE, alpha=0.2, linewidth=0.0, label="95 % interval of the mean")
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.set(xlabel="training steps", ylabel=LEARNING[measure])
    if measure == "success":
        axes.set_ylim(-3.0, 103.0)
    axes.grid(alpha=0.3)
    return axes


def learning_figure(runs: Sequence[Sequence[Mapping[str, float]]], *, title: str) -> Figure:
    """Return a figure of success and return over the steps of trainings."""
    figure = _new_figure(2.3 * _SIDE, 3.8)
    figure.suptitle(title)
    for axes, measure in zip(figure.subplots(1, 2), ("success", "return"), strict=True):
        plot_learning(axes, runs, measure=measure)
    return legends_below(figure)


def drives_figure(drives: Mapping[str, Drive], *, title: str, below: Sequence[str] = ()) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with a panel for each drive and one with all paths, and empty panels ``below`` by their names.

    A single drive is also shown in its course over time.
    """
    labels = [*drives, *([ALL] if 1 < len(drives) <= len(CURVES) else [])]
    columns = min(len(labels), 2 if len(labels) == 4 else 3 if len(labels) <= 6 else 4)
    rows = math.ceil(len(labels) / columns)
    width, height = (14.0, 7.0) if len(drives) == 1 else (_SIDE * columns, rows * (_SIDE + 0.4) + 1.0)
    figure = _new_figure(width, height + (_BELOW if below else 0.0))
    parts: Any = figure.subfigures(2, 1, height_ratios=[height, _BELOW]) if below else (figure, None)
    upper, lower = parts
    upper.suptitle(title)
    if len(drives) == 1:
        panels = np.array([draw_panels(upper, next(iter(drives.values())))])
    else:
        panels = upper.subplots(rows, columns, squeeze=False).ravel()
    for axes, (label, drive) in zip(panels, drives.items(), strict=False):
        plot_drive(axes, drive).set_title(f"{label}\n{drive.outcome}" if drive.outcome else label, fontsize=10)
    if len(labels) > len(drives):
        plot_drives(panels[len(drives)], drives).set_title(ALL, fontsize=10)
    for axes in panels[len(labels) :]:
        axes.set_axis_off()
    further = lower.subplots(1, len(below), squeeze=False).ravel() if lower is not None else ()
    return figure, dict(zip(below, further, strict=True))


def legends_below(figure: Figure) -> Figure:
    """Put a legend below each part of a figure, in as many columns as fit."""
    for part in figure.subfigs or [figure]:
        names = [name for axes in part.axes for name in axes.get_legend_handles_labels()[1]]
        longest = max(map(len, names), default=0)
        legend_below(part, columns=max(1, int(figure.get_figwidth() / (0.085 * longest + 0.8))))
    return figure


def _new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of so many inches, which needs no display."""
    from matplotlib.figure import Figure  # heavy

    return Figure(figsize=(width, height), layout="constrained")


def _path(drive: Drive) -> NDArray[np.float64]:
    """Return the true positions, shape (T, 2), m; the estimated ones of a drive whose truth is unknown."""
    return (drive.true_state if drive.has_truth else drive.estimate)[:, :2]


def _plot_end(axes: Axes, drive: Drive, color: str, label: str | None = None) -> None:
    x, y = _path(drive)[-1]
    axes.plot(x, y, "X", color=color, markersize=9.0, markeredgecolor="white", zorder=4.1, label=label)


def _plot_ground(axes: Axes, drive: Drive, *, walkers: bool = True) -> None:
    """Draw what stands around a drive, and unless told otherwise those who walk, with their ways."""
    from matplotlib.patches import Circle  # heavy

    room = drive.around.room
    rows = [row for row in drive.circles if len(row)]
    ways = np.stack(rows, axis=1) if rows else np.empty((0, 0, 3))  # x, y and radius of each circle at each time
    walks = {at: way for at, way in enumerate(ways) if np.ptp(way[:, :2], axis=0).any()}
    if room is not None:
        draw_room(axes, room._replace(circles=tuple(circle for at, circle in enumerate(room.circles) if at not in walks)))
    if drive.around.grid is not None:
        draw_map(axes, drive.around.grid)
    for number, way in enumerate(walks.values() if walkers else ()):
        x, y, radius = way[-1]
        axes.plot(way[:, 0], way[:, 1], color=BLUE, linewidth=0.8, alpha=0.5, zorder=1.0)
        name = "walker, at the end" if number == 0 else None
        axes.add_patch(Circle((x, y), radius, facecolor=(BLUE, 0.35), edgecolor=BLUE, zorder=1.1, label=name))


def _zoom(axes: Axes, drives: Sequence[Drive]) -> Axes:
    """Show the square of ground that paths, waypoints and a small room take; a metre is as long in either direction."""
    tracks: list[Any] = [part[:, :2] for drive in drives for part in (drive.true_state, drive.estimate, drive.reference)]
    room = drives[0].around.room
    if room is not None and 2.0 * max(room.walls[2:]) <= _WHOLE:
        x, y, a, b = room.walls
        tracks.append(np.array([[x - a, y - b], [x + a, y + b]]))
    points = np.concatenate(tracks)
    points = points[np.isfinite(points).all(axis=1)]
    points = points if len(points) else np.zeros((1, 2))
    margin = _MARGIN_IN_ROOM if room is not None else _MARGIN
    x, y = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = max(0.5 * float(np.ptp(points, axis=0).max()) + margin, 0.5 * _LEAST)
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    return axes
