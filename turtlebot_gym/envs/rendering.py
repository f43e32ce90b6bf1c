"""The picture of the scalar environment: where the robot is, where it believes it is, and its goal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from gymnasium.error import DependencyNotInstalled
from matplotlib import get_data_path
from numpy.typing import NDArray

from turtlebot_gym.envs.colours import DARK, LIGHT
from turtlebot_gym.plotting import ESTIMATE_WITHIN, SKY_BLUE, ellipse
from turtlebot_gym.robots import Robot
from turtlebot_gym.systems import Snapshot
from turtlebot_gym.tasks import Task, distance_to
from turtlebot_gym.values import Belief, Pose, State

if TYPE_CHECKING:
    from pygame import Surface

SIDE, HEADER = 640, 64
"""Side of the map, and height of the strip above it with the legend; pixels."""
_FINE = 2
"""Supersampling factor, which smooths every edge."""
_EDGE = 20 * _FINE
"""Distance from an edge within which no coordinate is written, since it could be cut off."""
_MARGIN = 0.5
"""Margin around the visible points, m: for circles of arrival, noisy odometry and the scale."""
_GROWTH = 1.25
"""A robot that leaves the view widens it by this factor."""
_ROW, _GAP = 46 * _FINE, 18 * _FINE
"""Row of the legend, and the space between its entries."""
_WHEEL = (0.75, 0.45, 0.13)
"""Distance from the middle, half length and half width of a wheel, as shares of the robot's radius."""


