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
_TRUTH: _Style = {"color": BLACK, "linewidth": 1.8, "zorder": 3.0, "label": "truth"}
_ESTIMATE: _Style = {"color": VERMILLION, "linestyle": (0, (4, 1.5)), "zorder": 3.1, "label": "estimate"}
_BAND: _Style = {"facecolor": (VERMILLION, 0.2), "edgecolor": (VERMILLION, 0.5), "zorder": 2.1, "label": ESTIMATE_WITHIN}
_ODOMETRY: _Style = {"color": SKY_BLUE, "linestyle": "", "marker": ".", "markersize": 4.0, "zorder": 2.0, "label": "odometry"}
_REFERENCE: _Style = {"color": GREEN, "linestyle": "-.", "zorder": 2.2, "drawstyle": "steps-post", "label": "reference"}
_WAYPOINT: _Style = {"color": GREEN, "linestyle": "", "marker": "o", "markersize": 5.0, "label": "waypoint"}
_START: _Style = {"color": BLACK, "linestyle": "", "marker": "s", "markersize": 7.0, "zorder": 4.0, "label": "start"}
_SCAN: _Style = {"color": PURPLE, "linestyle": "", "marker": ".", "markersize": 3.0, "zorder": 2.3, "label": "last scan"}
_SOLID, _UNKNOWN = "#777777", "#dddddd"
_STYLES = ("-", "--", "-.", (0, (6, 1, 1, 1, 1, 1)), ":", (0, (10, 2)))
PATHS = [(color, _STYLES[(at + turn) % 6]) for turn in range(6) for at, color in enumerate((BLUE, PURPLE, ORANGE))]
"""Colours and line styles of paths, in this order; the other colours stand for truth, estimate, odometry and waypoints."""
_POSE, _TWIST = ("x (m)", "y (m)", "heading (rad)"), ("speed (m/s)", "turning rate (rad/s)")


def ellipse(mean: ArrayLike, covariance: ArrayLike, *, sigmas: float = SIGMAS) -> NDArray[np.float64]:
    """Return the closed outline, shape (49, 2), m, some standard deviations around a mean that begins with x and y."""
    variances, directions = np.linalg.eigh(np.asarray(covariance, dtype=np.float64)[:2, :2])
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(mean)[:2] + sigmas * circle * np.sqrt(np.maximum(variances, 0.0)) @ directions.T


