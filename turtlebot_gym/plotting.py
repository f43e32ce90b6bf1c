"""Plots of a drive, for screen and print.

Every ``draw_`` function draws into the given axes, labels what it draws and returns the axes; the caller places the legend. The
figures are plain `matplotlib.figure.Figure` objects: nothing here touches pyplot or opens a window. Colour-blind readers can
tell the colours apart, and line styles differ too.

References:
    Okabe, Ito, *Color Universal Design* (2008): the palette.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.drive import Drive, position_error
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase, SubFigure

    from turtlebot_gym.rooms.scan import Obstacles, Scan
    from turtlebot_gym.values import Pose

BLACK, ORANGE, SKY_BLUE, GREEN = "#000000", "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILLION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"

SIGMAS = 2.0
"""Size of drawn ellipses and bands, in standard deviations ..."""
ESTIMATE_WITHIN = f"estimate ± {SIGMAS:g}\N{GREEK SMALL LETTER SIGMA}"
"""... and their name in legends."""

_Style = dict[str, Any]
_TRUTH: _Style = {"color": BLACK, "linestyle": "-", "linewidth": 1.8, "zorder": 3.0, "label": "truth"}
_ESTIMATE: _Style = {"color": VERMILLION, "linestyle": (0, (4, 1.5)), "linewidth": 1.5, "zorder": 3.1, "label": "estimate"}
_BAND: _Style = {
    "facecolor": (VERMILLION, 0.2),
    "edgecolor": (VERMILLION, 0.5),
    "linewidth": 0.6,
    "zorder": 2.1,
    "label": ESTIMATE_WITHIN,
}
_ODOMETRY: _Style = {"color": SKY_BLUE, "linestyle": "", "marker": ".", "markersize": 4.0, "zorder": 2.0, "label": "odometry"}
_REFERENCE: _Style = {
    "color": GREEN,
    "linestyle": "-.",
    "linewidth": 1.2,
    "zorder": 2.2,
    "drawstyle": "steps-post",
    "label": "reference",
}
_WAYPOINT: _Style = {
    "color": GREEN,
    "linestyle": "",
    "marker": "o",
    "markersize": 9.0,
    "fillstyle": "none",
    "mew": 1.8,
    "label": "waypoint",
}
_START: _Style = {"color": BLACK, "linestyle": "", "marker": "s", "markersize": 7.0, "zorder": 4.0, "label": "start"}
_COMMAND: _Style = {"color": BLUE, "linewidth": 1.2, "drawstyle": "steps-post"}
_SCAN: _Style = {"color": PURPLE, "linestyle": "", "marker": ".", "markersize": 3.0, "zorder": 2.3, "label": "last scan"}
_SOLID, _UNKNOWN = "#777777", "#dddddd"
_COLORS = (BLUE, VERMILLION, PURPLE, ORANGE, SKY_BLUE, BLACK)
_STYLES = ("-", "--", "-.", (0, (6, 1, 1, 1, 1, 1)), ":", (0, (10, 2)))
PATHS = [(color, _STYLES[(at + turn) % 6]) for turn in range(6) for at, color in enumerate(_COLORS)]
"""Colours and line styles of paths, in this order: six colours, then the same with other styles."""
_COMPONENTS = {"x": "x (m)", "y": "y (m)", "theta": "heading (rad)"}
_COMMANDS = {"v": "speed (m/s)", "omega": "turning rate (rad/s)"}


def ellipse(mean: ArrayLike, covariance: ArrayLike, *, sigmas: float = SIGMAS, points: int = 49) -> NDArray[np.float64]:
    """Return the closed outline, shape (points, 2), of the ellipse ``sigmas`` standard deviations around a position, m.

    The mean and the covariance begin with x and y; further components are ignored.
    """
    variances, directions = np.linalg.eigh(np.asarray(covariance, dtype=np.float64)[:2, :2])
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(mean)[:2] + sigmas * circle * np.sqrt(np.maximum(variances, 0.0)) @ directions.T


def draw_trajectory(axes: Axes, trajectory: Drive, *, ellipses: int = 12) -> Axes:
    """Draw a drive seen from above: truth, estimate with about so many ellipses, odometry, waypoints and start."""
    from matplotlib.collections import PolyCollection  # heavy, and not needed on a robot

    truth, estimate, covariance = trajectory.true_state, trajectory.estimate, trajectory.covariance
    _plot(axes, truth[:, 0], truth[:, 1], _TRUTH)
    _plot(axes, estimate[:, 0], estimate[:, 1], _ESTIMATE)
    rows = np.flatnonzero(np.isfinite(covariance[:, :2, :2]).all((1, 2)) & np.isfinite(estimate[:, :2]).all(1))
    outlines = [ellipse(estimate[at], covariance[at]) for at in rows[:: max(1, len(rows) // ellipses)]]
    if outlines:
        axes.add_collection(PolyCollection(outlines, **_BAND))  # one entry in a legend, however many ellipses
    _plot(axes, trajectory.odometry[:, 0], trajectory.odometry[:, 1], _ODOMETRY)
    draw_places(axes, [trajectory])
    return axes


def draw_room(axes: Axes, room: Obstacles) -> Axes:
    """Draw walls and obstacles, seen from above, behind everything else."""
    from matplotlib.patches import Circle, Polygon, Rectangle  # heavy, and not needed on a robot

    x, y, a, b = room.walls
    axes.add_patch(Rectangle((x - a, y - b), 2.0 * a, 2.0 * b, fill=False, edgecolor=_SOLID, linewidth=2.0, zorder=0.5))
    for cx, cy, radius in room.circles:
        axes.add_patch(Circle((cx, cy), radius, facecolor=_SOLID, zorder=0.5))
    for cx, cy, length, width, heading in room.boxes:
        u, v = 0.5 * length, 0.5 * width
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        corners = np.array([[u, v], [-u, v], [-u, -v], [u, -v]]) @ turn + (cx, cy)
        axes.add_patch(Polygon(corners, facecolor=_SOLID, zorder=0.5))
    axes.autoscale_view()
    return axes


def draw_map(axes: Axes, grid: GridMap) -> Axes:
    """Draw a map's cells, seen from above, behind everything else: occupied cells dark, unknown cells light."""
    from matplotlib.colors import ListedColormap  # heavy, and not needed on a robot

    across, along = np.indices([size + 1 for size in grid.cells.shape]) * grid.resolution
    cosine, sine = np.cos(grid.origin.theta), np.sin(grid.origin.theta)
    x, y = grid.origin.x + cosine * along - sine * across, grid.origin.y + sine * along + cosine * across
    shade = 1 + (grid.cells == OCCUPIED) - (grid.cells == FREE).astype(int)
    axes.pcolormesh(x, y, shade, cmap=ListedColormap(["none", _UNKNOWN, _SOLID]), vmin=0, vmax=2, rasterized=True, zorder=0.4)
    return axes


