"""A floor plan: a room that is given instead of drawn."""

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
    """Walls around a room, and what stands or walks in it."""

    walls: Walls
    """The rectangle around it."""
    circles: tuple[tuple[float, ...], ...] = ()
    """x, y, radius, and for those that walk their velocity; m, m/s."""
    boxes: tuple[tuple[float, ...], ...] = ()
    """x, y, length, width, and for those that are turned their heading; m, rad."""
    start: Pose | None = None
    """The pose in which the robot starts; drawn where it is None."""
    goal: Pose | None = None
    """The pose that it is to reach; drawn where it is None."""
    map: GridMap | None = None
    """A map that lies within the walls; outside of it all is occupied."""
    max_distance: float = math.inf
    """Distance between start and goal at most, along each axis, where the goal is drawn, m."""

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
        """Return the rules by which start and goal are drawn where they are not given."""
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
        """Write the plan into the arrays of a scene, and return it, with those that are one for all."""
        scene.walls[:] = self.walls
        scene.counts[:] = len(self.circles), len(self.boxes)
        scene.circles[: len(self.circles)] = self.circles or scene.circles[:0]
        for k, (x, y, length, width, heading) in enumerate(self.boxes):
            scene.boxes[k] = x, y, length / 2.0, width / 2.0, math.cos(heading), math.sin(heading)
        return self.map.share(scene) if self.map else scene


def _numbers(name: str, value: Any, sizes: tuple[int, ...]) -> tuple[float, ...]:
    """Return a tuple of finite numbers, of one of some sizes."""
    try:
        numbers = tuple(map(float, value)) if isinstance(value, Sequence) else ()
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) not in sizes or not all(map(math.isfinite, numbers)):
        allowed = " or ".join(map(str, sizes))
        raise ValueError(f"FloorPlan.{name} must hold {allowed} finite numbers, got {value!r}.")
    return numbers