def draw_trajectory(axes: Axes, drive: Drive, *, ellipses: int = 12) -> Axes:
    """Draw a drive seen from above: truth, estimate with about so many ellipses, odometry, waypoints and start."""
    from matplotlib.collections import PolyCollection  # heavy, and not needed on a robot

    estimate, covariance = drive.estimate, drive.covariance
    for poses, style in ((drive.true_state, _TRUTH), (estimate, _ESTIMATE), (drive.odometry, _ODOMETRY)):
        _plot(axes, poses[:, 0], poses[:, 1], style)
    rows = np.flatnonzero(np.isfinite(covariance[:, :2, :2]).all((1, 2)) & np.isfinite(estimate[:, :2]).all(1))
    outlines = [ellipse(estimate[at], covariance[at]) for at in rows[:: max(1, len(rows) // ellipses)]]
    if outlines:
        axes.add_collection(PolyCollection(outlines, **_BAND))  # one entry in a legend, however many ellipses
    draw_places(axes, [drive])
    return axes


def draw_room(axes: Axes, room: Obstacles) -> Axes:
    """Draw walls and obstacles, seen from above, behind everything else."""
    from matplotlib.patches import Circle, Rectangle  # heavy, and not needed on a robot

    x, y, a, b = room.walls
    axes.add_patch(Rectangle((x - a, y - b), 2.0 * a, 2.0 * b, fill=False, edgecolor=_SOLID, linewidth=2.0, zorder=0.5))
    for cx, cy, radius in room.circles:
        axes.add_patch(Circle((cx, cy), radius, facecolor=_SOLID, zorder=0.5))
    for cx, cy, length, width, heading in room.boxes:
        corner = (cx - length / 2.0, cy - width / 2.0)
        box = Rectangle(corner, length, width, angle=np.degrees(heading), rotation_point="center", facecolor=_SOLID, zorder=0.5)
        axes.add_patch(box)
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
    ranges = np.where(np.isfinite(scan.ranges), scan.ranges, np.nan)
    _plot(axes, lidar.x + ranges * np.cos(angles), lidar.y + ranges * np.sin(angles), _SCAN)
    return axes


def draw_over_time(axes: Axes, drive: Drive, what: Literal["x", "y", "theta", "v", "omega", "error"]) -> Axes:
    """Draw one number of a drive over time: of the pose truth, estimate with its band, odometry and waypoint; of the commanded
    twist; or the position errors of estimate and odometry.

    Headings are shifted by full turns to be nearest to the true one, so that wrapping leaves no jump.
    """
    if what == "error":
        label = "position error (m)"
        for poses, style in ((drive.estimate, _ESTIMATE), (drive.odometry, _ODOMETRY)):
            _plot(axes, drive.time, position_error(poses, drive.true_state), style)
        axes.set_ylim(bottom=0.0)
    elif what in ("v", "omega"):
        at = ("v", "omega").index(what)
        label, style = _TWIST[at], {"color": BLUE, "drawstyle": "steps-post", "label": "command"}
        _plot(axes, drive.time, drive.command[:, at], style)
    else:
        at = ("x", "y", "theta").index(what)
        label, margin = _POSE[at], SIGMAS * np.sqrt(np.maximum(drive.covariance[:, at, at], 0.0))
        rows = np.stack([drive.true_state[:, at], drive.estimate[:, at], drive.odometry[:, at], drive.reference[:, at]])
        if what == "theta":
            guide = np.unwrap(rows[0] if np.isfinite(rows[0]).all() else rows[1])
            rows += 2.0 * np.pi * np.round((guide - rows) / (2.0 * np.pi))
        if np.isfinite(margin).any():
            axes.fill_between(drive.time, rows[1] - margin, rows[1] + margin, **_BAND)
        for values, style in zip(rows, (_TRUTH, _ESTIMATE, _ODOMETRY, _REFERENCE), strict=True):
            _plot(axes, drive.time, values, style)
    axes.set(xlabel="time (s)", ylabel=label)
    axes.margins(x=0.02)
    axes.grid(alpha=0.3)
    return axes


def tutorial_figure(drive: Drive, *, title: str | None = None) -> Figure:
    """Return a drive at a glance: its trajectory; x, y and heading, commands and position error over time."""
    from matplotlib.figure import Figure  # heavy, and not needed on a robot

    figure = Figure(figsize=(14.0, 7.0), layout="constrained")
    figure.suptitle(title or "")
    draw_trajectory(draw_panels(figure, drive), drive)
    legend_below(figure, columns=8)
    return figure


def draw_panels(figure: FigureBase, drive: Drive) -> Axes:
    """Draw the numbers of a drive over time into an empty figure or a part of one, and return the empty axes beside them."""
    rows: Any = [["trajectory", "x", "v"], ["trajectory", "y", "omega"], ["trajectory", "theta", "error"]]
    panels = figure.subplot_mosaic(rows, width_ratios=[1.75, 1.0, 1.0])
    beside = panels.pop("trajectory")
    for what, axes in panels.items():
        draw_over_time(axes, drive, what)
    return beside


def draw_places(axes: Axes, drives: Sequence[Drive]) -> None:
    """Draw starts, waypoints with their headings and circles of arrival, and give the axes equal scales."""
    from matplotlib.patches import Circle  # heavy, and not needed on a robot

    waypoints = np.concatenate([drive.reference for drive in drives])
    waypoints = np.unique(waypoints[np.isfinite(waypoints).all(1)], axis=0)
    _plot(axes, waypoints[:, 0], waypoints[:, 1], _WAYPOINT)
    starts = np.unique([drive.poses[0, :2] for drive in drives], axis=0)
    _plot(axes, starts[:, 0], starts[:, 1], _START)
    radius = drives[0].around.goal_radius
    for x, y, theta in waypoints:
        axes.add_patch(Circle((x, y), radius, fill=False, edgecolor=GREEN, zorder=2.2))
        axes.plot([x, x + radius * np.cos(theta)], [y, y + radius * np.sin(theta)], color=GREEN, zorder=2.2)
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.margins(0.05)
    shared = axes in axes.get_shared_x_axes() and axes in axes.get_shared_y_axes()
    axes.set_aspect("equal", adjustable="box" if shared else "datalim")  # axes that share both limits cannot fill the panel
    axes.grid(alpha=0.3)


def _plot(axes: Axes, x: NDArray, y: NDArray, style: _Style) -> None:
    """Draw a series, unless all of it is unknown: it would still appear in the legend."""
    if np.isfinite(y).any():
        axes.plot(x, y, **style)


def legend_below(figure: Figure | SubFigure, *, columns: int) -> None:
    """Put one legend for all panels below them, in place of an earlier one."""
    figure.legends.clear()
    entries = {name: handle for axes in figure.axes for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns, frameon=False)
