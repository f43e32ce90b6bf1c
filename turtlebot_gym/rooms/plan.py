"""Floor plans: given rooms instead of randomly drawn ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.rules import ANYWHERE, GIVEN, RoomRules
from turtlebot_gym.rooms.scene import Scene, Walls, make_scenes, scene_at
from turtlebot_gym.rooms.sensing import clearance
from turtlebot_gym.values import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorPlan:
    """Walls around a room, and its obstacles and walkers."""

    walls: Walls
    """Rectangle around the room."""
    circles: tuple[tuple[float, ...], ...] = ()
    """x, y and radius of each, followed by the velocity of walkers; m, m/s."""
    boxes: tuple[tuple[float, ...], ...] = ()
    """x, y, length and width of each, followed by the heading of rotated ones; m, rad."""
    start: Pose | None = None
    """Start pose of the robot; None to draw it."""
    goal: Pose | None = None
    """Goal pose of the robot; None to draw it."""
    map: GridMap | None = None
    """Map within the walls; everything outside of the map is occupied."""
    max_distance: float = math.inf
    """Greatest distance between start and a drawn goal along each axis, m."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "walls", Walls(*_numbers("walls", self.walls, (4,))))
        if not min(self.walls.half_length, self.walls.half_width) > 0.0:
            raise ValueError(f"FloorPlan.walls must enclose a room, got {self.walls!r}.")
        circles = tuple(_numbers("circles", circle, (3, 5)) for circle in self.circles)
        boxes = tuple(_numbers("boxes", box, (4, 5)) for box in self.boxes)
        if not all(circle[2] > 0.0 for circle in circles):
            raise ValueError(f"FloorPlan.circles must have positive radii, got {self.circles!r}.")
        if not all(box[2] > 0.0 and box[3] > 0.0 for box in boxes):
            raise ValueError(f"FloorPlan.boxes must have positive extents, got {self.boxes!r}.")
        object.__setattr__(self, "circles", tuple((*circle, 0.0, 0.0)[:5] for circle in circles))
        object.__setattr__(self, "boxes", tuple((*box, 0.0)[:5] for box in boxes))
        for name in ("start", "goal"):
            pose = getattr(self, name)
            if pose is not None:
                pose = Pose(*_numbers(name, pose, (3,)))
                object.__setattr__(self, name, pose)
                if clearance(self.scene(), pose.x, pose.y) < 0.0:
                    raise ValueError(f"FloorPlan.{name} must be in the room and in no obstacle, got {pose!r}.")

    def scene(self, *, beams: int = 1) -> Scene:
        """Return a scene with the plan."""
        circles, boxes = len(self.circles), len(self.boxes)
        length, width = 2.0 * self.walls.half_length, 2.0 * self.walls.half_width
        scene = scene_at(make_scenes(1, circles=circles, boxes=boxes, length=length, width=width, beams=beams), 0)
        return self.put(scene)

    def rules(self) -> RoomRules:
        """Return the rules by which start and goal are drawn unless they are given."""
        n_circles, n_boxes = float(len(self.circles)), float(len(self.boxes))
        return RoomRules(
            kind=GIVEN,
            half_length=self.walls.half_length,
            half_width=self.walls.half_width,
            circles=(n_circles, n_circles),
            boxes=(n_boxes, n_boxes),
            start=tuple(self.start) if self.start else ANYWHERE,
            goal=tuple(self.goal) if self.goal else ANYWHERE,
            min_distance=0.0 if self.start or self.goal else min(1.5, self.walls.half_length),
            max_distance=self.max_distance,
        )

    def put(self, scene: Scene) -> Scene:
        """Write the plan into the arrays of a scene, and return the scene with the shared arrays of the map."""
        scene.walls[:] = self.walls
        scene.counts[:] = len(self.circles), len(self.boxes)
        scene.circles[: len(self.circles)] = self.circles or scene.circles[:0]
        for k, (x, y, length, width, heading) in enumerate(self.boxes):
            scene.boxes[k] = x, y, length / 2.0, width / 2.0, math.cos(heading), math.sin(heading)
        return self.map.share(scene) if self.map else scene


def _numbers(name: str, value: Any, sizes: tuple[int, ...]) -> tuple[float, ...]:
    """Return a tuple of finite numbers whose size is one of those allowed."""
    try:
        numbers = tuple(map(float, value)) if isinstance(value, Sequence) else ()
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) not in sizes or not all(map(math.isfinite, numbers)):
        allowed = " or ".join(map(str, sizes))
        raise ValueError(f"FloorPlan.{name} must hold {allowed} finite numbers, got {value!r}.")
    return numbers
