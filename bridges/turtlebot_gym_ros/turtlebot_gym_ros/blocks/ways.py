"""Whether a map has a way to a goal, and how long it is."""

from __future__ import annotations

import math

from turtlebot_gym.rooms.geodesic import MARGIN, UNKNOWN, block, cell_of, centre_of, extent, is_free, spread, way_left
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scene import RESOLUTION
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.node.errand import Failure


class Ways:
    """Shortest ways on a map for a robot that keeps `MARGIN` to everything, see `rooms.geodesic`.

    Args:
        grid: The map.
        radius: The robot's, m.
    """

    def __init__(self, grid: GridMap, radius: float) -> None:
        self.grid, self._radius = grid, radius
        self._scene = FloorPlan(walls=grid.walls(), map=grid).scene()
        block(self._scene, radius + MARGIN)

    def lead_to(self, goal: Pose, start: Pose | None, tolerance: float) -> tuple[Failure, str] | None:
        """Find the ways to a goal, or return why there is none.

        Args:
            goal: The goal.
            start: Where the robot is; None if nobody knows.
            tolerance: Distance from the goal that will do, m.
        """
        where = f"the goal ({goal.x:.2f}, {goal.y:.2f})"
        x, y, half_length, half_width = self._scene.room.walls
        if abs(goal.x - x) > half_length or abs(goal.y - y) > half_width:
            return Failure.OUTSIDE_MAP, f"{where} is outside of the map"
        place = self._nearest(goal, max(tolerance, RESOLUTION))
        if place is None:
            return Failure.OCCUPIED, f"{where} is where the map has no room for a robot of radius {self._radius:g} m"
        spread(self._scene, *place)
        return None if start is None or self.left(start) is not None else self.no_way(start, goal)

    def no_way(self, start: Pose, goal: Pose) -> tuple[Failure, str]:
        """Return that there is no way between two poses."""
        way = f"from the robot at ({start.x:.2f}, {start.y:.2f}) to the goal ({goal.x:.2f}, {goal.y:.2f})"
        return Failure.NO_WAY, f"the map has no way {way} for a robot of radius {self._radius:g} m"

    def _nearest(self, goal: Pose, tolerance: float) -> tuple[float, float] | None:
        """Return the centre of the free cell nearest to a goal, within a distance."""
        (rows, columns), (row, column) = extent(self._scene), cell_of(self._scene, goal.x, goal.y)
        reach = math.ceil(tolerance / RESOLUTION)
        near = [
            centre_of(self._scene, i, j)
            for i in range(max(row - reach, 0), min(row + reach + 1, rows))
            for j in range(max(column - reach, 0), min(column + reach + 1, columns))
        ]
        free = [place for place in near if is_free(self._scene, *place) and math.dist(place, goal[:2]) <= tolerance]
        return min(free, key=lambda place: math.dist(place, goal[:2]), default=None)

    def left(self, pose: Pose) -> float | None:
        """Return the length of the way from a pose to the goal, m; None if there is none."""
        left = way_left(self._scene, pose.x, pose.y)
        return None if left == UNKNOWN else left
