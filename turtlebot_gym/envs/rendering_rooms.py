"""The picture of a room: walls, a map, obstacles, the beams of the newest scan, and what is tracked."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.envs.rendering import Renderer
from turtlebot_gym.observations import NEAREST
from turtlebot_gym.plotting import PURPLE, SIGMAS
from turtlebot_gym.rooms.cells import to_cells
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.systems import Snapshot
from turtlebot_gym.values import State

if TYPE_CHECKING:
    from pygame import Surface

_LINES = 36
"""Most beams drawn as lines; only the end points of the others are drawn."""


class RoomRenderer(Renderer):
    """Also draws a room. Static obstacles are part of the background; walkers, beams and tracks are drawn in each picture.

    Args:
        scene: The room; the environment updates its arrays.
        lidar: The LiDAR; beams of the newest scan are drawn from the robot's position.
        tracks: The numbers of the term `observations.TRACKS`, which the environment updates; None without a tracker.
        options: See `Renderer`.
    """

    def __init__(
        self, *arguments: Any, scene: Scene, lidar: Lidar, tracks: NDArray[np.float32] | None = None, **options: Any
    ) -> None:
        self._scene, self._lidar, self._tracks = scene, lidar, tracks
        super().__init__(*arguments, **options)

    def _to_be_seen(self) -> list[tuple[float, float]]:
        x, y, half_length, half_width = self._scene.room.walls.tolist()
        return [(x - half_length, y - half_width), (x + half_length, y + half_width)]

    def _legend_entries(self) -> list[tuple[str, Callable[[Surface, tuple, float], None]]]:
        def dots(surface: Surface, at: tuple, size: float) -> None:
            for beside in (-0.8, 0.0, 0.8):
                self._disc(surface, PURPLE, (at[0] + beside * size, at[1]), 4.0)

        def ring(surface: Surface, at: tuple, size: float) -> None:
            self._disc(surface, self._colours.estimate, at, size, 1.5)

        tracks = [] if self._tracks is None else [("track", ring)]
        return [*super()._legend_entries(), ("scan", dots), *tracks]

    def _draw_around(self, paper: Surface) -> None:
        self._draw_map(paper)
        x, y, half_length, half_width = self._scene.room.walls.tolist()
        corner, size = (
            self._at(x - half_length, y + half_width),
            (self._length(2.0 * half_length), self._length(2.0 * half_width)),
        )
        self._pygame.draw.rect(paper, self._colours.solid, (*corner, *size), 8)
        for x, y, a, b, cosine, sine in self._scene.room.boxes[: self._scene.room.counts[1]].tolist():
            corners = [(x + cosine * u - sine * v, y + sine * u + cosine * v) for u, v in ((a, b), (-a, b), (-a, -b), (a, -b))]
            self._pygame.draw.polygon(paper, self._colours.solid, [self._at(*corner) for corner in corners])
        for x, y, radius, vx, vy in self._circles():
            if vx == 0.0 and vy == 0.0:
                self._disc(paper, self._colours.solid, self._at(x, y), self._length(radius))

    def _draw_map(self, paper: Surface) -> None:
        squares = self._scene.room.squares
        if squares.shape[1] == 0:
            return
        width, height = paper.get_size()
        metres = 1.0 / self._length(1.0)
        x = self._centre[0] - self._half + (np.arange(width)[:, None] + 0.5) * metres
        y = self._centre[1] + self._half - (np.arange(height)[None, :] + 0.5) * metres
        column, row = (np.floor(at).astype(np.intp) for at in to_cells(self._scene.room.frame, x, y))
        column, row = np.clip(column, 0, squares.shape[2] - 1), np.clip(row, 0, squares.shape[1] - 1)
        pixels = self._pygame.surfarray.pixels2d(paper)
        pixels[self._scene.room.known[row, column] == 0] = paper.map_rgb(self._pygame.Color(self._colours.unknown))
        pixels[squares[0, row, column] == 0] = paper.map_rgb(self._pygame.Color(self._colours.solid))

    def _draw_present(self, surface: Surface, world: Snapshot) -> None:
        for circle in self._circles():
            if circle[3] != 0.0 or circle[4] != 0.0:
                self._draw_walker(surface, *circle)
        lidar, ends = self._beams(world)
        for beam in range(0, self._lidar.beams, -(-self._lidar.beams // _LINES)):
            if beam in ends:
                self._line(surface, self._colours.beam, lidar, ends[beam], 1.0)
        super()._draw_present(surface, world)
        for end in ends.values():
            self._disc(surface, PURPLE, end, 4.0)
        if self._tracks is not None:
            self._draw_tracks(surface, world.body.true_state, self._tracks.reshape(NEAREST, -1))

    def _draw_tracks(self, surface: Surface, robot: State, tracks: NDArray[np.float32]) -> None:
        """Draw each track as the robot sees it: some standard deviations around its place, and its way in a second."""
        place = self._placing(robot)
        for x, y, vx, vy, deviation, _, _, certainty in tracks.tolist():
            if certainty == 1.0:
                foot, tip = place(x, y), place(x + vx, y + vy)
                # The deviation is that of both coordinates together.
                self._disc(surface, self._colours.estimate, foot, self._length(SIGMAS * deviation / math.sqrt(2.0)), 1.5)
                self._line(surface, self._colours.estimate, foot, tip, 2.0)

    def _beams(self, world: Snapshot) -> tuple[tuple[float, float], dict[int, tuple[float, float]]]:
        """Return the LiDAR's position on the map, and the end of each beam that returned."""
        lidar, place = self._lidar, self._placing(world.body.true_state)
        beams = zip(
            *self._scene.lidar.beams[:2, : lidar.beams], self._scene.lidar.ranges[1, : lidar.beams].tolist(), strict=True
        )
        return place(lidar.x, lidar.y), {
            beam: place(lidar.x + length * a, lidar.y + length * b)
            for beam, (a, b, length) in enumerate(beams)
            if math.isfinite(length)
        }

    def _placing(self, robot: State) -> Callable[[float, float], tuple[float, float]]:
        """Return what places a point of the robot's frame on the map."""
        cosine, sine = math.cos(robot.theta), math.sin(robot.theta)
        return lambda a, b: self._at(robot.x + cosine * a - sine * b, robot.y + sine * a + cosine * b)

    def _circles(self) -> list[list[float]]:
        """Return x, y, radius and velocity of each circle; m, m/s."""
        return self._scene.room.circles[: self._scene.room.counts[0]].tolist()

    def _draw_walker(self, surface: Surface, x: float, y: float, radius: float, vx: float, vy: float) -> None:
        """Draw a person from above, as a disc with the way of a second."""
        self._disc(surface, self._colours.walker, self._at(x, y), self._length(radius))
        self._line(surface, self._colours.walker, self._at(x, y), self._at(x + vx, y + vy), 2.5)