class Renderer:
    """Draws the world of one environment; a robot that leaves the map widens the view until the reset.

    Args:
        mode: "human" for a window, which opens with the first picture; "rgb_array" for arrays, which need no display.
        robot: Robot whose size is drawn.
        task: Task whose arena and arrival radius are drawn.
        waypoints: The given waypoints, which fill the map together with the origin; None if the arena does.
        dt: Control interval, s, for the displayed time.
        fps: Pictures per second in the window.
        dark: Whether the paper is dark, for slides and dark pages.

    Raises:
        DependencyNotInstalled: If pygame is missing.
    """

    def __init__(
        self,
        mode: Literal["human", "rgb_array"],
        *,
        robot: Robot,
        task: Task,
        waypoints: Sequence[Pose] | None,
        dt: float,
        fps: float,
        dark: bool = False,
    ) -> None:
        try:
            import pygame
        except ImportError as error:
            raise DependencyNotInstalled('pygame is not installed, run `pip install "pygame>=2.5"`') from error
        pygame.font.init()
        self._pygame = pygame
        self._mode, self._robot, self._task, self._dt, self._fps = mode, robot, task, dt, fps
        self._waypoints = [Pose(*waypoint) for waypoint in waypoints or ()]
        self._colours = DARK if dark else LIGHT
        self._font = pygame.font.Font(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), 12 * _FINE)
        self._window: Surface | None = None
        self._clock = pygame.time.Clock()
        self._legend = self._make_legend()
        self.reset()

    def reset(self) -> None:
        """Clear the trails, and return to the initial view."""
        seen = self._to_be_seen()
        low, high = np.min(seen, axis=0), np.max(seen, axis=0)
        self._centre = (low + high) / 2.0
        self._half = float(np.max(high - low)) / 2.0 + _MARGIN
        self._trails: list[tuple[Pose, State, State]] = []
        self._paper = self._make_paper()

    def _to_be_seen(self) -> list[tuple[float, float]]:
        arena = self._task.arena
        corners = [(0.0, 0.0)] if self._waypoints else [(-arena, -arena), (arena, arena)]
        return [*corners, *((x, y) for x, y, _ in self._waypoints)]

    def draw(self, world: Snapshot) -> NDArray[np.uint8] | None:
        """Draw a world and add it to the trails.

        Returns:
            The picture, shape (HEADER + SIDE, SIDE, 3), in mode "rgb_array"; None in mode "human", which shows it.
        """
        self._trails.append((world.senses.odometry.pose, world.body.true_state, world.estimate.belief.mean))
        if self._widen(world):
            self._paper = self._make_paper()
        fine = self._surface(HEADER + SIDE)
        fine.blit(self._legend, (0, 0))
        self._write_numbers(fine, world)
        fine.blit(self._paper, (0, _FINE * HEADER))
        below = fine.subsurface((0, _FINE * HEADER, _FINE * SIDE, _FINE * SIDE))
        self._draw_trails(below)
        self._draw_present(below, world)
        picture = self._pygame.transform.smoothscale(fine, (SIDE, HEADER + SIDE))
        if self._mode == "rgb_array":
            pixels = bytearray(self._pygame.image.tobytes(picture, "RGB"))  # four times as fast as pygame.surfarray
            return np.frombuffer(pixels, np.uint8).reshape(HEADER + SIDE, SIDE, 3)
        self._show(picture)
        return None

    def close(self) -> None:
        if self._window is not None:
            self._pygame.display.quit()
            self._window = None

    def _show(self, picture: Surface) -> None:
        display = self._pygame.display
        if self._window is None:
            display.init()
            self._window = display.set_mode(picture.get_size())
            display.set_caption("TurtleBot")
        self._window.blit(picture, (0, 0))
        self._pygame.event.pump()
        display.flip()
        self._clock.tick(self._fps)

    def _widen(self, world: Snapshot) -> bool:
        """Widen the view until it contains the robot, and return whether that was necessary."""
        x, y = world.body.true_state.x - self._centre[0], world.body.true_state.y - self._centre[1]
        needed = max(abs(x), abs(y)) + self._robot.radius
        if needed <= self._half:
            return False
        self._half *= _GROWTH ** math.ceil(math.log(needed / self._half, _GROWTH))
        return True

    def _at(self, x: float, y: float) -> tuple[float, float]:
        """Return column and row of a world point, in supersampled pixels as below."""
        left, top = self._centre[0] - self._half, self._centre[1] + self._half
        return self._length(x - left), self._length(top - y)

    def _length(self, metres: float) -> float:
        return metres * _FINE * SIDE / (2.0 * self._half)

    def _surface(self, height: int) -> Surface:
        surface = self._pygame.Surface((_FINE * SIDE, _FINE * height), depth=32)
        surface.fill(self._colours.paper)
        return surface

    def _line(self, surface: Surface, color: str, start: tuple, end: tuple, width: float) -> None:
        self._pygame.draw.line(surface, color, start, end, round(width * _FINE))

    def _disc(self, surface: Surface, color: str, centre: tuple, radius: float, width: float = 0.0) -> None:
        self._pygame.draw.circle(surface, color, centre, radius, round(width * _FINE))

    def _draw_heading(self, surface: Surface, color: str, foot: tuple, theta: float, length: float, width: float) -> None:
        tip = foot[0] + length * math.cos(theta), foot[1] - length * math.sin(theta)
        self._line(surface, color, foot, tip, width)

    def _write(self, surface: Surface, text: str, color: str, **anchor: tuple) -> None:
        """Write text at an anchor of pygame's rectangles, such as ``midleft=(column, row)``."""
        written = self._font.render(text, True, color, self._colours.paper)
        surface.blit(written, written.get_rect(**anchor))

    def _make_paper(self) -> Surface:
        """Return the map without a robot: the background of the trails."""
        paper = self._surface(SIDE)
        self._draw_grid(paper)
        for waypoint in self._waypoints:
            self._draw_waypoint(paper, waypoint, self._colours.pale_goal, 1.5)
        self._draw_around(paper)
        return paper

    def _draw_around(self, paper: Surface) -> None:
        if not self._waypoints:
            arena = self._task.arena
            side = self._length(2.0 * arena)
            self._pygame.draw.rect(paper, self._colours.text, (*self._at(-arena, arena), side, side), round(1.5 * _FINE))

    def _draw_grid(self, paper: Surface) -> None:
        """Draw lines at whole metres, with coordinates along two edges."""
        spacing, end, text = max(1, round(self._half / 4.0)), _FINE * SIDE, self._colours.text
        for metres in range(-spacing * 999, spacing * 999, spacing):
            column, row = self._at(metres, metres)
            if 0.0 <= column <= end:
                self._line(paper, self._colours.grid, (column, 0), (column, end), 1.0)
            if 0.0 <= row <= end:
                self._line(paper, self._colours.grid, (0, row), (end, row), 1.0)
            if _EDGE < column < end - _EDGE:
                self._write(paper, f"{metres} m", text, midbottom=(column, end - 4 * _FINE))
            if _EDGE < row < end - 1.5 * _EDGE:  # not over the column labels
                self._write(paper, f"{metres} m", text, midleft=(4 * _FINE, row))

    def _legend_entries(self) -> list[tuple[str, Callable[[Surface, tuple, float], None]]]:
        """Return label and symbol of what is drawn; a symbol is drawn around a point, in a size."""
        colours = self._colours

        def ring(surface: Surface, at: tuple, size: float) -> None:
            outline = self._pygame.Rect(0, 0, 2.8 * size, 2.0 * size)
            outline.center = at
            self._pygame.draw.ellipse(surface, colours.estimate, outline, 2 * _FINE)
            self._draw_heading(surface, colours.estimate, at, 0.0, size, 2.0)

        def goal(surface: Surface, at: tuple, size: float) -> None:
            self._disc(surface, colours.goal, at, size, 2.5)
            self._draw_heading(surface, colours.goal, at, 0.0, size, 2.5)

        return [
            ("robot (truth)", lambda surface, at, size: self._draw_robot(surface, at, 0.0, size)),
            (ESTIMATE_WITHIN, ring),
            ("odometry", lambda surface, at, size: self._draw_measurement(surface, at, 0.0, size)),
            ("waypoint", goal),
        ]

    def _make_legend(self) -> Surface:
        """Return the strip above the map with the legend, each entry as wide as its label."""
        strip, size, column = self._surface(HEADER), 9 * _FINE, 15.0 * _FINE
        for label, draw in self._legend_entries():
            draw(strip, (column + size, _ROW), size)
            column += 3.0 * size
            self._write(strip, label, self._colours.text, midleft=(column, _ROW))
            column += self._font.size(label)[0] + _GAP
        return strip

    def _write_numbers(self, surface: Surface, world: Snapshot) -> None:
        row = 18 * _FINE
        self._write(surface, f"time {world.steps * self._dt:.1f} s", self._colours.text, midleft=(15 * _FINE, row))
        to_go = distance_to(world.body.true_state, world.course.reference)
        self._write(surface, f"{to_go:.2f} m to the waypoint", self._colours.text, midleft=(128 * _FINE, row))

    def _draw_trails(self, surface: Surface) -> None:
        measured, *paths = ([self._at(each[0], each[1]) for each in trail] for trail in zip(*self._trails, strict=True))
        for place in measured:
            self._disc(surface, SKY_BLUE, place, 2.0 * _FINE)
        for path, colour, width in zip(paths, (self._colours.truth, self._colours.estimate), (3.0, 1.5), strict=True):
            if len(path) > 1:
                self._pygame.draw.lines(surface, colour, False, path, round(width * _FINE))

    def _draw_present(self, surface: Surface, world: Snapshot) -> None:
        self._draw_waypoint(surface, world.course.reference, self._colours.goal, 3.0)
        truth = world.body.true_state
        size = self._length(self._robot.radius)
        self._draw_robot(surface, self._at(truth.x, truth.y), truth.theta, size)
        z = world.senses.odometry.pose
        self._draw_measurement(surface, self._at(z.x, z.y), z.theta, size)
        self._draw_belief(surface, world.estimate.belief, size)

    def _draw_waypoint(self, surface: Surface, waypoint: Pose, color: str, width: float) -> None:
        radius = self._length(self._task.radius)
        centre = self._at(waypoint.x, waypoint.y)
        if self._task.heading_tolerance < math.pi:
            self._draw_tolerance(surface, centre, waypoint.theta, 3.0 * radius)
        self._disc(surface, color, centre, radius, width)
        self._draw_heading(surface, color, centre, waypoint.theta, radius, width)

    def _draw_tolerance(self, surface: Surface, centre: tuple, theta: float, length: float) -> None:
        """Draw the headings that count as right, as a sector."""
        angles = np.linspace(-1.0, 1.0, 17) * self._task.heading_tolerance + theta
        arc = [(centre[0] + length * math.cos(angle), centre[1] - length * math.sin(angle)) for angle in angles.tolist()]
        self._pygame.draw.polygon(surface, self._colours.pale_goal, [centre, *arc])

    def _draw_robot(self, surface: Surface, centre: tuple, theta: float, size: float) -> None:
        """Draw the robot from above: wheels, body and heading."""
        cosine, sine = math.cos(theta), math.sin(theta)
        beside, length, width = (size * share for share in _WHEEL)
        self._disc(surface, self._colours.body, centre, size)
        self._disc(surface, self._colours.truth, centre, size, 2.0)
        for side in (-beside, beside):
            corners = ((length, side + width), (-length, side + width), (-length, side - width), (length, side - width))
            placed = [(centre[0] + a * cosine - b * sine, centre[1] - a * sine - b * cosine) for a, b in corners]
            self._pygame.draw.polygon(surface, self._colours.truth, placed)
        self._draw_heading(surface, self._colours.truth, centre, theta, size, 3.0)

    def _draw_measurement(self, surface: Surface, centre: tuple, theta: float, size: float) -> None:
        self._disc(surface, SKY_BLUE, centre, 4.5 * _FINE)
        self._draw_heading(surface, SKY_BLUE, centre, theta, size, 2.5)

    def _draw_belief(self, surface: Surface, belief: Belief, size: float) -> None:
        mean, P = belief
        outline = ellipse(mean, ((P.xx, P.xy), (P.xy, P.yy)))
        self._pygame.draw.lines(surface, self._colours.estimate, True, [self._at(x, y) for x, y in outline], 2 * _FINE)
        self._draw_heading(surface, self._colours.estimate, self._at(mean.x, mean.y), mean.theta, size, 2.5)
