"""The picture of one environment: where the robot is, where it believes it is, its goal, and its room if it has one."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from matplotlib import get_data_path
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.observations import NEAREST
from turtlebot_gym.plotting import BLACK, BLUE, ESTIMATE_WITHIN, GREEN, PURPLE, SIGMAS, SKY_BLUE, VERMILLION, ellipse
from turtlebot_gym.rooms.rays import to_cells
from turtlebot_gym.rooms.scene import Scene, scene_at
from turtlebot_gym.systems import Snapshot
from turtlebot_gym.systems.scans import TrackedScene
from turtlebot_gym.tasks import distance_to
from turtlebot_gym.values import Pose, State

if TYPE_CHECKING:
    from pygame import Surface

SIDE, HEADER = 640, 64
"""Side of the map, and height of the strip above it with the legend; pixels."""
_FINE = 2
"""Supersampling factor, which smooths every edge."""
_MARGIN, _GROWTH = 0.5, 1.25
"""Margin around the visible points, m, and the factor by which a robot that leaves the view widens it."""
_WHEEL = (0.75, 0.45, 0.13)
"""Distance from the middle, half length and half width of a wheel, as shares of the robot's radius."""
_LINES = 36
"""Most beams drawn as lines; only the end points of the others are drawn."""
_PAPER, _GRID, _TEXT, _BODY = "#ffffff", "#ebebeb", "#57606a", "#c8c8c8"
_PALE_GOAL, _BEAM, _SOLID, _UNKNOWN = "#99d8c7", "#f0d9e6", "#555555", "#dddddd"

Point = tuple[float, float]


def _placed(pose: Pose | State, points: Iterable[Point]) -> list[Point]:
    """Return points of a body's frame in the world."""
    cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
    return [(pose.x + cosine * a - sine * b, pose.y + sine * a + cosine * b) for a, b in points]


