"""The picture of one environment: where the robot is, where it believes it is, its goal, and its room if it has one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Wedge
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.observations import NEAREST
from turtlebot_gym.plotting import (
    BLACK,
    BLUE,
    ESTIMATE_WITHIN,
    GREEN,
    PURPLE,
    SIGMAS,
    SKY_BLUE,
    VERMILLION,
    draw_map,
    draw_room,
    ellipse,
)
from turtlebot_gym.rooms.grid import grid_in
from turtlebot_gym.rooms.scan import obstacles_of
from turtlebot_gym.rooms.scene import Scene, scene_at
from turtlebot_gym.systems import Snapshot
from turtlebot_gym.systems.scans import TrackedScene
from turtlebot_gym.tasks import distance_to
from turtlebot_gym.values import Pose, State

SIDE, HEADER = 640, 64
"""Side of the map, and height of the strip above it with the legend; pixels."""
_DPI = 72
"""Pixels per inch, with which widths of lines are pixels."""
_MARGIN, _GROWTH = 0.5, 1.25
"""Margin around the visible points, m, and the factor by which a robot that leaves the view widens it."""
_WHEEL = (0.75, 0.45, 0.13)
"""Distance from the middle, half length and half width of a wheel, as shares of the robot's radius."""
_LINES = 36
"""Most beams drawn as lines; only the end points of the others are drawn."""
_LINE, _TEXT, _BODY, _PALE_GOAL, _BEAM = "#ebebeb", "#57606a", "#c8c8c8", "#99d8c7", "#f0d9e6"


def _placed(pose: Pose | State, points: ArrayLike) -> NDArray[np.float64]:
    """Return points of a body's frame, shape (N, 2), in the world."""
    cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
    return np.asarray(points) @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]


def _line(points: ArrayLike, color: str, width: float) -> Line2D:
    return Line2D(*np.asarray(points).reshape(-1, 2).T, color=color, linewidth=width)


def _dots(points: ArrayLike, color: str, size: float) -> Line2D:
    return Line2D(
        *np.asarray(points).reshape(-1, 2).T, color=color, linestyle="", marker="o", markersize=size, markeredgewidth=0
    )


def _heading(pose: Pose | State, color: str, length: float, width: float) -> Line2D:
    return _line(_placed(pose, [(0.0, 0.0), (length, 0.0)]), color, width)