def draw_scan(axes: Axes, scan: Scan, lidar: Pose) -> Axes:
    """Draw the ends of a scan's beams, measured from the pose of a LiDAR's frame."""
    angles = lidar.theta + scan.first + scan.increment * np.arange(len(scan.ranges))
    seen = np.isfinite(scan.ranges)
    x, y = lidar.x + scan.ranges * np.cos(angles), lidar.y + scan.ranges * np.sin(angles)
    _plot(axes, x[seen], y[seen], _SCAN)
    return axes


def draw_component(axes: Axes, trajectory: Drive, component: Literal["x", "y", "theta"]) -> Axes:
    """Draw x, y or the heading over time: truth, estimate with its band, measurements and waypoint.

    Headings are shifted by full turns to be nearest to the true one, so that wrapping leaves no jump.
    """
    at = list(_COMPONENTS).index(component)
    time = trajectory.time
    series = (trajectory.true_state, trajectory.estimate, trajectory.odometry, trajectory.reference)
    truth, estimate, odometry, reference = (rows[:, at] for rows in series)
    if component == "theta":
        guide = np.unwrap(truth if np.isfinite(truth).all() else estimate)
        truth, estimate, odometry, reference = (
            angle + 2.0 * np.pi * np.round((guide - angle) / (2.0 * np.pi)) for angle in (truth, estimate, odometry, reference)
        )
    margin = SIGMAS * np.sqrt(np.maximum(trajectory.covariance[:, at, at], 0.0))
    _plot(axes, *_without_jumps(time, truth, component), _TRUTH)
    _plot(axes, *_without_jumps(time, estimate, component), _ESTIMATE)
    if np.isfinite(margin).any():
        axes.fill_between(time, estimate - margin, estimate + margin, **_BAND)
    _plot(axes, time, odometry, _ODOMETRY)
    _plot(axes, *_without_jumps(time, reference, component), _REFERENCE)
    return _over_time(axes, _COMPONENTS[component])


def draw_command(axes: Axes, trajectory: Drive, component: Literal["v", "omega"], *, label: str = "command") -> Axes:
    """Draw the commanded speed or turning rate over time."""
    _plot(axes, trajectory.time, trajectory.command[:, list(_COMMANDS).index(component)], {**_COMMAND, "label": label})
    return _over_time(axes, _COMMANDS[component])


def draw_position_error(axes: Axes, trajectory: Drive) -> Axes:
    """Draw the position errors of estimate and odometry over time."""
    for poses, style in ((trajectory.estimate, _ESTIMATE), (trajectory.odometry, _ODOMETRY)):
        _plot(axes, trajectory.time, position_error(poses, trajectory.true_state), style)
    axes.set_ylim(bottom=0.0)
    return _over_time(axes, "position error (m)")


def tutorial_figure(
    trajectory: Drive,
    *,
    title: str | None = None,
    room: Obstacles | None = None,
    grid: GridMap | None = None,
    scan: tuple[Scan, Pose] | None = None,
    command: str = "command",
) -> Figure:
    """Return a drive at a glance: its trajectory; x, y and heading, commands and position error over time.

    It may lie in a room or on its map, with the last scan and the pose of the LiDAR's frame. ``command`` is what the legend
    calls the commands.
    """
    figure = _figure(14.0, 7.0, title)
    axes = draw_panels(figure, trajectory, command=command)
    draw_trajectory(axes, trajectory)
    if room:
        draw_room(axes, room)
    if grid is not None:
        draw_map(axes, grid)
    if scan:
        draw_scan(axes, *scan)
    legend_below(figure, columns=8)
    return figure