class Renderer:
    """Draws the world of one environment; a robot that leaves the map widens the view until the reset.

    What does not move is drawn once, on the paper below the trails.

    Args:
        batch: The environments, whose rooms and tracks are looked at in each picture.
        row: Number of the environment.
        windows: Whether a window, which opens with the first picture, shows it; otherwise no display is needed.
        fps: Pictures per second in the window.

    Raises:
        DependencyNotInstalled: If pygame is missing.
    """

    def __init__(self, batch: Batch, row: int = 0, *, windows: bool = False, fps: float = 10.0) -> None:
        try:
            import pygame
        except ImportError as error:
            raise DependencyNotInstalled('pygame is not installed, run `pip install "pygame>=2.5"`') from error
        pygame.font.init()
        self._pygame, self._windows, self._fps, self._p = pygame, windows, fps, batch.parameters_of(row)
        self._waypoints = [] if self._p.task.random else [Pose(*pose) for pose in batch.waypoints[row].tolist()]
        self._scene = scene_at(batch.scenes, row) if self._p.room else None
        self._tracks = batch.scenes.tracker.seen[row] if isinstance(batch.scenes, TrackedScene) else None
        self._font = pygame.font.Font(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), 12 * _FINE)
        self._window: Any = None
        self._clock = pygame.time.Clock()
        self._legend = self._make_legend()
        self.reset()

    def reset(self) -> None:
        """Clear the trails, and return to the initial view."""
        arena = self._p.task.arena
        x, y, a, b = (0.0, 0.0, arena, arena) if self._scene is None else self._scene.room.walls.tolist()
        self._corners = [(x - a, y - b), (x + a, y - b), (x + a, y + b), (x - a, y + b)]
        seen = [(0.0, 0.0), *(waypoint[:2] for waypoint in self._waypoints)] if self._waypoints else self._corners
        low, high = np.min(seen, axis=0), np.max(seen, axis=0)
        self._centre = (low + high) / 2.0
        self._half = float(np.max(high - low)) / 2.0 + _MARGIN
        self._trails: list[tuple[Pose, State, State]] = []
        self._paper = self._make_paper()

    def draw(self, world: Snapshot) -> NDArray[np.uint8] | None:
        """Draw a world and add it to the trails.

        Returns:
            The picture, shape (HEADER + SIDE, SIDE, 3); None if a window shows it.
        """
        self._trails.append((world.senses.odometry.pose, world.body.true_state, world.estimate.belief.mean))
        self._widen(world.body.true_state)
        fine = self._surface(HEADER + SIDE)
        fine.blit(self._legend, (0, 0))
        to_go = distance_to(world.body.true_state, world.course.reference)
        numbers = f"time {world.steps * self._p.dt:.1f} s        {to_go:.2f} m to the waypoint"
        self._write(fine, numbers, midleft=(15 * _FINE, 18 * _FINE))
        fine.blit(self._paper, (0, _FINE * HEADER))
        below = fine.subsurface((0, _FINE * HEADER, _FINE * SIDE, _FINE * SIDE))
        for measured, _, _ in self._trails:
            self._dot(below, SKY_BLUE, measured[:2], 4.0)
        for which, color, width in ((1, BLACK, 3.0), (2, VERMILLION, 1.5)):
            if len(self._trails) > 1:
                self._lines(below, color, (row[which][:2] for row in self._trails), width)
        if self._scene is not None:
            self._draw_what_moves(below, self._scene, world.body.true_state)
        self._draw_present(below, world)
        picture = self._pygame.transform.smoothscale(fine, (SIDE, HEADER + SIDE))
        if not self._windows:
            pixels = bytearray(self._pygame.image.tobytes(picture, "RGB"))  # four times as fast as pygame.surfarray
            return np.frombuffer(pixels, np.uint8).reshape(HEADER + SIDE, SIDE, 3)
        if self._window is None:
            self._pygame.display.init()
            self._window = self._pygame.display.set_mode(picture.get_size())
            self._pygame.display.set_caption("TurtleBot")
        self._window.blit(picture, (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(self._fps)
        return None

    def close(self) -> None:
        if self._window is not None:
            self._pygame.display.quit()
            self._window = None

    def _widen(self, truth: State) -> None:
        """Widen the view until it contains the robot."""
        needed = np.abs(truth[:2] - self._centre).max() + self._p.robot.radius
        if needed > self._half:
            self._half *= _GROWTH ** math.ceil(math.log(needed / self._half, _GROWTH))
            self._paper = self._make_paper()

    # Points and lengths are those of the world, m; widths are pixels of the picture.

    def _at(self, x: float, y: float) -> Point:
        """Return column and row of a point, in supersampled pixels."""
        left, top = self._centre[0] - self._half, self._centre[1] + self._half
        return self._length(x - left), self._length(top - y)

    def _length(self, metres: float) -> float:
        return metres * _FINE * SIDE / (2.0 * self._half)

    def _surface(self, height: int) -> Surface:
        surface = self._pygame.Surface((_FINE * SIDE, _FINE * height))
        surface.fill(_PAPER)
        return surface

    def _lines(self, surface: Surface, color: str, points: Iterable[Point], width: float) -> None:
        self._pygame.draw.lines(surface, color, False, [self._at(x, y) for x, y in points], round(width * _FINE))

    def _disc(self, surface: Surface, color: str, at: Point, radius: float, width: float = 0.0) -> None:
        """Draw a circle of a width, or a disc if that is 0."""
        self._pygame.draw.circle(surface, color, self._at(*at), self._length(radius), round(width * _FINE))

    def _dot(self, surface: Surface, color: str, at: Point, width: float) -> None:
        self._pygame.draw.circle(surface, color, self._at(*at), width * _FINE / 2.0)

    def _polygon(self, surface: Surface, color: str, pose: Pose | State, points: Iterable[Point]) -> None:
        """Fill a polygon of a body's frame."""
        self._pygame.draw.polygon(surface, color, [self._at(x, y) for x, y in _placed(pose, points)])

    def _heading(self, surface: Surface, color: str, pose: Pose | State, length: float, width: float) -> None:
        self._lines(surface, color, _placed(pose, [(0.0, 0.0), (length, 0.0)]), width)

    def _write(self, surface: Surface, text: str, **anchor: Point) -> None:
        """Write text at an anchor of pygame's rectangles, such as ``midleft=(column, row)``."""
        written = self._font.render(text, True, _TEXT, _PAPER)
        surface.blit(written, written.get_rect(**anchor))

    def _make_legend(self) -> Surface:
        """Return the strip above the map with the legend, each entry as wide as its label."""
        entries = {"robot (truth)": BLACK, ESTIMATE_WITHIN: VERMILLION, "odometry": SKY_BLUE, "waypoint": GREEN}
        if self._scene is not None:
            entries |= {"scan": PURPLE}
        if self._tracks is not None:
            entries |= {"track": VERMILLION}
        strip, row, column = self._surface(HEADER), 46 * _FINE, 24 * _FINE
        for label, color in entries.items():
            self._pygame.draw.circle(strip, color, (column, row), 6 * _FINE, 2 * _FINE if label == "track" else 0)
            self._write(strip, label, midleft=(column + 12 * _FINE, row))
            column += self._font.size(label)[0] + 38 * _FINE
        return strip

    def _make_paper(self) -> Surface:
        """Return what does not move: lines at whole metres, waypoints, and the walls of the arena or the room."""
        paper, end, edge = self._surface(SIDE), _FINE * SIDE, 20 * _FINE
        spacing = max(1, round(self._half / 4.0))
        for metres in range(-spacing * 999, spacing * 999, spacing):
            column, row = self._at(metres, metres)
            self._pygame.draw.line(paper, _GRID, (column, 0), (column, end), _FINE)
            self._pygame.draw.line(paper, _GRID, (0, row), (end, row), _FINE)
            if edge < column < end - edge:
                self._write(paper, f"{metres} m", midbottom=(column, end - 4 * _FINE))
            if edge < row < end - 1.5 * edge:  # not over the column labels
                self._write(paper, f"{metres} m", midleft=(4 * _FINE, row))
        for waypoint in self._waypoints:
            self._draw_waypoint(paper, waypoint, _PALE_GOAL, 1.5)
        if self._scene is not None:
            self._draw_room(paper, self._scene.room)
        elif not self._waypoints:
            self._lines(paper, _TEXT, [*self._corners, self._corners[0]], 1.5)
        return paper

    def _draw_room(self, paper: Surface, room: Any) -> None:
        if room.squares.shape[1] > 0:
            self._draw_map(paper, room)
        self._lines(paper, _SOLID, [*self._corners, self._corners[0]], 4.0)
        for x, y, a, b, cosine, sine in room.boxes[: room.counts[1]].tolist():
            self._polygon(paper, _SOLID, Pose(x, y, math.atan2(sine, cosine)), [(a, b), (-a, b), (-a, -b), (a, -b)])
        for x, y, radius, vx, vy in room.circles[: room.counts[0]].tolist():
            if vx == vy == 0.0:
                self._disc(paper, _SOLID, (x, y), radius)

    def _draw_map(self, paper: Surface, room: Any) -> None:
        width, height = paper.get_size()
        metres = 1.0 / self._length(1.0)
        x = self._centre[0] - self._half + (np.arange(width)[:, None] + 0.5) * metres
        y = self._centre[1] + self._half - (np.arange(height)[None, :] + 0.5) * metres
        column, row = (np.floor(at).astype(np.intp) for at in to_cells(room.frame, x, y))
        column, row = np.clip(column, 0, room.squares.shape[2] - 1), np.clip(row, 0, room.squares.shape[1] - 1)
        pixels = self._pygame.surfarray.pixels2d(paper)
        pixels[room.known[row, column] == 0] = paper.map_rgb(self._pygame.Color(_UNKNOWN))
        pixels[room.squares[0, row, column] == 0] = paper.map_rgb(self._pygame.Color(_SOLID))

    def _draw_what_moves(self, surface: Surface, scene: Scene, robot: State) -> None:
        """Draw people, the newest scan, and tracks as the robot sees them, each with its way in a second."""
        for x, y, radius, vx, vy in scene.room.circles[: scene.room.counts[0]].tolist():
            if (vx, vy) != (0.0, 0.0):
                self._disc(surface, BLUE, (x, y), radius)
                self._lines(surface, BLUE, [(x, y), (x + vx, y + vy)], 2.5)
        lidar, beams = self._p.room.lidar, self._p.room.lidar.beams
        measured = zip(*scene.lidar.beams[:2, :beams].tolist(), scene.lidar.ranges[1, :beams].tolist(), strict=True)
        ends = _placed(robot, [(lidar.x + length * a, lidar.y + length * b) for a, b, length in measured])
        foot = _placed(robot, [(lidar.x, lidar.y)])[0]
        for beam, end in enumerate(ends):
            if math.isfinite(end[0]) and beam % -(-beams // _LINES) == 0:
                self._lines(surface, _BEAM, [foot, end], 1.0)
            if math.isfinite(end[0]):
                self._dot(surface, PURPLE, end, 8.0)
        tracks = [] if self._tracks is None else self._tracks.reshape(NEAREST, -1).tolist()
        for x, y, vx, vy, deviation, _, _, certainty in tracks:
            if certainty == 1.0:
                foot, tip = _placed(robot, [(x, y), (x + vx, y + vy)])
                # The deviation is that of both coordinates together.
                self._disc(surface, VERMILLION, foot, SIGMAS * deviation / math.sqrt(2.0), 1.5)
                self._lines(surface, VERMILLION, [foot, tip], 2.0)

    def _draw_present(self, surface: Surface, world: Snapshot) -> None:
        self._draw_waypoint(surface, world.course.reference, GREEN, 3.0)
        truth, size = world.body.true_state, self._p.robot.radius
        self._draw_robot(surface, truth, size)
        measured = world.senses.odometry.pose
        self._dot(surface, SKY_BLUE, measured[:2], 9.0)
        self._heading(surface, SKY_BLUE, measured, size, 2.5)
        mean, P = world.estimate.belief
        self._lines(surface, VERMILLION, ellipse(mean, ((P.xx, P.xy), (P.xy, P.yy))).tolist(), 2.0)
        self._heading(surface, VERMILLION, mean, size, 2.5)

    def _draw_waypoint(self, surface: Surface, waypoint: Pose, color: str, width: float) -> None:
        """Draw the circle of arrival and the heading, and as a sector the headings that count as right."""
        radius, tolerance = self._p.task.radius, self._p.task.heading_tolerance
        if tolerance < math.pi:
            angles = np.linspace(-tolerance, tolerance, 17).tolist()
            arc = [(3.0 * radius * math.cos(angle), 3.0 * radius * math.sin(angle)) for angle in angles]
            self._polygon(surface, _PALE_GOAL, waypoint, [(0.0, 0.0), *arc])
        self._disc(surface, color, waypoint[:2], radius, width)
        self._heading(surface, color, waypoint, radius, width)

    def _draw_robot(self, surface: Surface, truth: State, size: float) -> None:
        """Draw the robot from above: wheels, body and heading."""
        beside, length, width = (size * share for share in _WHEEL)
        self._disc(surface, _BODY, truth[:2], size)
        self._disc(surface, BLACK, truth[:2], size, 2.0)
        for side in (-beside, beside):
            corners = [(length, side + width), (-length, side + width), (-length, side - width), (length, side - width)]
            self._polygon(surface, BLACK, truth, corners)
        self._heading(surface, BLACK, truth, size, 3.0)
