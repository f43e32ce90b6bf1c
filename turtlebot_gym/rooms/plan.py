"""Floor plans: given rooms instead of randomly drawn ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from turtlebot_gym.config import FINITE, Numbers, refusal
from turtlebot_gym.rooms.grid import GridMap, chart
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
    """Map within the walls, which a localizer knows, too; everything outside of the map is occupied."""
    max_distance: float = math.inf
    """Greatest distance between start and a drawn goal along each axis, m."""

    def __post_init__(self) -> None:
        walls = Walls(*Numbers(FINITE, 4).check("FloorPlan.walls", self.walls))
        if not min(walls.half_length, walls.half_width) > 0.0:
            raise refusal("FloorPlan.walls", "around a room", self.walls)
        if not isinstance(self.map, GridMap | None):
            raise refusal("FloorPlan.map", "a GridMap or None", self.map)
        object.__setattr__(self, "walls", walls)
        object.__setattr__(self, "circles", self._rows("circles", 3))
        object.__setattr__(self, "boxes", self._rows("boxes", 4))
        for name in ("start", "goal"):
            if (value := getattr(self, name)) is not None:
                pose = Pose(*Numbers(FINITE, 3).check(f"FloorPlan.{name}", value))
                object.__setattr__(self, name, pose)
                if clearance(self.scene(), pose.x, pose.y) < 0.0:
                    raise refusal(f"FloorPlan.{name}", "in the room and in no obstacle", pose)

    def _rows(self, name: str, least: int) -> tuple[tuple[float, ...], ...]:
        """Return the numbers of all obstacles of a kind, the least or 5 of each, completed by zeros."""
        rows = tuple(Numbers(FINITE).check(f"FloorPlan.{name}[{at}]", row) for at, row in enumerate(getattr(self, name)))
        for at, row in enumerate(rows):
            if len(row) not in (least, 5) or min(row[2:least]) <= 0.0:
                raise refusal(f"FloorPlan.{name}[{at}]", f"{least} or 5 numbers with positive extents", row)
        return tuple((*row, 0.0, 0.0)[:5] for row in rows)

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
        """Write the plan into a scene, and return it with the map's arrays."""
        scene.room.walls[:] = self.walls
        scene.room.counts[:] = len(self.circles), len(self.boxes)
        scene.room.circles[: len(self.circles)] = self.circles or scene.room.circles[:0]
        for k, (x, y, length, width, heading) in enumerate(self.boxes):
            scene.room.boxes[k] = x, y, length / 2.0, width / 2.0, math.cos(heading), math.sin(heading)
        return self.map.share(scene) if self.map else scene

    def share(self, scenes: Scene) -> Scene:
        """Return scenes of many robots that share the map's arrays, and a localizer's map if there is one."""
        scenes = self.map.share(scenes) if self.map else scenes
        if scenes.memory.field.size == 0:
            return scenes
        field = self.map.field()[None] if self.map else scenes.memory.field[:1].copy()
        frame = self.map.frame[None] if self.map else np.zeros((1, 5))
        shared = scenes._replace(memory=scenes.memory._replace(field=field, field_frame=frame))
        if not self.map:
            chart(self.put(scene_at(shared, 0)))
        return shared