def draw_panels(figure: FigureBase, trajectory: Drive, *, command: str = "command") -> Axes:
    """Draw x, y and heading, commands and position error over time into an empty figure or a part of one.

    Empty axes beside them are returned, for the drive seen from above. ``command`` is what the legend calls the commands.
    """
    panels = figure.subplot_mosaic(
        [["trajectory", "x", "v"], ["trajectory", "y", "omega"], ["trajectory", "theta", "error"]],
        width_ratios=[1.75, 1.0, 1.0],
    )
    for component in ("x", "y", "theta"):
        draw_component(panels[component], trajectory, component)
    for component in ("v", "omega"):
        draw_command(panels[component], trajectory, component, label=command)
    draw_position_error(panels["error"], trajectory)
    return panels["trajectory"]


def comparison_figure(trajectories: Sequence[tuple[str, Drive]], *, title: str | None = None) -> Figure:
    """Return the true paths of several drives with their labels in one figure; a cross marks the end of each.

    Labels that agree up to a comma share a colour and differ in line style.
    """
    figure = _figure(6.4, 6.8, title)
    axes = figure.subplots()
    names = [label.partition(",")[0] for label, _ in trajectories]
    for at, (label, trajectory) in enumerate(trajectories):
        first, turn = list(dict.fromkeys(names)).index(names[at]), names[:at].count(names[at])
        color, style = PATHS[(len(_COLORS) * turn + first) % len(PATHS)]
        path = trajectory.true_state
        axes.plot(path[:, 0], path[:, 1], color=color, linestyle=style, linewidth=1.8, label=label)
        axes.plot(path[-1:, 0], path[-1:, 1], color=color, marker="X", markersize=9.0, markeredgecolor="white", zorder=4.0)
    axes.plot([], [], color=_SOLID, linestyle="", marker="X", markersize=9.0, label="end")
    draw_places(axes, [trajectory for _, trajectory in trajectories])
    legend_below(figure, columns=3)
    return figure


def draw_places(axes: Axes, trajectories: Sequence[Drive]) -> None:
    """Draw starts and waypoints with their headings, and give the axes equal scales."""
    waypoints = np.concatenate([trajectory.reference for trajectory in trajectories])
    waypoints = np.unique(waypoints[np.isfinite(waypoints).all(1)], axis=0)
    x, y, theta = waypoints.T
    _plot(axes, x, y, _WAYPOINT)
    first = [(trajectory.true_state[0, :2], trajectory.estimate[0, :2]) for trajectory in trajectories]
    starts = np.unique([truth if np.isfinite(truth).all() else estimate for truth, estimate in first], axis=0)
    _plot(axes, starts[:, 0], starts[:, 1], _START)
    if len(waypoints):
        length = 0.08 * max(axes.dataLim.size)
        u, v = length * np.cos(theta), length * np.sin(theta)
        axes.quiver(x, y, u, v, color=GREEN, angles="xy", scale_units="xy", scale=1.0, width=0.006, zorder=3.2)
        axes.update_datalim(np.stack([x + u, y + v], axis=-1))  # otherwise the axes could cut off the tips
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.margins(0.05)
    shared = axes in axes.get_shared_x_axes() and axes in axes.get_shared_y_axes()
    axes.set_aspect("equal", adjustable="box" if shared else "datalim")  # axes that share both limits cannot fill the panel
    axes.grid(alpha=0.3)


def _plot(axes: Axes, x: NDArray, y: NDArray, style: _Style) -> None:
    """Draw a series, unless all of it is unknown: it would still appear in the legend."""
    if np.isfinite(y).any():
        axes.plot(x, y, **style)


def _over_time(axes: Axes, label: str) -> Axes:
    axes.set(xlabel="time (s)", ylabel=label)
    axes.margins(x=0.02)
    axes.grid(alpha=0.3)
    return axes


def _without_jumps(time: NDArray, values: NDArray, component: str) -> tuple[NDArray, NDArray]:
    """Interrupt a heading where it jumps by more than half a turn."""
    jumps = np.flatnonzero(np.abs(np.diff(values)) > np.pi) + 1 if component == "theta" else []
    return np.insert(time, jumps, np.nan), np.insert(values, jumps, np.nan)


def _figure(width: float, height: float, title: str | None) -> Figure:
    from matplotlib.figure import Figure  # heavy, and not needed on a robot

    figure = Figure(figsize=(width, height), layout="constrained")
    if title:
        figure.suptitle(title)
    return figure


def legend_below(figure: Figure | SubFigure, *, columns: int) -> None:
    """Put one legend for all panels below them, in place of an earlier one."""
    figure.legends.clear()
    entries = {name: handle for axes in figure.axes for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns, frameon=False)