class Renderer:
    """Draws the world of one environment; a robot that leaves the map widens the view until the reset.

    What does not move is drawn once, on the paper below the trails.

    Args:
        batch: The environments, whose rooms and tracks are looked at in each picture.
        row: Number of the environment.
    """

    def __init__(self, batch: Batch, row: int = 0) -> None:
        self._p = batch.parameters_of(row)
        self._waypoints = [] if self._p.task.random else [Pose(*pose) for pose in batch.waypoints[row].tolist()]
        self._scene = scene_at(batch.scenes, row) if self._p.room else None
        self._tracks = batch.scenes.tracker.seen[row] if isinstance(batch.scenes, TrackedScene) else None
        self._canvas = FigureCanvasAgg(Figure(figsize=(SIDE / _DPI, (HEADER + SIDE) / _DPI), dpi=_DPI))
        self.reset()

    def reset(self) -> None:
        """Clear the trails, and return to the initial view."""
        arena = self._p.task.arena
        x, y, a, b = (0.0, 0.0, arena, arena) if self._scene is None else self._scene.room.walls.tolist()
        self._corners = [(x - a, y - b), (x + a, y - b), (x + a, y + b), (x - a, y + b), (x - a, y - b)]
        seen = [(0.0, 0.0), *(waypoint[:2] for waypoint in self._waypoints)] if self._waypoints else self._corners
        low, high = np.min(seen, axis=0), np.max(seen, axis=0)
        self._centre, self._half = (low + high) / 2.0, float(np.max(high - low)) / 2.0 + _MARGIN
        self._trails: list[tuple[Pose, State, State]] = []
        self._axes, self._paper = self._make_paper()

    def draw(self, world: Snapshot) -> NDArray[np.uint8]:
        """Draw a world, add it to the trails, and return the picture, shape (HEADER + SIDE, SIDE, 3)."""
        truth, (mean, P) = world.body.true_state, world.estimate.belief
        self._trails.append((world.senses.odometry.pose, truth, mean))
        needed = np.abs(truth[:2] - self._centre).max() + self._p.robot.radius
        if needed > self._half:
            self._half *= _GROWTH ** math.ceil(math.log(needed / self._half, _GROWTH))
            self._axes, self._paper = self._make_paper()
        self._canvas.restore_region(self._paper)
        to_go = distance_to(truth, world.course.reference)
        numbers = f"time {world.steps * self._p.dt:.1f} s        {to_go:.2f} m to the waypoint"
        text = self._canvas.figure.text(0.024, 0.974, numbers, color=_TEXT, size=12, va="center")
        self._canvas.figure.draw_artist(text)
        text.remove()
        odometry, trail, estimates = ([pose[:2] for pose in poses] for poses in zip(*self._trails, strict=True))
        moving = [_dots(odometry, SKY_BLUE, 4.0), _line(trail, BLACK, 3.0), _line(estimates, VERMILLION, 2.0)]
        if self._scene is not None:
            moving += self._what_moves(self._scene, truth)
        size = self._p.robot.radius
        moving += [*self._waypoint(world.course.reference, GREEN, 3.0), *self._robot(truth, size)]
        moving += [_dots(odometry[-1], SKY_BLUE, 9.0), _heading(world.senses.odometry.pose, SKY_BLUE, size, 2.5)]
        outline = ellipse(mean, ((P.xx, P.xy), (P.xy, P.yy)))
        for artist in (*moving, _line(outline, VERMILLION, 2.0), _heading(mean, VERMILLION, size, 2.5)):
            self._axes.add_artist(artist)
            self._axes.draw_artist(artist)
            artist.remove()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _make_paper(self) -> tuple[Axes, Any]:
        """Return the axes, and the picture of what does not move: whole metres, waypoints, the room, the legend."""
        figure = self._canvas.figure
        figure.clear()
        axes = figure.add_axes((0.0, 0.0, 1.0, SIDE / (HEADER + SIDE)), frame_on=False)
        if self._scene is not None:
            if grid := grid_in(self._scene):
                draw_map(axes, grid)
            room, walks = obstacles_of(self._scene), self._walks(self._scene)
            circles = tuple(circle for circle, is_person in zip(room.circles, walks, strict=True) if not is_person)
            draw_room(axes, room._replace(circles=circles))
        elif not self._waypoints:
            axes.add_artist(_line(self._corners, _TEXT, 1.5))
        for artist in (each for waypoint in self._waypoints for each in self._waypoint(waypoint, _PALE_GOAL, 1.5)):
            axes.add_artist(artist)
        (x, y), half = self._centre, self._half
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MultipleLocator(max(1, round(half / 4.0))))
            axis.set_major_formatter("{x:g} m")
            axis.set_zorder(0.0)
        axes.grid(color=_LINE)
        axes.tick_params(length=0, labelcolor=_TEXT, pad=-16)
        axes.tick_params(axis="y", pad=-28)
        entries = {"robot (truth)": BLACK, ESTIMATE_WITHIN: VERMILLION, "odometry": SKY_BLUE, "waypoint": GREEN}
        if self._scene is not None:
            entries |= {"scan": PURPLE}
        if self._tracks is not None:
            entries |= {"track": VERMILLION}
        dots = [_dots((0.0, 0.0), color, 12.0) for color in entries.values()]
        figure.legend(dots, entries, loc="upper left", bbox_to_anchor=(0.0, 0.96), ncols=9, frameon=False, labelcolor=_TEXT)
        self._canvas.draw()
        return axes, self._canvas.copy_from_bbox(figure.bbox)

    @staticmethod
    def _walks(scene: Scene) -> NDArray[np.bool_]:
        """Return which circles of a room walk."""
        return scene.room.circles[: scene.room.counts[0], 3:].any(1)

    def _what_moves(self, scene: Scene, robot: State) -> list[Artist]:
        """Return people, the newest scan, and tracks as the robot sees them, each with its way in a second."""
        moving: list[Artist] = []
        for x, y, radius, vx, vy in scene.room.circles[: scene.room.counts[0]][self._walks(scene)].tolist():
            moving += [Circle((x, y), radius, color=BLUE, linewidth=0), _line([(x, y), (x + vx, y + vy)], BLUE, 2.5)]
        lidar = self._p.room.lidar
        foot = np.array([lidar.x, lidar.y])
        ends = foot + (scene.lidar.beams[:2, : lidar.beams] * scene.lidar.ranges[1, : lidar.beams]).T
        measured = np.flatnonzero(np.isfinite(ends).all(1))
        dots = _placed(robot, ends[measured])
        beams = dots[measured % -(-lidar.beams // _LINES) == 0]
        parts = np.stack([np.broadcast_to(_placed(robot, foot), beams.shape), beams, np.full_like(beams, np.nan)], axis=1)
        moving += [_line(parts, _BEAM, 1.0), _dots(dots, PURPLE, 6.0)]
        tracks = [] if self._tracks is None else self._tracks.reshape(NEAREST, -1).tolist()
        for x, y, vx, vy, deviation, _, _, certainty in tracks:
            if certainty == 1.0:
                way = _placed(robot, [(x, y), (x + vx, y + vy)])
                radius = SIGMAS * deviation / math.sqrt(2.0)  # the deviation is that of both coordinates together
                moving += [Circle(way[0], radius, fill=False, edgecolor=VERMILLION, linewidth=1.5), _line(way, VERMILLION, 2.0)]
        return moving

    def _waypoint(self, waypoint: Pose, color: str, width: float) -> list[Artist]:
        """Return the circle of arrival and the heading, and as a sector the headings that count as right."""
        (x, y, theta), radius, tolerance = waypoint, self._p.task.radius, self._p.task.heading_tolerance
        circle = Circle((x, y), radius, fill=False, edgecolor=color, linewidth=width)
        parts: list[Artist] = [circle, _heading(waypoint, color, radius, width)]
        if tolerance < math.pi:
            first, last = np.degrees((theta - tolerance, theta + tolerance))
            parts.insert(0, Wedge((x, y), 3.0 * radius, first, last, facecolor=_PALE_GOAL))
        return parts

    @staticmethod
    def _robot(truth: State, size: float) -> list[Artist]:
        """Return the robot from above: body, wheels and heading."""
        beside, length, width = (size * share for share in _WHEEL)
        parts: list[Artist] = [Circle(truth[:2], size, facecolor=_BODY, edgecolor=BLACK, linewidth=2.0)]
        for side in (-beside, beside):
            corners = [(length, side + width), (-length, side + width), (-length, side - width), (length, side - width)]
            parts.append(Polygon(_placed(truth, corners), facecolor=BLACK, linewidth=0))
        return [*parts, _heading(truth, BLACK, size, 3.0)]
