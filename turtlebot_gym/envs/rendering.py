"""Pictures of environments: the drive so far, seen from above, and the room if there is one."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.drive import Drive, RoomData
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.plotting import BLACK, BLUE, draw_map, draw_room, draw_scan, draw_trajectory
from turtlebot_gym.rooms.grid import grid_in
from turtlebot_gym.rooms.scan import Obstacles, Scan, mounted, obstacles_of
from turtlebot_gym.rooms.scene import Scene, scene_at
from turtlebot_gym.systems import Snapshot
from turtlebot_gym.tasks import distance_to

SIDE, HEADER = 640, 64
"""Side of the map, and height of the strip above it with the legend; pixels."""
_DPI = 72
"""Pixels per inch, with which widths of lines are pixels."""
_MARGIN, _GROWTH = 0.5, 1.25
"""Margin around the visible points, m, and the factor by which a robot that leaves the view widens it."""
_TEXT, _BODY = "#57606a", "#c8c8c8"


class Pictures:
    """Draws the first environments of a batch, each with the trails of its episode.

    Args:
        batch: The environments.
        mode: "rgb_array", or None for no pictures.
        rows: Number of environments to draw.
    """

    def __init__(self, batch: Batch, mode: str | None, rows: int) -> None:
        self._batch, self._mode, self._rows = batch, mode, rows
        self._renderers: dict[int, Renderer] = {}

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """Forget trails, robot and room where the mask, shape (N,), is true, because an episode begins there."""
        self._renderers = {row: renderer for row, renderer in self._renderers.items() if not mask[row]}

    def render(self, is_begun: bool) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment, (height, width, 3); None, with a warning, where none was asked for."""
        if self._mode is None:
            gym.logger.warn("render() needs a render_mode: make the environment with render_mode='rgb_array'.")
            return None
        if not is_begun:
            raise ResetNeeded("Call reset() before render().")
        missing = set(range(self._rows)) - self._renderers.keys()
        self._renderers |= {row: Renderer(self._batch, row) for row in missing}
        return tuple(self._renderers[row].draw(self._batch.world(row)) for row in range(self._rows))


class Renderer:
    """Draws the world of one environment during an episode; a robot that leaves the map widens the view.

    Args:
        batch: The environments, whose rooms are looked at in each picture.
        row: Number of the environment.
    """

    def __init__(self, batch: Batch, row: int = 0) -> None:
        self._p, waypoints = batch.parameters_of(row), batch.waypoints[row, :, :2]
        self._scene = scene_at(batch.scenes, row) if self._p.room else None
        arena = self._p.task.arena
        x, y, a, b = walls = (0.0, 0.0, arena, arena) if self._scene is None else self._scene.room.walls.tolist()
        self._arena = Obstacles(walls, (), ())
        seen = [(x - a, y - b), (x + a, y + b)] if self._p.task.random else [(0.0, 0.0), *waypoints]
        low, high = np.min(seen, axis=0), np.max(seen, axis=0)
        self._centre, self._half = (low + high) / 2.0, float(np.max(high - low)) / 2.0 + _MARGIN
        self._rows: list[dict[str, Any]] = []

    def draw(self, world: Snapshot) -> NDArray[np.uint8]:
        """Draw a world, add it to the trails, and return the picture, shape (HEADER + SIDE, SIDE, 3)."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import, and most runs draw nothing
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle

        truth, (mean, covariance), waypoint = world.body.true_state, world.estimate.belief, world.course.reference
        row = {"true_state": truth, "estimate": mean, "covariance": matrix(covariance), "reference": waypoint}
        self._rows.append(row | {"odometry": world.senses.odometry.pose})
        drive = Drive.stack(self._rows, time=np.arange(len(self._rows)), around=RoomData(goal_radius=self._p.task.radius))
        size = self._p.robot.radius
        while self._half < np.abs(truth[:2] - self._centre).max() + size:
            self._half *= _GROWTH
        figure = Figure(figsize=(SIDE / _DPI, (HEADER + SIDE) / _DPI), dpi=_DPI)
        canvas, axes = FigureCanvasAgg(figure), figure.add_axes((0.0, 0.0, 1.0, SIDE / (HEADER + SIDE)), frame_on=False)
        if self._scene is not None:
            self._draw_surroundings(axes, self._scene, world)
        elif self._p.task.random:
            draw_room(axes, self._arena)
        draw_trajectory(axes, drive)
        axes.add_patch(Circle(truth[:2], size, facecolor=_BODY, edgecolor=BLACK, linewidth=2.0, zorder=5.0))
        ahead = truth.x + size * math.cos(truth.theta), truth.y + size * math.sin(truth.theta)
        axes.plot(*zip(truth[:2], ahead, strict=True), color=BLACK, linewidth=3.0, zorder=5.0)
        (x, y), half = self._centre, self._half
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), xlabel="", ylabel="")
        axes.set_axisbelow(True)
        axes.tick_params(length=0, labelcolor=_TEXT, pad=-16)
        axes.tick_params(axis="y", pad=-28)
        numbers = f"time {world.steps * self._p.dt:.1f} s        {distance_to(truth, waypoint):.2f} m to the waypoint"
        figure.text(0.024, 0.974, numbers, color=_TEXT, size=12, va="center")
        entries = axes.get_legend_handles_labels()
        figure.legend(*entries, loc="upper left", bbox_to_anchor=(0.0, 0.96), ncols=9, frameon=False, labelcolor=_TEXT)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def _draw_surroundings(self, axes: Any, scene: Scene, world: Snapshot) -> None:
        """Draw the map, what stands, who walks, and the newest scan."""
        from matplotlib.patches import Circle  # as above

        if grid := grid_in(scene):
            draw_map(axes, grid)
        room, lidar, walkers = obstacles_of(scene), self._p.room.lidar, scene.room.circles[scene.room.circles[:, 3:].any(1), :3]
        draw_room(axes, room)
        for x, y, radius in walkers.tolist():
            axes.add_patch(Circle((x, y), radius, color=BLUE, linewidth=0, zorder=0.6))
        beams = int(lidar.beams)
        scan = Scan(scene.lidar.ranges[1, :beams], 0.0, 2.0 * math.pi / beams, lidar.range_min, lidar.range_max)
        draw_scan(axes, scan, mounted(world.body.true_state, lidar))
